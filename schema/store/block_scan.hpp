#pragma once
// The answers of one robot that were moved into blocks, in order of arrival.

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <string>
#include <vector>

#include "schema/store/block/block_decoder.hpp"
#include "schema/store/part_head.hpp"
#include "schema/store/rows.hpp"

namespace tacho::store {

class BlockScan {
 public:
  /// Told of damage, in words.
  using Report = std::function<void(const std::string&)>;

  /// Blocks outside `window` are not opened. Counts all moved answers of all robots in `met`. `connection`, `head` and
  /// `report` must outlive the scan.
  BlockScan(Connection& connection, const PartHead& head, RobotId robot, const std::array<bool, kSourceCount>& sources,
            Window window, StreamCounts& met, const Report& report);

  /// The place of the next answer among all answers of the part; 0 at the end.
  [[nodiscard]] std::int64_t row() const;
  /// The answer at row(), then goes on. Valid until the next call.
  const Answer& take();

 private:
  /// One source.
  struct Lane {
    Source source = Source::status;
    std::deque<BlockRow> blocks;     ///< not yet opened, in order
    std::vector<std::int64_t> rows;  ///< of the open block, those inside the window
    std::vector<Answer> answers;     ///< likewise
    std::size_t next = 0;
  };
  const PartHead* head_;
  const Report* report_;
  Statement fetch_;
  std::vector<Lane> lanes_;
  Answer answer_;
  BlockDecoder decoder_;
  RobotId robot_;
  Window window_;

  void fill(Lane& lane);
  void load(Lane& lane, const BlockRow& place);
};

}  // namespace tacho::store
