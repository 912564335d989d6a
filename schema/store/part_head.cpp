#include "schema/store/part_head.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <optional>
#include <utility>

#include "schema/store/scavenge.hpp"
#include "schema/store/schema_sql.hpp"
#include "schema/store/summary.hpp"

namespace tacho::store {

namespace {

namespace fs = std::filesystem;

bool has_wal(const fs::path& path) {
  std::error_code missing;
  const auto size = fs::file_size(path.string() + "-wal", missing);
  return !missing && size > 0;
}

NotAPart foreign(const fs::path& path, const std::string& why) {
  return {path.string(), why,
          may_be_part(path) ? "it is damaged: tacho-analyzer recover LOG -o NEW looks for its rows in its pages"
                            : "it is not a part of a log: move it out of the folder"};
}

/// Throws when the file is not ours to read.
void identify(Connection& connection, const fs::path& path) {
  const std::int64_t application = connection.integer("PRAGMA application_id");
  if (application != kApplicationId) {
    throw foreign(path, fmt::format("is an SQLite database of another program (application id {})", application));
  }
  const std::int64_t version = connection.integer("PRAGMA user_version");
  if (version > kSchemaVersion) {
    throw NewerPart(path.string(),
                    fmt::format("was written by a newer tachograph (log version {}, this one reads up to {})", version,
                                kSchemaVersion),
                    "update tachograph");
  }
}

Connection open_identified(const fs::path& path, Access access) {
  std::error_code missing;
  if (fs::file_size(path, missing) == 0 && !missing && !has_wal(path)) {
    throw foreign(path, "is empty (0 bytes)");
  }
  try {
    Connection connection = open_part_for_reading(path, access);
    identify(connection, path);
    return connection;
  } catch (const SqliteError& error) {
    if (error.foreign()) {
      throw foreign(path, "is not an SQLite database");
    }
    throw;
  }
}

template <class Row, class Read>
std::vector<Row> read_all(Connection& connection, const std::string& table, Read read) {
  std::vector<Row> rows;
  Statement statement(connection, select_sql(table));
  while (statement.step()) {
    rows.push_back(read(statement));
  }
  return rows;
}

std::vector<StreamRow> read_streams(Connection& connection) {
  std::vector<StreamRow> rows;
  Statement statement(connection, select_sql("stream"));
  while (statement.step()) {
    if (auto row = read_stream(statement)) {
      rows.push_back(std::move(*row));
    }
  }
  return rows;
}

std::vector<UnknownKey> read_unknown_keys(Connection& connection) {
  std::vector<UnknownKey> keys;
  Statement row(connection, select_sql("unknown_key"));
  while (row.step()) {
    UnknownKey key{static_cast<RobotId>(row.integer(0)), Source::status, row.text(2), row.integer(3)};
    if (parse_source(row.bytes(1), key.source)) {
      keys.push_back(std::move(key));
    }
  }
  return keys;
}

/// Runs `read`; damage is named instead of thrown.
template <class Read>
bool survive(PartHead& head, const char* what, Read read) {
  try {
    read();
    return true;
  } catch (const SqliteError& error) {
    if (!error.damaged()) {
      throw;
    }
    head.damage.push_back(fmt::format("{} cannot be read: {}", what, error.what()));
    return false;
  }
}

/// The largest id that can be reached when the last page of the table cannot: a power of two above all that can.
constexpr std::int64_t kUnknownEnd = std::int64_t{1} << 40;

void read_ends(Connection& connection, PartHead& head) {
  const auto end_of = [&](const char* column, const char* table, std::int64_t& end) {
    end = kUnknownEnd;
    survive(head, table, [&] { end = connection.integer(fmt::format("SELECT max({}) FROM {}", column, table)); });
  };
  end_of("id", "gap", head.ends.gap);
  end_of("id", "event", head.ends.event);
  end_of("id", "clock", head.ends.clock);
}

void read_counts(Connection& connection, PartHead& head) {
  survive(head, "the coverage table", [&] { head.counts = read_coverage_rows(connection, head.vocabulary); });
  survive(head, "the table of unknown keys", [&] { head.unknown_keys = read_unknown_keys(connection); });
  const bool whole = head.damage.empty();
  head.ends.row = kUnknownEnd;
  survive(head, "the newest answers", [&] {
    StreamCounts counts = head.counts;
    // Answers are counted before they move into blocks: all that are newer are hot.
    head.ends.row = add_hot_rows(connection, head.vocabulary, head.row.counted_to, counts);
    if (whole) {
      head.counts = std::move(counts);
    }
  });
  GapReading gaps;
  survive(head, "the table of gaps", [&] { gaps = read_gap_counts(connection); });
  head.gaps = std::move(gaps.counts);
  if (gaps.bad > 0) {
    head.damage.push_back(fmt::format("{} gap rows are damaged", gaps.bad));
  }
  if (const auto sealed = head.sealed_rows.find("gap");
      sealed != head.sealed_rows.end() && sealed->second != gaps.rows) {
    head.damage.push_back(fmt::format("{} gap rows were read, but there were {}", gaps.rows, sealed->second));
  }
}

}  // namespace

Connection open_part_for_reading(const fs::path& path, Access access) {
  const auto opened = [&](OpenMode mode) {
    Connection connection(path, mode);
    // First of all: without it SQLite refuses to look into a file that is shorter than its header says.
    connection.exec("PRAGMA writable_schema = ON");
    connection.scalar("PRAGMA schema_version");  // touches the file, so that a refusal comes here
    connection.exec("PRAGMA cache_size = -4096");
    if (access == Access::fast) {
      connection.exec("PRAGMA mmap_size = 1073741824");
    }
    return connection;
  };
  try {
    return opened(OpenMode::read);
  } catch (const SqliteError& error) {
    if (!error.cannot_open() || !fs::exists(path)) {
      throw;
    }
    if (has_wal(path)) {
      throw Error(path.string(), "was not closed, and its folder is read-only, so its WAL file cannot be read",
                  "copy the folder to a place where this user may write, and read it there");
    }
  }
  // In WAL mode, but without a WAL nobody writes it: a recorder always has one.
  return opened(OpenMode::immutable);
}

void read_head_tables(Connection& connection, PartHead& head) {
  survive(head, "the table of robots", [&] { head.robots = read_all<Robot>(connection, "robot", read_robot); });
  survive(head, "the table of sessions",
          [&] { head.sessions = read_all<Session>(connection, "session", read_session); });
  survive(head, "the table of streams", [&] { head.streams = read_streams(connection); });
  head.vocabulary = read_vocabulary(connection);
  read_ends(connection, head);
  read_counts(connection, head);
}

PartHead read_head(const fs::path& path, Access access) {
  if (access == Access::fast) {
    if (std::optional<PartHead> head = read_summary(path)) {
      return std::move(*head);
    }
  }
  PartHead head;
  head.path = path;
  Connection connection = open_identified(path, access);
  connection.exec("BEGIN");
  const Connection::FileSize size = connection.file_size();
  head.file_bytes = size.actual;
  if (size.promised > size.actual && !has_wal(path)) {
    head.damage.push_back(fmt::format("is cut short: {} of {} bytes are there", size.actual, size.promised));
  }
  head.version = connection.integer("PRAGMA user_version");
  head.row = read_part_row(connection);
  if (head.row.log.empty()) {
    throw NotAPart(path.string(), "has no part row", "it was never finished: move it out of the folder");
  }
  Seal seal = check_seal(connection, head.row.closed, access == Access::careful);
  head.sealed_rows = std::move(seal.rows);
  std::move(seal.damage.begin(), seal.damage.end(), std::back_inserter(head.damage));
  head.checkpointed = connection.scalar("PRAGMA journal_mode") != "wal";
  read_head_tables(connection, head);
  if (access == Access::careful && head.row.closed && head.damage.empty()) {
    if (std::string wrong = check_summary(connection, head); !wrong.empty()) {
      head.damage.push_back(std::move(wrong));
    }
  }
  // The transaction ends with the connection: COMMIT itself fails on a truncated file.
  return head;
}

}  // namespace tacho::store
