#include "recorder/robot_clock.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>

#include "schema/time.hpp"

namespace tacho::recorder {

namespace {

constexpr Micros kSecond = 1'000'000;
constexpr Micros kMinute = 60 * kSecond;  // a clock that is off by 100 ppm moves by 6 ms in it
constexpr Micros kZoneStep = 15 * kMinute;

/// Local time of the robot as if it were UTC.
std::optional<Micros> shown_by_registers(const Sample& sample) {
  constexpr std::array kParts{field("clock_year"), field("clock_month"),  field("clock_day"),
                              field("clock_hour"), field("clock_minute"), field("clock_second")};
  std::array<std::int64_t, kParts.size()> parts{};
  for (std::size_t i = 0; i < kParts.size(); ++i) {
    if (!sample.at(kParts[i]).has()) {
      return std::nullopt;
    }
    parts[i] = sample.at(kParts[i]).integer;
  }
  return parse_time(
      fmt::format("{:04}-{:02}-{:02}T{:02}:{:02}:{:02}Z", parts[0], parts[1], parts[2], parts[3], parts[4], parts[5]),
      "UTC");
}

Micros without_zone(Micros us) {
  const Micros rest = us % kZoneStep;
  return std::abs(rest) * 2 <= kZoneStep ? rest : rest - (rest > 0 ? kZoneStep : -kZoneStep);
}

}  // namespace

bool RobotClock::see(const Sample& sample) {
  constexpr FieldIndex kCreateOn = field("create_on");
  const AnswerMeta& meta = sample.meta;
  if (const std::optional<Micros> stamp =
          sample.at(kCreateOn).has() ? parse_time(sample.text(kCreateOn), "UTC") : std::nullopt) {
    offset_us_ = *stamp - meta.t_mid_us();
    stamped_us_ = meta.t_recv_us;
    return true;
  }
  if (stamped_us_ && std::abs(meta.t_recv_us - *stamped_us_) < kMinute) {
    return false;
  }
  const std::optional<Micros> local_us = shown_by_registers(sample);
  return local_us && see_second(meta, *local_us);
}

bool RobotClock::see_second(const AnswerMeta& meta, Micros local_us) {
  const Bounds one{meta.t_recv_us, local_us - meta.t_recv_us, local_us + kSecond - meta.t_send_us};
  if (!bounds_ || std::abs(one.since_us - bounds_->since_us) >= kMinute) {
    bounds_ = one;
  }
  const Bounds both{bounds_->since_us, std::max(bounds_->least_us, one.least_us),
                    std::min(bounds_->most_us, one.most_us)};
  bounds_ = both.least_us < both.most_us ? both : one;  // nothing in common: one of the clocks was set
  const bool narrow = bounds_->most_us - bounds_->least_us <= 2 * kUncertainUs;
  if (narrow) {
    offset_us_ = without_zone(middle(bounds_->least_us, bounds_->most_us));
  }
  return narrow;
}

}  // namespace tacho::recorder
