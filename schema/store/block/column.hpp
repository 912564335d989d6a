#pragma once
// One column of a block: the texts (byte strings) that stand at one place of the answers, as few bytes, and back.
//
// A column is stored in one of four forms, whichever is smallest:
//   constant    one text for all rows; all constants of a block share one frame
//   numbers     integers (int_stream.hpp) and the style that prints them; texts that do not fit it stand beside as
//               exceptions
//   texts       the distinct texts, and which row has which
//   composite   a shape common to all rows (an array, or a string with runs of digits), and a column per hole
//
// Thread rule: one thread per ColumnWriter and ColumnReader. A loaded column may be read from several.

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "schema/store/block/int_stream.hpp"
#include "schema/store/block/number_style.hpp"

namespace tacho::store {

/// Stored: append only.
enum class ColumnForm : std::uint8_t { constant, numbers, texts, composite };
std::string_view column_form_name(ColumnForm form);

/// What a place of an answer holds. `bytes`: no numbers are looked for.
enum class LeafType : std::uint8_t { json, bytes, word, dword, real, inputs };

/// What the directory of a block says about a column. Constants have no entry, but as children of a composite.
struct ColumnEntry {
  ColumnForm form = ColumnForm::constant;
  std::uint32_t position = 0;    ///< which column of the block; constant child: which constant
  std::uint32_t count = 0;       ///< texts
  std::uint32_t exceptions = 0;  ///< numbers: texts kept as they are
  NumberStyle style;             ///< numbers
  std::int64_t min = 0;          ///< numbers: of the values that are no exceptions, in the order of the numbers
  std::int64_t max = 0;
  std::int64_t first = 0;
  std::int64_t last = 0;
  std::size_t offset = 0;  ///< of the frame in the block
  std::size_t length = 0;
  std::uint32_t checksum = 0;  ///< CRC-32C of the frame
  std::vector<ColumnEntry> children;
};

struct EncodedColumn {
  ColumnEntry entry;
  std::string frame;     ///< empty for a constant
  std::string constant;  ///< its text
  std::vector<EncodedColumn> children;
  /// Frames of the column and its children, and about what their directory entries take.
  [[nodiscard]] std::size_t bytes() const;
};

class ColumnWriter {
 public:
  /// `level`: zstd level.
  ColumnWriter(int level, WordOrder order) : packer_(level), order_(order) {}

  /// The views must stay valid during the call only. At least one text.
  EncodedColumn encode(std::span<const std::string_view> texts, LeafType type) { return encode(texts, type, 0); }
  /// Numbers that have no texts. Read back with LoadedColumn::values.
  EncodedColumn encode_values(std::span<const std::int64_t> values);
  Packer& packer() { return packer_; }

 private:
  Packer packer_;
  WordOrder order_;

  EncodedColumn encode(std::span<const std::string_view> texts, LeafType type, int depth);
  EncodedColumn as_texts(std::span<const std::string_view> texts);
  bool as_numbers(std::span<const std::string_view> texts, const NumberStyle& style, EncodedColumn& column);
  bool as_composite(std::span<const std::string_view> texts, int depth, EncodedColumn& column);
  std::vector<NumberStyle> styles(std::span<const std::string_view> texts, LeafType type) const;
};

/// A column in memory. Points into the block it was read from, and into itself.
struct LoadedColumn {
  LoadedColumn() = default;
  LoadedColumn(LoadedColumn&&) noexcept = default;
  LoadedColumn& operator=(LoadedColumn&&) noexcept = default;
  ~LoadedColumn() = default;
  LoadedColumn(const LoadedColumn&) = delete;
  LoadedColumn& operator=(const LoadedColumn&) = delete;

  ColumnForm form = ColumnForm::constant;
  NumberStyle style;
  std::vector<std::int64_t> values;          ///< numbers: values; texts: index into `texts`
  std::vector<std::int64_t> exception_rows;  ///< numbers: ascending
  std::vector<std::string_view> texts;       ///< texts: distinct; numbers: one per exception; constant: the one
  std::vector<std::string_view> pieces;      ///< composite: before, between and after the children
  std::vector<LoadedColumn> children;
  std::vector<std::vector<char>> storage;  ///< what views point to that was decompressed

  /// Appends the text of value `i`, which must be below the entry's count.
  void append(std::size_t i, std::string& out) const;
};

class ColumnReader {
 public:
  /// `block` must outlive the columns loaded.
  void start(BlockBytes& block) {
    block_ = &block;
    constants_.clear();
  }
  /// Bytes that the columns loaded from now on may take together when unpacked.
  void set_budget(std::size_t bytes) { budget_ = bytes; }
  /// Takes `count` texts as put_texts() wrote them. False: damaged, or over the budget.
  [[nodiscard]] bool take_texts(ByteReader& in, std::size_t count, std::vector<std::string_view>& texts,
                                std::vector<char>& storage);
  /// Texts of the block's constants, by number.
  void set_constants(std::vector<std::string_view> texts) { constants_ = std::move(texts); }
  /// False: damaged, or over the budget.
  [[nodiscard]] bool load(const ColumnEntry& entry, LoadedColumn& column);
  /// The same, but values of a column of numbers are handed on as they are read, and `column.values` stays empty.
  /// Exceptions are complete only after the last value.
  [[nodiscard]] bool load(const ColumnEntry& entry, LoadedColumn& column, const IntReader::UseRun& numbers);
  [[nodiscard]] bool load_constant(std::size_t number, LoadedColumn& column) const;

 private:
  IntReader ints_;
  BlockBytes* block_ = nullptr;
  std::size_t budget_ = 0;
  std::vector<std::string_view> constants_;
  bool spend(std::size_t bytes);
  bool load_distinct(ByteReader& in, std::size_t count, LoadedColumn& column, std::vector<std::int64_t>& index);
  bool load_exceptions(ByteReader& in, const ColumnEntry& entry, LoadedColumn& column);
  bool load_composite(ByteReader& in, const ColumnEntry& entry, LoadedColumn& column);
};

/// Lengths, then bytes, as one piece.
void put_texts(std::span<const std::string_view> texts, Packer& packer, std::string& out);

}  // namespace tacho::store
