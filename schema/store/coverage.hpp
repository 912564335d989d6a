#pragma once
// What a part holds of each stream, as counts: written by the writer now and then, completed from newer rows on
// reading.

#include <compare>
#include <cstdint>
#include <map>

#include "schema/row_source.hpp"
#include "schema/store/rows.hpp"
#include "schema/store/sqlite.hpp"
#include "schema/store/vocabulary.hpp"

namespace tacho::store {

struct StreamKey {
  SessionId session = 0;
  RobotId robot = 0;
  Source source = Source::status;
  friend auto operator<=>(const StreamKey&, const StreamKey&) = default;
};

/// Counts of one stream in one part.
struct StreamCount {
  std::uint64_t stored = 0;
  std::uint64_t bytes = 0;
  std::uint64_t undecodable = 0;
  Micros first_us = 0;
  Micros last_us = 0;  ///< may come from an earlier part while stored is 0
  std::uint64_t next_seq = 0;
  FieldSet seen;
  FieldSet valued;

  void add(const AnswerMeta& meta, std::uint64_t length);
};
using StreamCounts = std::map<StreamKey, StreamCount>;

/// Gap rows of one stream in one part.
struct GapCount {
  std::uint64_t missed = 0;
  std::uint64_t partial = 0;
  std::uint64_t next_seq = 0;  ///< after the last missed poll
  Micros last_us = 0;          ///< end of the latest
  GapSums sums;
};
using GapCounts = std::map<StreamKey, GapCount>;
/// Rows whose checksum is wrong are left out.
struct GapReading {
  GapCounts counts;
  std::int64_t rows = 0;  ///< all that were read
  std::uint64_t bad = 0;
};
GapReading read_gap_counts(Connection& connection);

void write(Statement& replace, const StreamKey& key, const StreamCount& count);
StreamCounts read_coverage_rows(Connection& connection, const Vocabulary& vocabulary);
/// Adds the answers of hot rows with id > `after`, without opening their bodies; those of damaged rows are left out.
/// Returns the place of the newest answer of the part, `after` when there are none.
std::int64_t add_hot_rows(Connection& connection, const Vocabulary& vocabulary, std::int64_t after,
                          StreamCounts& counts);

}  // namespace tacho::store
