#include "recorder/health.hpp"

#include <fmt/format.h>

#include "schema/time.hpp"

namespace tacho::recorder {

std::string stuck(std::span<const Beat> beats) {
  const Beat* worst = nullptr;
  for (const Beat& beat : beats) {
    const Micros over_us = beat.busy_us - beat.allowed_us;
    if (over_us > 0 && (worst == nullptr || over_us > worst->busy_us - worst->allowed_us)) {
      worst = &beat;
    }
  }
  return worst == nullptr ? ""
                          : fmt::format("{} has been at one step for {}", worst->who, duration_text(worst->busy_us));
}

}  // namespace tacho::recorder
