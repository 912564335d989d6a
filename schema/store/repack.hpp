#pragma once
// Moving answers from hot rows into blocks.

#include <chrono>
#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "schema/store/block/block_encoder.hpp"
#include "schema/store/coverage.hpp"
#include "schema/store/decode.hpp"
#include "schema/store/hot_codec.hpp"
#include "schema/store/manifest.hpp"
#include "schema/store/part_writer.hpp"
#include "schema/store/rollup.hpp"

namespace tacho::store {

/// Which rows of a part are hot, by stream, oldest first. Follows the writer's transactions.
class HotLedger {
 public:
  /// What one row has, or several.
  struct Sums {
    std::uint64_t answers = 0;
    std::uint64_t bytes = 0;   ///< of the bodies as received
    std::uint64_t stored = 0;  ///< in the part
    Micros first_us = 0;
    Micros last_us = 0;  ///< of the row that was added last
  };
  /// `stored`: bytes of the row's data.
  static Sums sums_of(const std::vector<HotMark>& marks, std::uint64_t stored);
  void add(const StreamKey& key, std::int64_t id, Sums row);
  void commit();
  void roll_back();
  /// Rows a part already has.
  void load(Connection& connection, const Vocabulary& vocabulary);

  /// Streams whose rows are to move together. None until one has enough for a good block, or all together take too much
  /// room; then every stream for which a block is worth while.
  [[nodiscard]] std::vector<StreamKey> due() const;
  /// All streams with rows.
  [[nodiscard]] std::vector<StreamKey> all() const;
  /// Rows of one stream.
  struct Rows {
    std::vector<std::int64_t> ids;
    Sums sums;
  };
  [[nodiscard]] const Rows& rows(const StreamKey& key) const { return streams_.at(key); }
  /// The oldest rows of a stream have moved: those that rows() were.
  void forget(const StreamKey& key, const Rows& moved);
  [[nodiscard]] bool empty() const { return streams_.empty(); }
  /// Room that all rows take in the part.
  [[nodiscard]] std::uint64_t stored() const;

  // A block of fewer answers costs more per answer, one of more saves little (see README) and takes longer to make.
  static constexpr std::uint64_t kGoodAnswers = 600;
  static constexpr Micros kGoodSpanUs = 1'800'000'000;
  static constexpr std::uint64_t kWorthwhileAnswers = 150;
  static constexpr std::uint64_t kMostAnswers = 16384;
  static constexpr std::uint64_t kMostBytes = 16u << 20;   ///< of bodies; they are all in memory while a block is made
  static constexpr std::uint64_t kMostStored = 16u << 20;  ///< of all streams: what moves together is in memory, packed

 private:
  static constexpr std::uint64_t kRowBytes = 40;  ///< columns and b-tree of a row beside its data

  struct Stream : Rows {
    std::size_t committed_ids = 0;
    Sums committed;
  };
  std::map<StreamKey, Stream> streams_;
};

using Deadline = std::chrono::steady_clock::time_point;
inline constexpr Deadline kNoDeadline = Deadline::max();

/// Moves hot rows into blocks: the rows of many streams at once, because they share pages. A page all of whose rows go
/// in one transaction is freed; one that loses the rows of one stream after the other is written again each time.
/// Making the blocks takes seconds when there are many robots, so it is done in portions, in memory; only store() needs
/// a transaction. Every answer is in exactly one tier at any moment.
///
/// begin() -> pack() until it is true -> store() and commit -> stored(); again from pack() while busy(). No row that is
/// written after begin() may be based on a row from before.
///
/// Memory: the bodies of one block, kMostPacked of blocks, the ids of the rows. One thread.
class Repacker {
 public:
  /// With `decode`, one-minute rollups of what is in the blocks are made, too.
  Repacker(int zstd_level, Decode decode) : level_(zstd_level), decode_(std::move(decode)) {}

  /// Takes the rows these streams have now.
  void begin(const HotLedger& hot, const std::vector<StreamKey>& streams);
  [[nodiscard]] bool busy() const { return !waiting_.empty() || !packed_.empty(); }
  /// Makes the blocks of one stream, and of more until `until` has passed. True when store() is to follow. Throws
  /// SqliteError.
  bool pack(Connection& connection, Deadline until);
  /// Writes the blocks and deletes their rows, inside the open transaction. Rows that are damaged stay where they are.
  /// Throws SqliteError.
  void store(PartWriter& part) const;
  /// The transaction of store() is committed.
  void stored(HotLedger& hot);
  /// Whatever was begun is not done.
  void drop();

 private:
  struct Block {
    BlockRow row;
    std::string data;
  };
  struct Waiting {
    StreamKey key;
    HotLedger::Rows rows;
  };
  struct Packed {
    Waiting from;                   ///< damaged rows too
    std::vector<std::int64_t> ids;  ///< of rows that are in the blocks
    std::vector<Block> blocks;
    Rollups rollups;
    Manifest manifest;
  };
  static constexpr std::uint64_t kMostPacked = 32u << 20;

  int level_;
  Decode decode_;
  std::vector<Waiting> waiting_;  // last first
  std::vector<Packed> packed_;
  std::uint64_t packed_bytes_ = 0;

  [[nodiscard]] Packed pack(Connection& connection, Waiting from) const;
};

}  // namespace tacho::store
