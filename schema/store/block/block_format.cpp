#include "schema/store/block/block_format.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "schema/store/block/shape_table.hpp"
#include "schema/store/checksum.hpp"

namespace tacho::store {

namespace {

constexpr std::size_t kChecksumAt = 12;
constexpr std::size_t kChecksumBytes = 4;
constexpr std::size_t kMaxEntries = 65536;
constexpr int kMaxDepth = 8;

std::uint32_t checksum(std::string_view bytes) {
  return static_cast<std::uint32_t>(Checksum().add_bytes(bytes).value());
}

/// Of head and directory, without the checksum itself.
std::uint32_t head_checksum(std::string_view head_and_directory) {
  return static_cast<std::uint32_t>(Checksum()
                                        .add_bytes(head_and_directory.substr(0, kChecksumAt))
                                        .add_bytes(head_and_directory.substr(kChecksumAt + kChecksumBytes))
                                        .value());
}

void put_statistics(const ColumnEntry& entry, std::string& out) {
  const auto above = [&](std::int64_t value) {
    return static_cast<std::uint64_t>(value) - static_cast<std::uint64_t>(entry.min);
  };
  if (entry.style.kind == NumberKind::real64) {
    for (const std::int64_t value : {entry.min, entry.max, entry.first, entry.last}) {
      put_fixed(out, value);
    }
    return;
  }
  put_varint(out, zigzag(entry.min));
  put_varint(out, above(entry.max));
  put_varint(out, above(entry.first));
  put_varint(out, above(entry.last));
}

void take_statistics(ByteReader& in, ColumnEntry& entry) {
  if (entry.style.kind == NumberKind::real64) {
    for (std::int64_t* const value : {&entry.min, &entry.max, &entry.first, &entry.last}) {
      *value = in.fixed<std::int64_t>();
    }
    return;
  }
  entry.min = in.signed_varint();
  for (std::int64_t* const value : {&entry.max, &entry.first, &entry.last}) {
    *value = static_cast<std::int64_t>(in.varint() + static_cast<std::uint64_t>(entry.min));
  }
}

void put_entry(const EncodedColumn& column, std::string& out) {
  const ColumnEntry& entry = column.entry;
  out.push_back(static_cast<char>(entry.form));
  if (entry.form == ColumnForm::constant) {
    return;
  }
  put_varint(out, entry.count);
  put_varint(out, entry.length);
  put_fixed(out, entry.checksum);
  if (entry.form == ColumnForm::numbers) {
    put_varint(out, entry.exceptions);
    put_style(entry.style, out);
    put_statistics(entry, out);
  }
  if (entry.form == ColumnForm::composite) {
    put_varint(out, column.children.size());
    for (const EncodedColumn& child : column.children) {
      put_entry(child, out);
    }
  }
}

/// Reads entries, over what stands in them from another block; numbers of constants follow from their order.
class EntryReader {
 public:
  EntryReader(ByteReader& in, std::size_t next_constant, std::uint32_t rows)
      : in_(in), next_constant_(next_constant), rows_(rows) {}

  bool take(ColumnEntry& entry, int depth = 0) {
    const std::uint8_t form = in_.byte();
    if (depth > kMaxDepth || ++entries_ > kMaxEntries || form > static_cast<std::uint8_t>(ColumnForm::composite)) {
      return false;
    }
    entry.form = static_cast<ColumnForm>(form);
    if (entry.form != ColumnForm::composite) {
      entry.children.clear();
    }
    if (entry.form == ColumnForm::constant) {
      entry.position = static_cast<std::uint32_t>(next_constant_++);
      entry.length = 0;
      return depth > 0;
    }
    const std::uint64_t count = in_.varint();
    const std::uint64_t length = in_.varint();
    entry.checksum = in_.fixed<std::uint32_t>();
    if (!in_.good() || count > rows_ || length > kMaxPieceBytes) {
      return false;
    }
    entry.count = static_cast<std::uint32_t>(count);
    entry.length = length;
    if (entry.form == ColumnForm::numbers) {
      return numbers(entry);
    }
    entry.exceptions = 0;
    entry.style = NumberStyle();
    return entry.form == ColumnForm::texts || parts(entry, depth);
  }

 private:
  ByteReader& in_;
  std::size_t next_constant_;
  std::uint32_t rows_;
  std::size_t entries_ = 0;

  bool numbers(ColumnEntry& entry) {
    const std::uint64_t exceptions = in_.varint();
    if (!take_style(in_, entry.style) || exceptions > entry.count) {
      return false;
    }
    entry.exceptions = static_cast<std::uint32_t>(exceptions);
    take_statistics(in_, entry);
    return in_.good();
  }
  bool parts(ColumnEntry& entry, int depth) {
    const std::uint64_t parts = in_.varint();
    if (parts > in_.left() || parts > kMaxEntries) {
      return false;
    }
    entry.children.resize(parts);  // each takes at least a byte of the directory
    for (ColumnEntry& child : entry.children) {
      if (!take(child, depth + 1) || (child.form != ColumnForm::constant && child.count != entry.count)) {
        return false;
      }
    }
    return true;
  }
};

void put_text_frame(std::span<const std::string_view> texts, Packer& packer, std::string& directory,
                    std::string& frames) {
  std::string frame;
  put_texts(texts, packer, frame);
  put_varint(directory, texts.size());
  put_varint(directory, frame.size());
  put_fixed(directory, checksum(frame));
  frames += frame;
}

bool take_text_frame(ByteReader& in, std::size_t& offset, TextFrame& frame) {
  frame.count = in.varint();
  frame.length = in.varint();
  frame.checksum = in.fixed<std::uint32_t>();
  frame.offset = offset;
  offset += std::min(frame.length, kMaxPieceBytes);
  return in.good() && frame.length <= kMaxPieceBytes;
}

std::size_t frame_bytes(const ColumnEntry& entry) {
  std::size_t bytes = entry.length;
  for (const ColumnEntry& child : entry.children) {
    bytes += frame_bytes(child);
  }
  return bytes;
}

std::size_t frame_bytes(const EncodedColumn& column) {
  std::size_t bytes = column.frame.size();
  for (const EncodedColumn& child : column.children) {
    bytes += frame_bytes(child);
  }
  return bytes;
}

/// Numbers of the columns that are not constant, in the order in which their frames are stored.
template <class Column>
std::vector<std::uint64_t> frame_order(std::span<const Column> columns) {
  // Size and number in one, which is sorted faster than pairs: entries of 2^27 bytes, 2^16 at most, make 2^43 bytes.
  constexpr unsigned kNumberBits = 16;
  static_assert(kRowColumns + kMaxLeafColumns <= std::size_t{1} << kNumberBits);
  std::vector<std::uint64_t> order;
  order.reserve(columns.size());
  for (std::size_t i = 0; i < columns.size(); ++i) {
    order.push_back(std::uint64_t{frame_bytes(columns[i])} << kNumberBits | i);
  }
  std::sort(order.begin(), order.end());
  for (std::uint64_t& column : order) {
    column &= (std::uint64_t{1} << kNumberBits) - 1;
  }
  return order;
}

void collect_constants(const EncodedColumn& column, std::vector<std::string_view>& constants) {
  for (const EncodedColumn& child : column.children) {
    if (child.entry.form == ColumnForm::constant) {
      constants.push_back(child.constant);
    }
    collect_constants(child, constants);
  }
}

void collect_frames(const EncodedColumn& column, std::string& frames) {
  frames += column.frame;
  for (const EncodedColumn& child : column.children) {
    collect_frames(child, frames);
  }
}

void place_frames(ColumnEntry& entry, std::size_t& offset) {
  entry.offset = offset;
  offset += entry.length;
  for (ColumnEntry& child : entry.children) {
    place_frames(child, offset);
  }
}

bool take_directory(ByteReader& in, std::size_t offset, const BlockHead& head, BlockDirectory& directory) {
  const std::uint64_t columns = in.varint();
  const std::uint64_t entries = in.varint();
  if (columns < kRowColumns || columns > kRowColumns + kMaxLeafColumns || entries > columns ||
      !take_text_frame(in, offset, directory.shapes) || !take_text_frame(in, offset, directory.constants)) {
    return false;
  }
  directory.columns = static_cast<std::uint32_t>(columns);
  directory.entries.resize(entries);
  EntryReader reader(in, columns - entries, head.rows);
  std::uint64_t position = 0;
  for (ColumnEntry& entry : directory.entries) {
    position += in.varint();
    if (position >= columns || !reader.take(entry)) {
      return false;
    }
    entry.position = static_cast<std::uint32_t>(position++);
  }
  for (const std::uint64_t i : frame_order(std::span<const ColumnEntry>(directory.entries))) {
    place_frames(directory.entries[i], offset);
  }
  return in.good() && in.left() == 0;
}

}  // namespace

const ColumnEntry* BlockDirectory::find(std::uint32_t position, std::size_t& number) const {
  const auto found = std::lower_bound(entries.begin(), entries.end(), position,
                                      [](const ColumnEntry& entry, std::uint32_t p) { return entry.position < p; });
  if (found != entries.end() && found->position == position) {
    return &*found;
  }
  number = position - static_cast<std::size_t>(found - entries.begin());
  return nullptr;
}

std::string write_block(BlockHead head, std::span<const std::string_view> shapes,
                        std::span<const EncodedColumn> columns, Packer& packer) {
  std::vector<std::string_view> constants;
  std::uint64_t entries = 0;
  for (const EncodedColumn& column : columns) {
    if (column.entry.form == ColumnForm::constant) {
      constants.push_back(column.constant);
    } else {
      ++entries;
    }
  }
  std::string column_frames;
  std::string entry_bytes;
  std::uint64_t constants_before = 0;
  for (const EncodedColumn& column : columns) {
    if (column.entry.form == ColumnForm::constant) {
      ++constants_before;
      continue;
    }
    put_varint(entry_bytes, constants_before);
    put_entry(column, entry_bytes);
    collect_constants(column, constants);
    constants_before = 0;
  }
  for (const std::uint64_t i : frame_order(columns)) {
    collect_frames(columns[i], column_frames);
  }
  std::string directory;
  std::string text_frames;
  put_varint(directory, columns.size());
  put_varint(directory, entries);
  put_text_frame(shapes, packer, directory, text_frames);
  put_text_frame(constants, packer, directory, text_frames);
  directory += entry_bytes;

  std::string block(kBlockMagic);
  put_fixed(block, kBlockVersion);
  put_fixed(block, static_cast<std::uint8_t>(head.source));
  put_fixed(block, static_cast<std::uint8_t>(head.order));
  put_fixed(block, std::uint8_t{0});
  put_fixed(block, std::uint32_t{0});
  put_fixed(block, std::uint64_t{kBlockHeadBytes + directory.size() + text_frames.size() + column_frames.size()});
  put_fixed(block, static_cast<std::uint32_t>(directory.size()));
  put_fixed(block, head.robot);
  put_fixed(block, head.session);
  put_fixed(block, head.rows);
  put_fixed(block, head.raw_rows);
  put_fixed(block, head.seq_first);
  put_fixed(block, head.seq_last);
  put_fixed(block, head.t_first_us);
  put_fixed(block, head.t_last_us);
  block += directory;
  std::string sum;
  put_fixed(sum, head_checksum(block));
  block.replace(kChecksumAt, kChecksumBytes, sum);
  return block + text_frames + column_frames;
}

bool read_head(std::string_view block, BlockHead& head) {
  if (block.size() < kBlockHeadBytes || block.substr(0, kBlockMagic.size()) != kBlockMagic) {
    return false;
  }
  ByteReader in(block.substr(kBlockMagic.size(), kBlockHeadBytes - kBlockMagic.size()));
  const std::uint8_t version = in.byte();
  const std::uint8_t source = in.byte();
  const std::uint8_t order = in.byte();
  const std::uint8_t flags = in.byte();
  in.fixed<std::uint32_t>();
  head.bytes = in.fixed<std::uint64_t>();
  in.fixed<std::uint32_t>();
  head.robot = in.fixed<std::uint32_t>();
  head.session = in.fixed<std::uint32_t>();
  head.rows = in.fixed<std::uint32_t>();
  head.raw_rows = in.fixed<std::uint32_t>();
  head.seq_first = in.fixed<std::uint64_t>();
  head.seq_last = in.fixed<std::uint64_t>();
  head.t_first_us = in.fixed<std::int64_t>();
  head.t_last_us = in.fixed<std::int64_t>();
  head.source = static_cast<Source>(source);
  head.order = static_cast<WordOrder>(order);
  return version == kBlockVersion && source < kSourceCount && order <= static_cast<std::uint8_t>(WordOrder::dcba) &&
         flags == 0 && head.rows > 0 && head.rows <= kMaxBlockRows && head.raw_rows <= head.rows;
}

std::string read_block(BlockBytes& block, BlockHead& head, BlockDirectory& directory) {
  const std::string_view fixed = block.at(0, kBlockHeadBytes);
  if (!read_head(fixed, head)) {
    return "not a block of version 1";
  }
  constexpr std::size_t kDirectoryBytesAt = 24;
  const std::size_t directory_bytes = ByteReader(fixed.substr(kDirectoryBytesAt)).fixed<std::uint32_t>();
  if (head.bytes != block.size() || directory_bytes > block.size() - kBlockHeadBytes) {
    return fmt::format("the block should have {} bytes and has {}", head.bytes, block.size());
  }
  const std::string_view covered = block.at(0, kBlockHeadBytes + directory_bytes);
  if (ByteReader(covered.substr(kChecksumAt)).fixed<std::uint32_t>() != head_checksum(covered)) {
    return "head or directory of the block are damaged";
  }
  ByteReader in(covered.substr(kBlockHeadBytes));
  return take_directory(in, covered.size(), head, directory) ? "" : "the directory of the block makes no sense";
}

}  // namespace tacho::store
