#pragma once
// Consecutive answers of one stream -> one block (README.md describes the format).
//
// Every block is decoded again before it is given away and compared byte for byte; an answer that would not come back
// exactly is kept as it is. Answers without a shape (no JSON object, no register image) are kept as they are anyway.
//
// Thread rule: one thread per object.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "schema/records.hpp"
#include "schema/sample.hpp"
#include "schema/store/block/column.hpp"

namespace tacho::store {

struct BlockOptions {
  /// Longer blocks are smaller (600 against 60: a third less; 1800 against 600: 6 %), faster to scan, and cost more
  /// memory while they are made: the bodies, and about as much again. At most kMaxBlockRows.
  std::size_t rows = 1800;
  /// zstd level of the pieces; above 3 costs much time for little.
  int level = 3;
  /// How the robot's registers hold two-word values. Wrong only costs space; it is kept in the head.
  WordOrder order = WordOrder::cdab;
};

class BlockEncoder {
 public:
  explicit BlockEncoder(const BlockOptions& options = {});

  /// False, and nothing is taken: the answer is of another stream (robot, source, session) than those before, or the
  /// block is full. Call finish() and add it again. The first answer of a block is always taken. `place`: a number of
  /// the caller's, kept with the answer (its place among all answers of the part).
  [[nodiscard]] bool add(const Answer& answer, std::int64_t place = 0);
  [[nodiscard]] std::size_t rows() const { return answers_.size(); }

  /// The block of the answers added, which are then forgotten. Empty when there were none.
  std::string finish();

  /// Of the last block.
  struct Stats {
    std::size_t shapes = 0;
    std::size_t raw_rows = 0;     ///< kept as they are
    std::size_t unlike_rows = 0;  ///< of those: taken apart, but would not have come back exactly
  };
  [[nodiscard]] const Stats& stats() const { return stats_; }

 private:
  BlockOptions options_;
  std::vector<Answer> answers_;
  std::vector<std::int64_t> places_;
  std::size_t bytes_ = 0;
  Stats stats_;

  std::string build(const std::vector<bool>& keep_raw);
  [[nodiscard]] std::vector<bool> unlike(const std::string& block) const;
};

}  // namespace tacho::store
