#include "schema/store/clock_trust.hpp"

#include <sys/timex.h>

#include <algorithm>
#include <cstdlib>

#include "schema/time.hpp"

namespace tacho::store {

HostTime host_time() {
  timex kernel{};
  const int state = adjtimex(&kernel);  // -1: a sandbox forbids to ask
  const bool good = state >= 0 && state != TIME_ERROR && (kernel.status & STA_UNSYNC) == 0;
  return {wall_now_us(), mono_now_us(), good};
}

void ClockTrust::follow(Micros wall_minus_mono) {
  if (wall_minus_mono_ && std::abs(wall_minus_mono - *wall_minus_mono_) <= kStepUs) {
    return;
  }
  wall_minus_mono_ = wall_minus_mono;
  synchronised_ = false;
  agree_.clear();
}

void ClockTrust::see(const ClockPoint& point) {
  follow(point.wall_us - point.mono_us);
  if (point.robot_us) {
    agree_[point.robot] = std::abs(*point.robot_us - point.wall_us) <= kStepUs;
  }
}

std::optional<Micros> ClockTrust::now(const HostTime& time) {
  follow(time.wall_us - time.mono_us);
  synchronised_ = synchronised_ || time.synchronised;
  const auto agree = std::count_if(agree_.begin(), agree_.end(), [](const auto& robot) { return robot.second; });
  const bool robots = 2 * static_cast<std::size_t>(agree) > agree_.size();
  return synchronised_ || robots ? std::optional(time.wall_us) : std::nullopt;
}

}  // namespace tacho::store
