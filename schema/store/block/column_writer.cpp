#include <algorithm>
#include <array>
#include <bit>
#include <unordered_map>
#include <utility>

#include "schema/store/block/column.hpp"
#include "schema/store/block/json_text.hpp"
#include "schema/store/checksum.hpp"

namespace tacho::store {

namespace {

constexpr int kMaxNesting = 6;          // composites inside composites
constexpr std::size_t kMaxParts = 512;  // holes of an array; strings have fewer
constexpr std::size_t kMaxRuns = 16;    // runs of digits in a string
/// Columns with fewer distinct texts than this are best served by listing them.
constexpr std::size_t kFewTexts = 8;
constexpr std::size_t kRowsPerText = 16;

/// The distinct texts in order of appearance, and which row has which.
struct Distinct {
  std::vector<std::string_view> texts;
  std::vector<std::int64_t> index;
};

Distinct distinct_of(std::span<const std::string_view> texts) {
  Distinct distinct;
  distinct.index.reserve(texts.size());
  std::unordered_map<std::string_view, std::int64_t> known;
  for (const std::string_view text : texts) {
    const auto [found, fresh] = known.emplace(text, static_cast<std::int64_t>(distinct.texts.size()));
    if (fresh) {
      distinct.texts.push_back(text);
    }
    distinct.index.push_back(found->second);
  }
  return distinct;
}

void put_distinct(const Distinct& distinct, Packer& packer, std::string& out) {
  put_varint(out, distinct.texts.size());
  put_texts(distinct.texts, packer, out);
  if (distinct.texts.size() > 1) {
    encode_ints(distinct.index, packer, out);
  }
}

bool many_texts(const Distinct& distinct) {
  return distinct.texts.size() > std::max(kFewTexts, distinct.index.size() / kRowsPerText);
}

void seal(EncodedColumn& column) {
  column.entry.length = column.frame.size();
  column.entry.checksum = static_cast<std::uint32_t>(Checksum().add_bytes(column.frame).value());
}

void add_statistics(const NumberStyle& style, std::span<const std::int64_t> values,
                    std::span<const std::int64_t> exception_rows, ColumnEntry& entry) {
  std::vector<double> reals(values.size());
  to_reals(style, values, reals.data());
  std::size_t next = 0;
  std::optional<std::size_t> min;
  std::size_t max = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (next < exception_rows.size() && exception_rows[next] == static_cast<std::int64_t>(i)) {
      ++next;
      continue;
    }
    if (!min) {
      min = max = i;
      entry.first = values[i];
    }
    // Whole numbers beyond 2^53 tie as reals; NaN never wins.
    min = std::pair(reals[i], values[i]) < std::pair(reals[*min], values[*min]) ? i : *min;
    max = std::pair(reals[i], values[i]) > std::pair(reals[max], values[max]) ? i : max;
    entry.last = values[i];
  }
  entry.min = min ? values[*min] : 0;
  entry.max = min ? values[max] : 0;
}

}  // namespace

void put_texts(std::span<const std::string_view> texts, Packer& packer, std::string& out) {
  std::string bytes;
  for (const std::string_view text : texts) {
    put_varint(bytes, text.size());
  }
  for (const std::string_view text : texts) {
    bytes += text;
  }
  put_varint(out, bytes.size());
  packer.append_text(out, bytes);
}

std::size_t EncodedColumn::bytes() const {
  constexpr std::size_t kEntry = 24;
  std::size_t total = frame.size() + constant.size() + (entry.form == ColumnForm::constant ? 1 : kEntry);
  for (const EncodedColumn& child : children) {
    total += child.bytes();
  }
  return total;
}

EncodedColumn ColumnWriter::encode_values(std::span<const std::int64_t> values) {
  EncodedColumn column;
  column.entry.form = ColumnForm::numbers;
  column.entry.count = static_cast<std::uint32_t>(values.size());
  encode_ints(values, packer_, column.frame);
  if (!values.empty()) {
    const auto [min, max] = std::minmax_element(values.begin(), values.end());
    column.entry.min = *min;
    column.entry.max = *max;
    column.entry.first = values.front();
    column.entry.last = values.back();
  }
  seal(column);
  return column;
}

EncodedColumn ColumnWriter::as_texts(std::span<const std::string_view> texts) {
  EncodedColumn column;
  column.entry.form = ColumnForm::texts;
  column.entry.count = static_cast<std::uint32_t>(texts.size());
  put_distinct(distinct_of(texts), packer_, column.frame);
  seal(column);
  return column;
}

bool ColumnWriter::as_numbers(std::span<const std::string_view> texts, const NumberStyle& style,
                              EncodedColumn& column) {
  column.entry.form = ColumnForm::numbers;
  column.entry.style = style;
  column.entry.count = static_cast<std::uint32_t>(texts.size());
  std::vector<std::int64_t> values(texts.size());
  std::vector<std::int64_t> exception_rows;
  std::vector<std::string_view> exceptions;
  std::optional<std::int64_t> before;
  for (std::size_t i = 0; i < texts.size(); ++i) {
    if (const std::optional<std::int64_t> value = number_value(style, texts[i])) {
      if (!before) {
        std::fill(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(i), *value);
      }
      before = values[i] = *value;
    } else {
      values[i] = before.value_or(0);  // what costs least
      exception_rows.push_back(static_cast<std::int64_t>(i));
      exceptions.push_back(texts[i]);
    }
  }
  if (!before) {
    return false;
  }
  column.entry.exceptions = static_cast<std::uint32_t>(exceptions.size());
  if (!exceptions.empty()) {
    encode_ints(exception_rows, packer_, column.frame);
    put_distinct(distinct_of(exceptions), packer_, column.frame);
  }
  encode_ints(values, packer_, column.frame);
  add_statistics(style, values, exception_rows, column.entry);
  seal(column);
  return true;
}

bool ColumnWriter::as_composite(std::span<const std::string_view> texts, int depth, EncodedColumn& column) {
  const char kind = texts[0].empty() ? '\0' : texts[0].front();
  if ((kind != '[' && kind != '"') || depth >= kMaxNesting) {
    return false;
  }
  std::string shape;
  std::string first_shape;
  std::vector<std::string_view> leaves;
  std::vector<std::vector<std::string_view>> parts;
  for (const std::string_view text : texts) {
    if (kind == '"') {
      split_digits(text, shape, leaves);
    } else if (!split_json(text, true, shape, leaves)) {
      return false;
    }
    if (parts.empty()) {
      if (leaves.empty() || leaves.size() > (kind == '"' ? kMaxRuns : kMaxParts)) {
        return false;
      }
      first_shape = shape;
      parts.resize(leaves.size());
    }
    if (shape != first_shape) {
      return false;
    }
    for (std::size_t k = 0; k < parts.size(); ++k) {
      parts[k].push_back(leaves[k]);
    }
  }
  column.entry.form = ColumnForm::composite;
  column.entry.count = static_cast<std::uint32_t>(texts.size());
  const std::string_view whole(first_shape);
  put_texts({&whole, 1}, packer_, column.frame);
  seal(column);
  for (const std::vector<std::string_view>& part : parts) {
    column.children.push_back(encode(part, LeafType::json, depth + 1));
  }
  return true;
}

std::vector<NumberStyle> ColumnWriter::styles(std::span<const std::string_view> texts, LeafType type) const {
  const auto fixed = [&](NumberKind kind) {
    NumberStyle style;
    style.kind = kind;
    style.order = order_;
    return std::vector<NumberStyle>{style};
  };
  switch (type) {
    case LeafType::json:
      return json_styles(texts);
    case LeafType::bytes:
      return {};
    case LeafType::word:
      return fixed(NumberKind::word);
    case LeafType::dword:
      return fixed(NumberKind::dword);
    case LeafType::real:
      return float_styles(texts, order_);
    case LeafType::inputs:
      return fixed(NumberKind::byte);
  }
  return {};
}

EncodedColumn ColumnWriter::encode(std::span<const std::string_view> texts, LeafType type, int depth) {
  if (std::all_of(texts.begin(), texts.end(), [&](std::string_view text) { return text == texts[0]; })) {
    EncodedColumn column;
    column.constant = texts[0];
    return column;
  }
  std::optional<EncodedColumn> best;
  const auto offer = [&](EncodedColumn&& candidate) {
    if (!best || candidate.bytes() < best->bytes()) {
      best = std::move(candidate);
    }
  };
  for (const NumberStyle& style : styles(texts, type)) {
    EncodedColumn column;
    if (as_numbers(texts, style, column)) {
      offer(std::move(column));
    }
  }
  constexpr std::size_t kFewExceptions = 10;
  if (best && best->entry.exceptions <= texts.size() / kFewExceptions) {
    return std::move(*best);
  }
  offer(as_texts(texts));
  EncodedColumn composite;
  if (!best || type != LeafType::json || !many_texts(distinct_of(texts)) || !as_composite(texts, depth, composite)) {
    return std::move(*best);
  }
  offer(std::move(composite));
  return std::move(*best);
}

}  // namespace tacho::store
