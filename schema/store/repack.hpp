#pragma once
// Moving answers from hot rows into blocks.

#include <chrono>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "schema/store/block/block_encoder.hpp"
#include "schema/store/coverage.hpp"
#include "schema/store/decode.hpp"
#include "schema/store/part_writer.hpp"

namespace tacho::store {

/// Which rows of a part are hot, by stream, oldest first. Follows the writer's transactions.
class HotLedger {
 public:
  void add(const StreamKey& key, std::int64_t id, Micros t_us, std::uint64_t bytes);
  void commit();
  void roll_back();
  /// Rows a part already has.
  void load(Connection& connection, const Vocabulary& vocabulary);

  /// A stream that has enough rows for a good block; of several the one with most.
  [[nodiscard]] std::optional<StreamKey> due() const;
  /// Any stream with rows.
  [[nodiscard]] std::optional<StreamKey> any() const;
  [[nodiscard]] std::span<const std::int64_t> rows(const StreamKey& key) const;
  void forget(const StreamKey& key) { streams_.erase(key); }
  [[nodiscard]] bool empty() const { return streams_.empty(); }

  // A block of fewer rows costs more per answer, one of more saves little (see README) and takes longer to make.
  static constexpr std::size_t kGoodRows = 600;
  static constexpr Micros kGoodSpanUs = 1'800'000'000;
  static constexpr std::size_t kMostRows = 16384;
  static constexpr std::uint64_t kMostBytes = 16u << 20;  ///< of bodies; they are all in memory while a block is made

 private:
  struct Rows {
    std::vector<std::int64_t> ids;
    std::size_t committed = 0;
    Micros first_us = 0;
    Micros last_us = 0;
    std::uint64_t bytes = 0;
  };
  std::map<StreamKey, Rows> streams_;
};

/// Makes blocks, and with `decode` one-minute rollups of what is in them. Memory: the bodies of one block. One thread.
class Repacker {
 public:
  Repacker(int zstd_level, Decode decode) : level_(zstd_level), decode_(std::move(decode)) {}

  /// Moves `ids`, all hot rows of one stream, into blocks and deletes them, inside the open transaction. Rows that are
  /// damaged stay where they are. Throws SqliteError.
  void move(PartWriter& part, const StreamKey& key, std::span<const std::int64_t> ids);

 private:
  int level_;
  Decode decode_;
};

using Deadline = std::chrono::steady_clock::time_point;
inline constexpr Deadline kNoDeadline = Deadline::max();

/// Moves hot rows of a part that is no longer written, stream by stream in transactions of their own, until `until` has
/// passed. True when none are left.
bool move_all(PartWriter& part, HotLedger& ledger, Repacker& repacker, Deadline until);

}  // namespace tacho::store
