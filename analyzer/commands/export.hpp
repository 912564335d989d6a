#pragma once
// Rows of one source as CSV or JSON lines, all of them as a SQLite file, and stored answers byte for byte. Streams:
// memory does not grow with the log.

#include <string>
#include <vector>

#include "analyzer/commands/common.hpp"

namespace tacho::commands {

struct ExportOptions {
  std::string source;               ///< empty: status, or the only one the log has
  std::vector<std::string> fields;  ///< empty: every field that was ever seen
  bool states = false;              ///< a NAME_state column per field (CSV), a "states" object (JSON lines)
  bool raw = false;
};

/// CSV: robot, session, seq, t_utc, t_unix_ms, t_send_us, t_recv_us, then the fields. t is the middle of the poll.
/// Whatever is not a value (absent, null, not meaningful, not supplied, wrong type) is an empty field in CSV; in JSON
/// lines an absent field is left out and the others are null; which of them it was is said with `states`.
void export_rows(Job& job, const ExportOptions& options);

/// All sources as wide tables of one SQLite file, which must not exist yet; --source and --fields choose less.
void export_database(Job& job, const ExportOptions& options);

/// Every stored body in order, each followed by one newline, to standard output; with -o DIR one file each, exactly the
/// stored bytes.
void export_raw(Job& job, const ExportOptions& options);

}  // namespace tacho::commands
