#pragma once
// The answers of one robot in one part as columns: blocks as a whole, hot rows as they are decoded.

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <vector>

#include "schema/batch_builder.hpp"
#include "schema/store/block_scan.hpp"
#include "schema/store/decode.hpp"
#include "schema/store/hot_answers.hpp"
#include "schema/store/order_guard.hpp"

namespace tacho::store {

/// Consecutive answers of one stream, decoded with every gate open.
struct Chunk {
  SessionId session = 0;
  std::vector<std::int64_t> place;  ///< among all answers of the part, ascending
  Batch batch;
};

/// What to read, and how. Must outlive its scans; one for all parts of a reading.
struct ColumnQuery {
  AnswerQuery answers;
  std::array<FieldSet, kSourceCount> wanted;
  const Decoders* decoders = nullptr;
  std::function<const Stream&(const AnswerMeta&)> stream_of;
  OrderGuard order;
};

class ColumnScan {
 public:
  /// The arguments must outlive the scan.
  ColumnScan(Connection& connection, const BlockList& list, const PartHead& head, ColumnQuery& query, StreamCounts& met,
             const Report& report);

  /// The next rows of a source that begin before the place `before`; false when there are none.
  bool next(Source source, std::int64_t before, Chunk& chunk);

 private:
  struct Lane {
    BlockPlaces blocks;                ///< not yet opened
    std::deque<Chunk> hot;             ///< decoded, not yet handed out
    BatchBuilder builder;              ///< of hot rows
    std::vector<std::int64_t> places;  ///< likewise
    SessionId session = 0;             ///< likewise
    std::int64_t last_place = 0;       ///< of the rows handed out
  };
  const PartHead* head_;
  ColumnQuery* query_;
  const Report* report_;
  HotAnswers hot_;
  BlockFetch fetch_;
  std::vector<Lane> lanes_;  ///< by source
  Sample sample_;

  Lane& lane(Source source) { return lanes_[static_cast<std::size_t>(source)]; }
  void load(Source source, const BlockRow& place, Chunk& chunk);
  bool load_columns(BlockDecoder& block, const BlockRow& place, Source source, Chunk& chunk, std::string& damage);
  std::string load_rows(BlockDecoder& block, Source source, Chunk& chunk);
  bool all_good(AnswerMeta meta, const Chunk& chunk);
  void keep_good_rows(Source source, Chunk& chunk);
  void decode(const Answer& answer);
  void pull_hot();
  void flush_hot(Lane& lane);
};

}  // namespace tacho::store
