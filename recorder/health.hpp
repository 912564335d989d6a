#pragma once
// Whether every thread still gets on with its work. A thread that waits for its next poll or for rows is well however
// long that takes; one that has been at a single step for longer than that step can take is stuck.

#include <span>
#include <string>

#include "schema/sample.hpp"

namespace tacho::recorder {

struct Beat {
  std::string who;     ///< "the writer", "amr-1: modbus"
  Micros busy_us = 0;  ///< how long the present step has taken
  Micros allowed_us = 0;
};

/// One write or commit; a disk that needs longer for one is as good as gone.
inline constexpr Micros kWriterMayTake = 120'000'000;
/// Beyond the timeout of a poll, which nothing in it exceeds: a host that is that late has stood still.
inline constexpr Micros kPollerMayTake = 30'000'000;

/// The one that is over its time by most, in words; empty: all is well.
std::string stuck(std::span<const Beat> beats);

}  // namespace tacho::recorder
