#pragma once
// A log as one plain SQLite file, for tools that cannot load the extension: wide tables `status`, `io`, `registers` and
// `inputs` with a column per field, `robot`, `session`, `gap`, `event` and `clock` as in a part, and the field
// reference (`field`, `code`).

#include <cstdint>
#include <filesystem>
#include <functional>
#include <vector>

#include "schema/row_source.hpp"

namespace tacho::store::sql {

struct SqliteExport {
  std::vector<Robot> robots;
  std::vector<Source> sources;  ///< one table each, also when it stays empty
  Window window;                ///< of rows, gaps, events and clock points
  /// Fields of each source that become columns; those the source cannot have are left out.
  FieldSet fields;
};

/// Writes `path`, which must not exist; streams, a transaction per some ten thousand rows. The file is made beside
/// under the name PATH.unfinished, so that `path` is complete whenever it is there. Throws Error. Returns the number of
/// rows of the wide tables.
std::uint64_t export_sqlite(RowSource& log, const SqliteExport& what, const std::filesystem::path& path);

}  // namespace tacho::store::sql
