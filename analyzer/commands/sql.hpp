#pragma once
// One SELECT over the log, its rows as a table.

#include <string>

#include "analyzer/commands/common.hpp"

namespace tacho::commands {

/// Runs the statement and writes its rows where the options say: a table, JSON, or CSV row by row. Throws UsageError
/// for a mistake in the statement.
int run_sql(Job& job, const std::string& statement);

}  // namespace tacho::commands
