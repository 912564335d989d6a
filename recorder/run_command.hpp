#pragma once
// `tacho-recorder run`: a recording from its start to the signal that ends it, in a terminal or as a service.

#include <string>

#include "recorder/config.hpp"

namespace tacho::recorder {

struct RunArguments {
  std::string config_file;
  std::string run_for;  ///< a duration; empty: until a signal
  Overrides overrides;
};

/// SIGINT and SIGTERM end the recording; SIGHUP reads the configuration file again, or ends the recording when the
/// terminal it was started in has gone. Returns the exit code; throws UsageError and Error.
int run_command(const RunArguments& arguments);

}  // namespace tacho::recorder
