#pragma once
// The robot's clock: all robots seen in the field run in zone UTC-11:00, whatever their site.

#include <cmath>
#include <cstdint>
#include <string>

#include "samples/simulator/scenario.hpp"
#include "schema/sample.hpp"

namespace tacho::sim {

inline constexpr Micros kRobotZone = -11 * 3'600'000'000LL;

struct ClockReading {
  int year = 1970, month = 1, day = 1, hour = 0, minute = 0, second = 0, millisecond = 0;
};

/// What the faults of a scenario's clock add `since_us` after the start, beside clock_offset_s.
Micros clock_fault_us(const Scenario& scenario, Micros since_us);

/// What the robot's clock shows at true time `t_us`, in its zone.
ClockReading robot_clock(Micros t_us, double clock_offset_s);
/// "2026-01-08T23:11:52.705-1100"
void append_create_on(std::string& out, const ClockReading& clock);
/// "2026-01-08 23:11:52", as in alarm elements.
std::string alarm_date_time(std::int64_t stamp_s);

/// The first true time after `t_us` at which the robot's clock shows midnight.
Micros next_robot_midnight(Micros t_us, double clock_offset_s);

}  // namespace tacho::sim
