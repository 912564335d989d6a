#include <algorithm>
#include <utility>

#include "schema/store/block/column.hpp"
#include "schema/store/block/json_text.hpp"
#include "schema/store/block/wide_loops.hpp"
#include "schema/store/checksum.hpp"

namespace tacho::store {

std::string_view column_form_name(ColumnForm form) {
  switch (form) {
    case ColumnForm::constant:
      return "constant";
    case ColumnForm::numbers:
      return "numbers";
    case ColumnForm::texts:
      return "texts";
    case ColumnForm::composite:
      return "composite";
  }
  return "";
}

void LoadedColumn::append(std::size_t i, std::string& out) const {
  switch (form) {
    case ColumnForm::constant:
      out += texts[0];
      return;
    case ColumnForm::numbers: {
      const auto found = std::lower_bound(exception_rows.begin(), exception_rows.end(), static_cast<std::int64_t>(i));
      if (found != exception_rows.end() && *found == static_cast<std::int64_t>(i)) {
        out += texts[static_cast<std::size_t>(found - exception_rows.begin())];
      } else {
        append_number(style, values[i], out);
      }
      return;
    }
    case ColumnForm::texts:
      out += texts[static_cast<std::size_t>(values[i])];
      return;
    case ColumnForm::composite:
      for (std::size_t k = 0; k < children.size(); ++k) {
        out += pieces[k];
        children[k].append(i, out);
      }
      out += pieces.back();
      return;
  }
}

bool ColumnReader::spend(std::size_t bytes) {
  if (bytes > budget_) {
    return false;
  }
  budget_ -= bytes;
  return true;
}

bool ColumnReader::take_texts(ByteReader& in, std::size_t count, std::vector<std::string_view>& texts,
                              std::vector<char>& storage) {
  const std::uint64_t size = in.varint();
  // Each text has at least a length of one byte.
  if (count > size || size > kMaxPieceBytes || !spend(size) || !spend(count * sizeof(std::string_view))) {
    return false;
  }
  const std::optional<std::string_view> piece = ints_.unpacker().take(in, size, storage);
  if (!piece) {
    return false;
  }
  ByteReader lengths(*piece);
  texts.resize(count);
  std::vector<std::uint64_t> length(count);
  for (std::uint64_t& l : length) {
    l = lengths.varint();
  }
  for (std::size_t i = 0; i < count; ++i) {
    texts[i] = lengths.take(length[i]);
  }
  return lengths.good() && lengths.left() == 0;
}

bool ColumnReader::load_distinct(ByteReader& in, std::size_t count, LoadedColumn& column,
                                 std::vector<std::int64_t>& index) {
  const std::uint64_t distinct = in.varint();
  if (distinct == 0 || distinct > count || !spend(count * sizeof(std::int64_t)) ||
      !take_texts(in, distinct, column.texts, column.storage.emplace_back())) {
    return false;
  }
  if (distinct == 1) {
    index.assign(count, 0);
    return true;
  }
  if (!ints_.take(in, count, index)) {
    return false;
  }
  std::uint64_t beyond = 0;
  run_loop([&]() __attribute__((always_inline)) {
    const std::uint64_t end = distinct;
    std::uint64_t any = 0;
    for (const std::int64_t i : index) {
      any |= static_cast<std::uint64_t>(i) < end ? 0U : 1U;
    }
    beyond = any;
  });
  return beyond == 0;
}

bool ColumnReader::load_exceptions(ByteReader& in, const ColumnEntry& entry, LoadedColumn& column) {
  if (entry.exceptions == 0) {
    return true;
  }
  std::vector<std::int64_t> index;
  std::int64_t after = -1;
  if (!ints_.take(in, entry.exceptions, column.exception_rows) || !load_distinct(in, entry.exceptions, column, index)) {
    return false;
  }
  for (const std::int64_t row : column.exception_rows) {
    if (row <= after || row >= static_cast<std::int64_t>(entry.count)) {
      return false;
    }
    after = row;
  }
  std::vector<std::string_view> texts;
  for (const std::int64_t i : index) {
    texts.push_back(column.texts[static_cast<std::size_t>(i)]);
  }
  column.texts = std::move(texts);
  return true;
}

bool ColumnReader::load_composite(ByteReader& in, const ColumnEntry& entry, LoadedColumn& column) {
  std::vector<std::string_view> shape;
  if (!take_texts(in, 1, shape, column.storage.emplace_back())) {
    return false;
  }
  std::string_view rest = shape[0];
  for (std::size_t hole = rest.find(kHole); hole != std::string_view::npos; hole = rest.find(kHole)) {
    column.pieces.push_back(rest.substr(0, hole));
    rest.remove_prefix(hole + 1);
    if (column.pieces.size() > entry.children.size()) {
      return false;
    }
  }
  column.pieces.push_back(rest);
  if (column.pieces.size() != entry.children.size() + 1) {
    return false;
  }
  column.children.resize(entry.children.size());
  for (std::size_t k = 0; k < entry.children.size(); ++k) {
    if (!load(entry.children[k], column.children[k])) {
      return false;
    }
  }
  return true;
}

bool ColumnReader::load_constant(std::size_t number, LoadedColumn& column) const {
  if (number >= constants_.size()) {
    return false;
  }
  column = LoadedColumn();
  column.texts.assign(1, constants_[number]);
  return true;
}

bool ColumnReader::load(const ColumnEntry& entry, LoadedColumn& column) {
  return load(entry, column, [&](std::size_t begin, std::span<const std::int64_t> values) {
    if (begin == 0) {
      column.values.resize(entry.count);
    }
    std::copy(values.begin(), values.end(), column.values.begin() + static_cast<std::ptrdiff_t>(begin));
  });
}

bool ColumnReader::load(const ColumnEntry& entry, LoadedColumn& column, const IntReader::UseRun& numbers) {
  if (entry.form == ColumnForm::constant) {
    return load_constant(entry.position, column);
  }
  column.form = entry.form;
  column.style = entry.style;
  column.values.clear();
  column.exception_rows.clear();
  column.texts.clear();
  column.pieces.clear();
  column.children.clear();
  column.storage.clear();
  const std::string_view frame = block_->at(entry.offset, entry.length);
  if (frame.size() != entry.length ||
      static_cast<std::uint32_t>(Checksum().add_bytes(frame).value()) != entry.checksum) {
    return false;
  }
  ByteReader in(frame);
  bool good = false;
  switch (entry.form) {
    case ColumnForm::constant:
      break;
    case ColumnForm::numbers:
      good = entry.exceptions <= entry.count &&
             spend((std::size_t{entry.count} + entry.exceptions) * sizeof(std::int64_t)) &&
             load_exceptions(in, entry, column) && ints_.take(in, entry.count, numbers);
      break;
    case ColumnForm::texts:
      good = load_distinct(in, entry.count, column, column.values);
      break;
    case ColumnForm::composite:
      good = load_composite(in, entry, column);
      break;
  }
  return good && in.good() && in.left() == 0;
}

}  // namespace tacho::store
