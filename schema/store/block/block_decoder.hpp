#pragma once
// One block -> its answers byte for byte, or the values of a few of its paths without touching the rest.
//
// The bytes may be anything: nothing here crashes, and no more than kBlockBudget bytes are taken from memory beside one
// body. Damage is said in words; a damaged column costs what depends on it and no more.
//
// Lifetime: the block must outlive the use of the decoder. Keep one decoder for many blocks: its memory is reused, and
// blocks with the same shapes as the one before are opened without reading them again.
// Thread rule: one thread per object.

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "schema/sample.hpp"
#include "schema/store/block/block_format.hpp"
#include "schema/store/block/column.hpp"
#include "schema/store/block/json_text.hpp"
#include "schema/store/block/shape_table.hpp"

namespace tacho::store {

inline constexpr std::size_t kBlockBudget = std::size_t{512} << 20U;

/// What to fill in of ColumnValues.
struct Want {
  bool reals = false;
  bool integers = false;  ///< also tells ValueKind::whole from ValueKind::number
  bool texts = false;
};

/// The values of one path, struct of arrays: element i belongs to row i of the block. Vectors not wanted are empty.
struct ColumnValues {
  /// What stands in the answer. Rows kept raw and rows whose answer has no such path are `absent`.
  std::vector<ValueKind> kind;
  bool alike = false;                 ///< all of `kind` are equal; not always found out
  std::vector<double> real;           ///< numbers: exactly what reading the text gives, no scale applied
  std::vector<std::int64_t> integer;  ///< whole numbers; flags 0 or 1; floats of registers: their 32 bits
  std::vector<std::uint32_t> text;  ///< texts without quotes and escapes; arrays, objects: their JSON; ids in the pool
};

/// A column as the directory describes it.
struct ColumnInfo {
  std::string path;
  std::uint32_t occurrence = 0;  ///< of a doubled key: which one
  ColumnForm form = ColumnForm::constant;
  std::uint32_t count = 0;                       ///< rows that have it; 0 for constants, which are not counted
  std::uint32_t exceptions = 0;                  ///< numbers that do not fit the column's style
  NumberStyle style;                             ///< numbers
  double min = 0, max = 0, first = 0, last = 0;  ///< numbers, exceptions left out
  std::size_t bytes = 0;                         ///< frames
};

class BlockDecoder {
 public:
  BlockDecoder() = default;
  ~BlockDecoder() = default;
  BlockDecoder(const BlockDecoder&) = delete;
  BlockDecoder& operator=(const BlockDecoder&) = delete;

  /// What is wrong with head or directory, or nothing. Nothing else may be called when something is wrong.
  [[nodiscard]] std::string open(BlockBytes& block);
  [[nodiscard]] std::string open(std::string_view block) {
    whole_ = WholeBlock(block);
    return open(whole_);
  }
  [[nodiscard]] const BlockHead& head() const { return head_; }
  /// Names of everything in the block; empty when the shapes are damaged, which every read() says.
  [[nodiscard]] const ShapeTable& shapes() const { return *table_; }

  /// Columns of the leaves. Empty when the shapes are damaged.
  [[nodiscard]] std::vector<ColumnInfo> columns() const;

  /// Times of all rows. Returns damage.
  [[nodiscard]] std::string times(std::vector<std::uint64_t>& seq, std::vector<Micros>& t_send_us,
                                  std::vector<Micros>& t_recv_us);

  /// Places of all rows, as they were given to the encoder. Returns damage.
  [[nodiscard]] std::string places(std::vector<std::int64_t>& places);

  /// Yields every answer that can be put together, in order, with its row. Returns damage: what was left out and why.
  [[nodiscard]] std::string answers(const std::function<void(std::size_t row, const Answer&)>& yield);

  /// Yields the rows whose body was not taken apart. Their values have to be decoded from the body.
  [[nodiscard]] std::string raw_bodies(const std::function<void(std::size_t row, std::string_view body)>& yield);

  /// Reads the values of a path: of a leaf (the first of a doubled key), or of an object. A path
  /// that no answer has is absent in all rows. Returns damage; the values are then not usable. Texts go to `pool`.
  [[nodiscard]] std::string read(const std::string& path, Want want, TextPool& pool, ColumnValues& out);

 private:
  WholeBlock whole_;
  BlockBytes* block_ = &whole_;
  BlockHead head_;
  BlockDirectory directory_;
  ColumnReader reader_;
  /// Shapes come back from block to block: the tables last used, and the bytes they were made of.
  struct KnownShapes {
    Source source = Source::status;
    std::string frame;
    std::shared_ptr<const ShapeTable> table;  ///< shared with table_
  };
  std::vector<KnownShapes> known_;
  std::size_t oldest_ = 0;
  std::shared_ptr<const ShapeTable> table_;
  bool shapes_good_ = false;
  enum class Constants : std::uint8_t { unread, good, damaged } constants_ = Constants::unread;
  std::vector<char> constant_bytes_;
  std::vector<std::int64_t> shape_of_row_;   ///< filled when first needed
  std::vector<std::uint32_t> rows_of_leaf_;  ///< likewise
  LoadedColumn row_column_;
  LoadedColumn column_;

  bool load_shapes();
  bool load_constants();
  bool load(std::uint32_t position, LoadedColumn& column, const IntReader::UseRun* numbers = nullptr);
  bool load_values(RowColumn column, const IntReader::UseRun& use);
  bool load_values(RowColumn column, std::vector<std::int64_t>& values);
  bool load_shape_of_row();
  void count_leaf_rows();
  bool load_raw(LoadedColumn& raw);
  bool load_headers(LoadedColumn& headers);
  bool load_leaf(std::uint32_t leaf, LoadedColumn& column, const IntReader::UseRun* numbers = nullptr);
  /// Rows that have the leaf column; empty when all have.
  bool present_rows(std::uint32_t leaf, std::vector<bool>& present);
  bool read_leaf(std::uint32_t leaf, Want want, TextPool& pool, ColumnValues& out);
  std::string read_object(const std::string& path, Want want, TextPool& pool, ColumnValues& out);
};

}  // namespace tacho::store
