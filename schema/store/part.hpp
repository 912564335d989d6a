#pragma once
// A part: one SQLite file of a log. Names, creation, opening for writing, closing.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "schema/sample.hpp"
#include "schema/store/sqlite.hpp"

namespace tacho::store {

/// The one row of the `part` table.
struct PartRow {
  std::string log;  ///< 32 hex digits, the same in all parts of a log
  std::uint32_t number = 0;
  std::string software;
  bool closed = false;
  std::int64_t counted_to = 0;
  std::optional<Micros> ended_us;  ///< when it was closed, by a clock known to be right
};
PartRow read_part_row(Connection& connection);

/// A new identity for a log.
std::string random_log_id();

struct PartFile {
  std::uint32_t number = 0;
  std::filesystem::path path;
};
/// Files named part-000001.db and so on, by number.
std::vector<PartFile> list_parts(const std::filesystem::path& folder);
std::filesystem::path part_path(const std::filesystem::path& folder, std::uint32_t number);

/// What was created in, renamed in or removed from a folder is durable once the folder itself is on disk. Throws Error.
void sync_folder(const std::filesystem::path& folder);

/// Creates a part under a hidden name, with all tables, the vocabulary and the part row, and syncs it.
std::filesystem::path prepare_part(const std::filesystem::path& folder, const PartRow& row);
/// Adds what `fill` writes to a prepared part and gives it its name once that is on disk, so that a part in the folder
/// always has its head.
std::filesystem::path finish_part(const std::filesystem::path& prepared, const std::function<void(Connection&)>& fill);
/// Removes what a kill left behind: prepared parts, and files beside parts that are gone. The folder must be locked.
void remove_unfinished_parts(const std::filesystem::path& folder);

/// WAL, own checkpoints; `durable` = synchronous FULL, else OFF.
Connection open_part_for_writing(const std::filesystem::path& path, bool durable);

/// Marks the part as one that is written on.
void reopen_part(Connection& connection);

/// Marks the part closed, seals it (seal.hpp), writes its summary (summary.hpp), checkpoints it and leaves journal_mode
/// DELETE, so that it can be read from a read-only folder. `now_us`: the wall clock when it is known to be right. False
/// when a reader is in the way: try again later.
bool close_part(Connection& connection, std::optional<Micros> now_us);

}  // namespace tacho::store
