#pragma once
// Lines of the time line of an incident: events, gaps and changes of all robots, put in order.

#include <string>
#include <vector>

#include "analyzer/report/section.hpp"
#include "schema/records.hpp"

namespace tacho {

struct TimeLine {
  Micros t_us = 0;  ///< order: when it was seen, for a gap when it began
  int rank = 0;     ///< at one moment: gap, event, change
  Micros hull_from_us = 0;
  Micros hull_to_us = 0;
  std::string robot;
  std::string kind;
  std::string source;
  std::string what;
  std::string old_value;
  std::string new_value;
  std::string detail;
  bool of_robot = false;  ///< happened to the robot: each source that shows it tells it once, see join_repeats()
};

/// False for what happens to one source of a robot (its link, its answers, its schedule): two sources, two happenings.
bool is_of_robot(EventKind kind);

/// In the order of time, with one line for what several sources told: same robot, same `what`, same new value, in
/// (hull_from, hull_to] that overlap or nearly so. The line is that of the source that saw it first; the others are
/// named in `source`, and when they saw it in `detail`.
std::vector<TimeLine> join_repeats(std::vector<TimeLine> lines);

}  // namespace tacho
