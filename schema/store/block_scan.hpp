#pragma once
// Blocks of a part: where they are, and their answers in order of arrival.

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <string>
#include <vector>

#include "schema/store/answer_query.hpp"
#include "schema/store/block/block_decoder.hpp"
#include "schema/store/part_head.hpp"
#include "schema/store/rows.hpp"

namespace tacho::store {

/// All rows of table block, but for those that are damaged.
struct BlockList {
  std::vector<BlockRow> blocks;
  std::uint64_t bad = 0;
  std::string damage;  ///< why the rest of the table could not be read; empty: it was
};
BlockList list_blocks(Connection& connection, const Vocabulary& vocabulary);

/// Blocks of one source, in order of arrival.
using BlockPlaces = std::deque<BlockRow>;

/// Blocks that a query needs, by source. Damage of the list is named. Counts all moved answers of all robots in `met`.
std::array<BlockPlaces, kSourceCount> block_places(const BlockList& list, const PartHead& head,
                                                   const AnswerQuery& query, StreamCounts& met, const Report& report);

/// Reads blocks from the file.
class BlockFetch {
 public:
  explicit BlockFetch(Connection& connection) : fetch_(connection, "SELECT data FROM block WHERE id = ?1") {}
  /// Opens the block and hands it to `use`, which returns damage. Reports what is wrong, in words.
  void with(const BlockRow& place, Source source, const Report& report,
            const std::function<std::string(BlockDecoder&)>& use);

 private:
  Statement fetch_;
  BlockDecoder decoder_;
};

/// Blocks of a part: where they are, and their answers in order of arrival.
class BlockScan {
 public:
  /// Blocks outside the window are not opened. The arguments must outlive the scan.
  BlockScan(Connection& connection, const BlockList& list, const PartHead& head, const AnswerQuery& query,
            StreamCounts& met, const Report& report);

  /// The place of the next answer among all answers of the part; 0 at the end.
  [[nodiscard]] std::int64_t row() const;
  /// The answer at row(), then goes on. Valid until the next call.
  const Answer& take();

 private:
  /// One source.
  struct Lane {
    Source source = Source::status;
    BlockPlaces blocks;              ///< not yet opened
    std::vector<std::int64_t> rows;  ///< of the open block, those inside the window
    std::vector<Answer> answers;     ///< likewise
    std::size_t next = 0;
  };
  const PartHead* head_;
  const AnswerQuery* query_;
  const Report* report_;
  BlockFetch fetch_;
  std::vector<Lane> lanes_;
  Answer answer_;

  void fill(Lane& lane);
  void load(Lane& lane, const BlockRow& place);
};

}  // namespace tacho::store
