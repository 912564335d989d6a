#pragma once
// Everything at once: every analysis into a folder (analyzer/report/folder.hpp says what is in it).

#include "analyzer/commands/common.hpp"

namespace tacho::commands {

/// Writes the folder of -o, prints the findings, and returns the exit code that --fail-on asks for.
int report_all(Job& job);

}  // namespace tacho::commands
