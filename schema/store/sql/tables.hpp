#pragma once
// The modules of a connection: tacho_status, tacho_io, tacho_registers, tacho_inputs, and one per plain table
// (tacho_gap, ...). Each makes a table of the log that its arguments name: folders or parts.

#include <memory>
#include <string>
#include <vector>

#include "schema/store/sql/shared_log.hpp"

struct sqlite3;
struct sqlite3_api_routines;

namespace tacho::store::sql {

/// From now on virtual tables call SQLite through `api`. Must come before everything else here; once per process, and
/// again is no harm.
void use_api(const sqlite3_api_routines* api);

/// Names of the virtual tables: status, io, registers, inputs.
const std::vector<std::string>& row_table_names();
/// The same with the plain tables.
std::vector<std::string> all_table_names();
/// Every column of every table of them, for "did you mean".
std::vector<std::string> all_column_names();

/// Registers the modules and the collation of `time`. `standard` is the log of tables without arguments; may be null.
/// Throws Error.
void register_modules(sqlite3* connection, OpenLog open, std::shared_ptr<SharedLog> standard);

/// The entry point of the extension: the modules, and when the main database is a part, the tables `status`, `io`,
/// `registers` and `inputs` of it (temporary ones, so that a read-only file will do). Returns a code of SQLite; on
/// failure `*message` is text that SQLite frees.
int load_extension(sqlite3* connection, char** message, const sqlite3_api_routines* api, OpenLog open);

}  // namespace tacho::store::sql
