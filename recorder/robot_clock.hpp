#pragma once
// A robot's clock minus this host's, from its answers. Pure; one object per robot.
//
// From `create_on`, which names its zone and milliseconds: within half a round trip. Where the last minute had none,
// from registers 126 to 131: whole seconds of local time. One that shows second s, asked and answered at `send` and
// `recv`, says that the difference is in [s - recv, s + 1 - send); what all of a minute have in common is narrow as
// soon as the second has been seen to change. They name no zone, which is a multiple of a quarter of an hour: a clock
// that is wrong by more than half of that is not told from another zone.

#include <optional>

#include "schema/sample.hpp"

namespace tacho::recorder {

class RobotClock {
 public:
  /// True when it has told the offset.
  bool see(const Sample& sample);
  /// Empty: not known yet. Registers: known to kUncertainUs.
  [[nodiscard]] std::optional<Micros> offset_us() const { return offset_us_; }

  static constexpr Micros kUncertainUs = 150'000;

 private:
  struct Bounds {
    Micros since_us;
    Micros least_us;
    Micros most_us;
  };
  std::optional<Micros> offset_us_;
  std::optional<Micros> stamped_us_;  // when create_on told it
  std::optional<Bounds> bounds_;      // of registers, zone included

  bool see_second(const AnswerMeta& meta, Micros local_us);
};

}  // namespace tacho::recorder
