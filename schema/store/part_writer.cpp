#include "schema/store/part_writer.hpp"

#include "schema/store/schema_sql.hpp"
#include "schema/store/seal.hpp"

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

void PartWriter::commit() {
  if (head_changed_) {
    seal_head(connection_);
  }
  commit_.run();
  head_changed_ = false;
}

template <class... Row>
void PartWriter::write_head_row(Statement& statement, const Row&... row) {
  head_changed_ = true;
  write(statement, row...);
}

void PartWriter::put(const Robot& robot) { write_head_row(robot_, robot); }
void PartWriter::put(const Session& session) { write_head_row(session_, session); }
void PartWriter::put(const StreamRow& stream) { write_head_row(stream_, stream); }
void PartWriter::put(const StreamKey& key, const StreamCount& count) { write_head_row(coverage_, key, count); }

void PartWriter::put(const UnknownKey& key) {
  head_changed_ = true;
  unknown_key_.run(key.robot, source_name(key.source), key.key, key.first_us);
}

void PartWriter::set_counted_to(std::int64_t id) {
  head_changed_ = true;
  counted_to_.run(id);
}

void PartWriter::rollback() noexcept {
  head_changed_ = false;
  try {
    if (in_transaction()) {
      connection_.exec("ROLLBACK");
    }
  } catch (const SqliteError&) {
    // SQLite has rolled back by itself, which is what was asked for.
  }
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
