#pragma once
// The answers of one robot in one part as columns: blocks as a whole, hot rows as they are decoded.

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <utility>
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
  Micros t_min_us = 0;  ///< of t_send
  Micros t_max_us = 0;
};

/// What to read, and how. Must outlive its scans; one for all parts of a reading.
struct ColumnQuery {
  AnswerQuery answers;
  std::array<FieldSet, kSourceCount> wanted;
  const Decoders* decoders = nullptr;
  BlockTools* blocks = nullptr;
  std::function<const Stream&(const AnswerMeta&)> stream_of;
  OrderGuard order;
  std::array<Batch, kSourceCount> spare;  ///< batches that nobody needs any more
};

class ColumnScan {
 public:
  /// The arguments must outlive the scan.
  ColumnScan(Connection& connection, const BlockList& list, const PartHead& head, ColumnQuery& query, StreamCounts& met,
             const Report& report);

  /// The next rows of a source that begin before the place `before`; false when there are none. `chunk` may be any: its
  /// memory is used again.
  bool next(Source source, std::int64_t before, Chunk& chunk);
  /// The memory of a batch that next() gave serves one to come.
  void recycle(Batch&& batch) { query_->spare[static_cast<std::size_t>(batch.source)] = std::move(batch); }

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
  bool in_order(const Chunk& chunk, std::int64_t last_place) const;
  bool all_good(AnswerMeta meta, const Chunk& chunk);
  void keep_good_rows(Source source, Chunk& chunk);
  void decode(const Answer& answer);
  void pull_hot();
  void flush_hot(Lane& lane);
};

}  // namespace tacho::store
