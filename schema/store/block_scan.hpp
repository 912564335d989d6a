#pragma once
// Blocks of a part: where they are, and their answers in order of arrival.

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
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

/// What opening blocks needs. Best kept from part to part and from reading to reading: the decoder remembers shapes.
struct BlockTools {
  BlockDecoder decoder;
  std::unique_ptr<char[]> bytes;  ///< of StoredBlock
  std::size_t room = 0;           ///< in `bytes`
};

/// The bytes of one block after the other, read from the file as they are asked for: nobody needs all columns of a
/// block, and copying a block takes as long as decoding six of them.
class StoredBlock final : public BlockBytes {
 public:
  /// The tools must outlive this.
  StoredBlock(Connection& connection, BlockTools& tools) : data_(connection, "block", "data"), tools_(&tools) {}
  /// Goes to a block. What at() gave before is gone. False: it is not there.
  [[nodiscard]] bool seek(std::int64_t id);
  [[nodiscard]] std::size_t size() const override { return data_.size(); }
  [[nodiscard]] std::string_view at(std::size_t offset, std::size_t length) override;

 private:
  BlobColumn data_;
  BlockTools* tools_;      ///< whose bytes are those of the block, each at its place; only what was asked for is there
  std::size_t known_ = 0;  ///< all before are there
};

/// Reads blocks from the file.
class BlockFetch {
 public:
  /// The tools must outlive this.
  BlockFetch(Connection& connection, BlockTools& tools) : bytes_(connection, tools), decoder_(&tools.decoder) {}
  /// Opens the block and hands it to `use`, which returns damage. Reports what is wrong, in words.
  void with(const BlockRow& place, Source source, const Report& report,
            const std::function<std::string(BlockDecoder&)>& use);

 private:
  StoredBlock bytes_;
  BlockDecoder* decoder_;
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
  BlockTools tools_;
  BlockFetch fetch_;
  std::vector<Lane> lanes_;
  Answer answer_;

  void fill(Lane& lane);
  void load(Lane& lane, const BlockRow& place);
};

}  // namespace tacho::store
