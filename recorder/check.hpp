#pragma once
// `tacho-recorder check`: connects once per robot and protocol and says what would be recorded. Writes nothing.

#include <string>

#include "recorder/config.hpp"

namespace tacho::recorder {

struct CheckResult {
  std::string text;  ///< for a person
  int problems = 0;  ///< what would be missing from a recording: sources, keys, the log itself
};

CheckResult check_robot(const RobotConfig& robot);
/// All robots at once, reported in the order of the configuration.
CheckResult check(const Config& config);

}  // namespace tacho::recorder
