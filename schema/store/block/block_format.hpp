#pragma once
// Head and directory of a block. FORMAT.md has the bytes.
//
//   head       kBlockHeadBytes, fixed, little-endian; with the checksum of head and directory
//   directory  columns; frame of the shapes; frame of the constants; then, for each column that is not constant, how
//              many constant ones stand before it, and its entry
//   frames     shapes, constants, columns: shortest first, those of the parts of a composite counted and stored with
//              it, equal ones in the order of the directory. Nearly all that analyses ask for is short, so reading six
//              columns touches the first eighth of a block.
//
// Columns 0 to kRowColumns - 1 belong to the rows, the others to the leaves of the shapes in the order of ShapeTable.

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "schema/records.hpp"
#include "schema/store/block/column.hpp"

namespace tacho::store {

inline constexpr std::string_view kBlockMagic = "TACHOBLK";
inline constexpr std::uint8_t kBlockVersion = 1;
inline constexpr std::size_t kBlockHeadBytes = 76;
/// More rows in one block are damage.
inline constexpr std::uint32_t kMaxBlockRows = 65536;

/// Stored: append only.
enum RowColumn : std::uint8_t {
  kSeqColumn,
  kSendColumn,
  kRoundTripColumn,  ///< t_recv less t_send
  kShapeColumn,      ///< 0: kept raw, else number of the shape from 1
  kHeaderColumn,
  kRawColumn,    ///< bodies of the rows kept raw
  kPlaceColumn,  ///< place among all answers of the part
  kRowColumns
};

struct BlockHead {
  RobotId robot = 0;
  Source source = Source::status;
  SessionId session = 0;
  WordOrder order = WordOrder::cdab;  ///< the floats of a register image were taken in this order
  std::uint32_t rows = 0;
  std::uint32_t raw_rows = 0;  ///< rows whose body was not taken apart
  std::uint64_t seq_first = 0;
  std::uint64_t seq_last = 0;
  Micros t_first_us = 0;  ///< t_send of the first row
  Micros t_last_us = 0;
  std::uint64_t bytes = 0;  ///< of the whole block
};

struct TextFrame {
  std::size_t count = 0;
  std::size_t offset = 0;
  std::size_t length = 0;
  std::uint32_t checksum = 0;
};

struct BlockDirectory {
  std::uint32_t columns = 0;
  TextFrame shapes;
  TextFrame constants;
  std::vector<ColumnEntry> entries;  ///< by position; columns without one are constant
  /// Null: constant; then `number` is which.
  [[nodiscard]] const ColumnEntry* find(std::uint32_t position, std::size_t& number) const;
};

/// Puts a block together. `head.bytes` is filled in.
std::string write_block(BlockHead head, std::span<const std::string_view> shapes,
                        std::span<const EncodedColumn> columns, Packer& packer);

/// The head alone; false when the bytes do not begin with one that this version can read. Its checksum is not looked
/// at: it covers the directory.
[[nodiscard]] bool read_head(std::string_view block, BlockHead& head);

/// Head and directory; memory of the directory serves again. Returns what is wrong, or nothing.
[[nodiscard]] std::string read_block(BlockBytes& block, BlockHead& head, BlockDirectory& directory);

}  // namespace tacho::store
