#include "schema/store/part_writer.hpp"

#include "schema/store/schema_sql.hpp"

namespace tacho::store {

PartWriter::PartWriter(const std::filesystem::path& path, bool durable)
    : connection_(open_part_for_writing(path, durable)),
      begin_(connection_, "BEGIN IMMEDIATE"),
      commit_(connection_, "COMMIT"),
      robot_(connection_, insert_sql("robot", "OR REPLACE")),
      session_(connection_, insert_sql("session", "OR REPLACE")),
      stream_(connection_, insert_sql("stream", "OR REPLACE")),
      hot_(connection_, insert_sql("hot")),
      block_(connection_, insert_sql("block")),
      gap_(connection_, insert_sql("gap")),
      event_(connection_, insert_sql("event")),
      clock_(connection_, insert_sql("clock")),
      coverage_(connection_, insert_sql("coverage", "OR REPLACE")),
      unknown_key_(connection_, insert_sql("unknown_key", "OR IGNORE")),
      counted_to_(connection_, "UPDATE part SET counted_to = ?1"),
      pages_(connection_, "PRAGMA page_count"),
      page_size_(static_cast<std::uint64_t>(connection_.integer("PRAGMA page_size"))) {}

void PartWriter::rollback() noexcept {
  try {
    if (in_transaction()) {
      connection_.exec("ROLLBACK");
    }
  } catch (const SqliteError&) {
    // SQLite has rolled back by itself, which is what was asked for.
  }
}

void PartWriter::put(const UnknownKey& key) {
  unknown_key_.run(key.robot, source_name(key.source), key.key, key.first_us);
}

Micros PartWriter::last_gap_end(RobotId robot, Source source, SessionId session) {
  Statement statement(connection_, "SELECT max(t_to_us) FROM gap WHERE robot = ?1 AND source = ?2 AND session < ?3");
  statement.query(robot, source_name(source), session);
  return statement.step() ? statement.integer(0) : 0;
}

std::uint64_t PartWriter::bytes() {
  pages_.query();
  const std::uint64_t pages = pages_.step() ? static_cast<std::uint64_t>(pages_.integer(0)) : 0;
  pages_.reset();
  return pages * page_size_;
}

}  // namespace tacho::store
