#pragma once
// Robots of a log that may be one: a name that was changed in the configuration makes a new robot of the log.

#include <string>
#include <vector>

#include "schema/row_source.hpp"

namespace tacho::commands {

/// A line for each robot that shares its identity, or else its address, with an earlier one, where one of the two is
/// among `chosen`. At most one line per robot, so that a fleet behind one address is not told pair by pair.
std::vector<std::string> twin_notes(const RowSource& log, const std::vector<Robot>& chosen);

}  // namespace tacho::commands
