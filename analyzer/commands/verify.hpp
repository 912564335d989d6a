#pragma once
// Is all of a log there and whole; and writing what can be read of it into a new one.

#include "analyzer/commands/common.hpp"

namespace tacho::commands {

/// Reads everything. kExitOk: whole; kExitFindings: damaged, or polls are missing.
int verify(const Options& options);
/// Into the folder `options.output`. kExitOk: nothing was lost; kExitFindings: something was, or may have been;
/// kExitFailed: the new log is not what was read.
int recover_log(const Options& options);

}  // namespace tacho::commands
