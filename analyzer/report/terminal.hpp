#pragma once
// A Section as text for people: findings worst first, then aligned tables, then notes. Columns are aligned by what a
// terminal shows (UTF-8, wide characters), control characters never reach it.

#include <string>

#include "analyzer/report/section.hpp"

namespace tacho::report {

struct TerminalOptions {
  std::string zone = "UTC";  ///< times are shown in it
  bool colour = false;       ///< ANSI colours for verdicts
  bool all = false;          ///< also detail tables, and every row
  std::size_t rows = 25;     ///< rows of a table unless `all`
  std::size_t cell = 60;     ///< longer texts are cut unless `all`
};

std::string terminal_text(const Section& section, const TerminalOptions& options);

/// One finding in a few lines, as in terminal_text.
std::string terminal_text(const Finding& finding, const TerminalOptions& options);

}  // namespace tacho::report
