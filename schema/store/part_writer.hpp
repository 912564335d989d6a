#pragma once
// The part that is being written: its connection and the statements the writer needs, prepared once.

#include <filesystem>

#include "schema/row_source.hpp"
#include "schema/store/coverage.hpp"
#include "schema/store/part.hpp"
#include "schema/store/rows.hpp"
#include "schema/store/sqlite.hpp"

namespace tacho::store {

class PartWriter {
 public:
  PartWriter(const std::filesystem::path& path, bool durable);
  PartWriter(const PartWriter&) = delete;
  PartWriter& operator=(const PartWriter&) = delete;

  void begin() { begin_.run(); }
  /// Renews the seal where a small table has changed.
  void commit();
  /// Never throws; without a transaction it does nothing.
  void rollback() noexcept;
  [[nodiscard]] bool in_transaction() const { return connection_.in_transaction(); }

  void put(const HotRow& row) { write(hot_, row); }
  void put(const BlockRow& row) { write(block_, row); }
  void put(const Gap& gap) { write(gap_, gap); }
  void put(const Event& event) { write(event_, event); }
  void put(const ClockPoint& point) { write(clock_, point); }
  // Small tables.
  void put(const Robot& robot);
  void put(const Session& session);
  void put(const StreamRow& stream);
  void put(const StreamKey& key, const StreamCount& count);
  void put(const UnknownKey& key);
  void set_counted_to(std::int64_t id);
  /// The end of the latest gap of a stream in sessions before `session`; 0 when there is none in this part.
  Micros last_gap_end(RobotId robot, Source source, SessionId session);

  /// Bytes of the database with what is still in the WAL.
  std::uint64_t bytes();
  /// Bytes of the WAL that are not in the database yet, after the last commit.
  [[nodiscard]] std::uint64_t wal_bytes() const {
    return static_cast<std::uint64_t>(connection_.wal_pages()) * page_size_;
  }
  Connection& connection() { return connection_; }

 private:
  Connection connection_;
  Statement begin_;
  Statement commit_;
  Statement robot_;
  Statement session_;
  Statement stream_;
  Statement hot_;
  Statement block_;
  Statement gap_;
  Statement event_;
  Statement clock_;
  Statement coverage_;
  Statement unknown_key_;
  Statement counted_to_;
  Statement pages_;
  std::uint64_t page_size_;
  bool head_changed_ = false;  ///< in the open transaction

  template <class... Row>
  void write_head_row(Statement& statement, const Row&... row);
};

}  // namespace tacho::store
