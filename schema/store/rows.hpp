#pragma once
// One write and one read function per table of records. Statements come from insert_sql / select_sql, so
// that the order of columns is the order in schema_sql.cpp.

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "schema/records.hpp"
#include "schema/store/sqlite.hpp"
#include "schema/store/vocabulary.hpp"

namespace tacho::store {

/// A stream as one part knows it.
struct StreamRow {
  Stream stream;
  std::uint64_t seq_from = 0;
};

/// One row of `hot`: answers of one stream, as they arrived between two commits. `data` belongs to somebody else.
struct HotRow {
  std::int64_t id = 0;  ///< place of the first answer among all of the part
  RobotId robot = 0;
  std::int64_t source = 0;  ///< number of the part's code list
  SessionId session = 0;
  std::uint64_t seq = 0;   ///< of the first answer
  Micros t_send_us = 0;    ///< likewise
  std::int64_t base = 0;   ///< 0: a keyframe
  std::uint64_t rows = 0;  ///< answers
  std::int64_t crc = 0;
  std::string_view data;  ///< hot_codec.hpp
};
std::int64_t checksum(const HotRow& row);
inline bool is_whole(const HotRow& row) { return checksum(row) == row.crc; }
/// Empty when the number means nothing here.
std::optional<Source> source_of(const HotRow& row, const Vocabulary& vocabulary);

/// One row of `block`. `data` belongs to somebody else.
struct BlockRow {
  std::int64_t id = 0;
  RobotId robot = 0;
  std::int64_t source = 0;  ///< number of the part's code list
  SessionId session = 0;
  std::uint64_t seq_from = 0;
  std::uint64_t seq_to = 0;
  std::int64_t row_from = 0;
  std::int64_t row_to = 0;
  Micros t_from_us = 0;
  Micros t_to_us = 0;
  std::uint64_t rows = 0;
  std::string_view data;
};

void write(Statement& insert, const Robot& robot);
void write(Statement& insert, const Session& session);
void write(Statement& insert, const StreamRow& stream);
void write(Statement& insert, const HotRow& row);
void write(Statement& insert, const BlockRow& row);
void write(Statement& insert, const Gap& gap);
void write(Statement& insert, const Event& event);
void write(Statement& insert, const ClockPoint& point);
/// `field` and `source`: numbers of the part.
void write(Statement& insert, const Rollup& rollup, std::int64_t source, std::int64_t field);

Robot read_robot(const Statement& row);
Session read_session(const Statement& row);
/// Empty when the source or word order has no meaning here.
std::optional<StreamRow> read_stream(const Statement& row);
/// Anything, where the row is damaged: look at its checksum. `data` is valid until the statement moves on.
HotRow read_hot(const Statement& row);
/// The columns of kBlockPlaces. Empty when the checksum does not fit.
std::optional<BlockRow> read_block_place(const Statement& row);
inline constexpr std::string_view kBlockPlaces =
    "SELECT id, robot, source, session, seq_from, seq_to, row_from, row_to, t_from_us, t_to_us, rows, crc FROM block";
/// Empty when the checksum does not fit, or a name means nothing to this program.
std::optional<Gap> read_gap(const Statement& row);
std::optional<Event> read_event(const Statement& row);
std::optional<ClockPoint> read_clock(const Statement& row);
std::optional<Rollup> read_rollup(const Statement& row, const Vocabulary& vocabulary);

}  // namespace tacho::store
