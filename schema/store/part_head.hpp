#pragma once
// Opening a part for reading, and everything of it that is not an answer, gap, event or clock point.

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "schema/row_source.hpp"
#include "schema/store/coverage.hpp"
#include "schema/store/part.hpp"
#include "schema/store/rows.hpp"
#include "schema/store/seal.hpp"
#include "schema/store/sqlite.hpp"
#include "schema/store/vocabulary.hpp"

namespace tacho::store {

enum class Access : std::uint8_t {
  careful,  ///< every page is read by the system, and everything that is sealed is compared
  fast,     ///< closed parts are mapped, so that a sector that cannot be read is a SIGBUS; heads come from summaries
};

/// Opens read-only, also a truncated file (SQLite itself refuses those) and a closed part in a read-only folder.
/// Throws SqliteError.
Connection open_part_for_reading(const std::filesystem::path& path, Access access = Access::careful);

/// Throws Error when the file is not a part, or a part of a newer version of this program.
class NotAPart : public Error {
  using Error::Error;
};
class NewerPart : public Error {
  using Error::Error;
};

/// Largest ids at the moment of opening: a reader stays below them, so that a log that grows reads as it was.
struct PartEnds {
  std::int64_t row = 0;  ///< answers, hot or moved
  std::int64_t gap = 0;
  std::int64_t event = 0;
  std::int64_t clock = 0;
};

struct PartHead {
  std::filesystem::path path;
  std::int64_t version = 0;  ///< user_version
  PartRow row;
  bool checkpointed = false;  ///< journal mode is no longer WAL
  std::uint64_t file_bytes = 0;
  std::vector<Robot> robots;
  std::vector<Session> sessions;
  std::vector<StreamRow> streams;
  StreamCounts counts;  ///< exact, also after a kill, when there is no damage
  GapCounts gaps;
  std::vector<UnknownKey> unknown_keys;
  Vocabulary vocabulary;
  PartEnds ends;
  SealedRows sealed_rows;
  std::vector<std::string> damage;  ///< in words; empty for a whole part
};

/// Nobody writes it: it was checkpointed, and has no WAL.
inline bool is_closed(const PartHead& head) { return head.row.closed && head.checkpointed; }

/// Reads what the tables say; what cannot be read is named in `damage`. Inside a transaction.
void read_head_tables(Connection& connection, PartHead& head);

/// Reads the head. What cannot be read beyond the tables at the start of the file is named in `damage`; then the counts
/// are what the writer noted, see read_part() for what can really be read.
/// Throws NotAPart, NewerPart, or SqliteError when not even the start can be read.
PartHead read_head(const std::filesystem::path& path, Access access = Access::careful);

}  // namespace tacho::store
