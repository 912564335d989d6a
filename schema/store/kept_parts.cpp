#include "schema/store/kept_parts.hpp"

#include <algorithm>
#include <array>

#include "schema/store/part_head.hpp"
#include "schema/store/schema_sql.hpp"

namespace tacho::store {

namespace {

namespace fs = std::filesystem;

// Of each stream the polls planned so far, in all sessions of the part; the longest tells how long was recorded.
constexpr const char* kRecordedSql =
    "SELECT ifnull(max(us), 0) FROM (SELECT sum((c.next_seq - s.seq_from) * s.period_us) AS us FROM coverage AS c "
    "JOIN stream AS s USING (session, robot, source) WHERE c.stored > 0 GROUP BY c.robot, c.source)";

void read_times(Connection& connection, KeptPart& part) {
  Statement row(connection, "SELECT ifnull(min(first_us), 0), ifnull(max(last_us), 0) FROM coverage WHERE stored > 0");
  if (row.step()) {
    part.first_us = row.integer(0);
    part.last_us = row.integer(1);
  }
  part.recorded_us = std::max<Micros>(0, connection.integer(kRecordedSql));
}

}  // namespace

std::uint64_t part_file_bytes(const fs::path& part) {
  std::uint64_t bytes = 0;
  for (const char* suffix : {"", "-wal", "-journal"}) {
    std::error_code missing;
    const auto size = fs::file_size(part.string() + suffix, missing);
    bytes += missing ? 0 : size;
  }
  return bytes;
}

std::optional<KeptPart> read_kept_part(const PartFile& file, const std::string& log) {
  KeptPart part;
  part.number = file.number;
  part.path = file.path;
  part.bytes = part_file_bytes(file.path);
  try {
    Connection connection = open_part_for_reading(file.path);
    if (connection.integer("PRAGMA application_id") != kApplicationId ||
        connection.integer("PRAGMA user_version") > kSchemaVersion) {
      return std::nullopt;
    }
    const PartRow row = read_part_row(connection);
    if (row.log.empty() || (!log.empty() && row.log != log)) {
      return std::nullopt;
    }
    part.closed = row.closed;
    part.ended_us = row.ended_us;
    read_times(connection, part);
  } catch (const SqliteError& error) {
    if (error.foreign()) {
      return std::nullopt;
    }
  } catch (const Error&) {
    // What a killed recorder left in a read-only folder.
  }
  return part;
}

std::vector<KeptPart> read_kept_parts(const fs::path& folder) {
  std::vector<KeptPart> parts;
  for (const PartFile& file : list_parts(folder)) {
    if (std::optional<KeptPart> part = read_kept_part(file, "")) {
      parts.push_back(std::move(*part));
    }
  }
  return parts;
}

std::optional<std::uint64_t> free_disk_bytes(const fs::path& folder) {
  std::error_code error;
  const fs::space_info space = fs::space(folder, error);
  return error ? std::nullopt : std::optional<std::uint64_t>(space.available);
}

void remove_part(const fs::path& part) {
  std::error_code error;
  fs::remove(part, error);
  if (error) {
    throw Error(part.string(), "cannot be removed: " + error.message(), "give this user the right to write its folder");
  }
  for (const char* suffix : {"-wal", "-shm", "-journal"}) {
    fs::remove(part.string() + suffix, error);
  }
  try {
    sync_folder(part.parent_path());
  } catch (const Error&) {
    // After a power cut it may be there again, and goes again.
  }
}

}  // namespace tacho::store
