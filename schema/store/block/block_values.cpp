// Reading the values of one path of a block, in bulk.

#include <algorithm>
#include <utility>

#include "schema/store/block/block_decoder.hpp"
#include "schema/store/block/row_text.hpp"

namespace tacho::store {

namespace {

/// Meaning of one text of a column.
struct Meaning {
  ValueKind kind = ValueKind::absent;
  double real = 0;
  std::int64_t integer = 0;
  std::uint32_t text = 0;
};

Meaning meaning_of(std::string_view json, Want want, TextPool& pool) {
  const JsonValue value = json_value(json);
  Meaning meaning{value.kind, value.real, value.integer, 0};
  if (meaning.kind == ValueKind::whole && !want.integers) {
    meaning.kind = ValueKind::number;
  }
  if (want.texts && value.kind == ValueKind::text) {
    meaning.text = pool.intern(unescape(json));
  } else if (want.texts && (value.kind == ValueKind::array || value.kind == ValueKind::object)) {
    meaning.text = pool.intern(json);
  }
  return meaning;
}

/// Meaning of the bytes of a register leaf.
Meaning meaning_of_register(std::string_view bytes, LeafType type, WordOrder order, Want want) {
  NumberStyle style;
  style.order = order;
  style.kind = type == LeafType::inputs  ? NumberKind::byte
               : type == LeafType::word  ? NumberKind::word
               : type == LeafType::dword ? NumberKind::dword
                                         : NumberKind::float_bits;
  Meaning meaning;
  if (const std::optional<std::int64_t> value = number_value(style, bytes)) {
    meaning.kind = type != LeafType::real && want.integers ? ValueKind::whole : ValueKind::number;
    meaning.integer = *value;
    to_reals(style, {&*value, 1}, &meaning.real);
  }
  return meaning;
}

void resize(ColumnValues& out, std::size_t count, Want want) {
  out.kind.resize(count);
  out.real.resize(want.reals ? count : 0);
  out.integer.resize(want.integers ? count : 0);
  out.text.resize(want.texts ? count : 0);
}

void put(ColumnValues& out, std::size_t i, const Meaning& meaning, Want want) {
  out.kind[i] = meaning.kind;
  if (want.reals) {
    out.real[i] = meaning.real;
  }
  if (want.integers) {
    out.integer[i] = meaning.integer;
  }
  if (want.texts) {
    out.text[i] = meaning.text;
  }
}

void fill(ColumnValues& out, std::size_t count, const Meaning& meaning, Want want) {
  out.kind.assign(count, meaning.kind);
  out.real.assign(want.reals ? count : 0, meaning.real);
  out.integer.assign(want.integers ? count : 0, meaning.integer);
  out.text.assign(want.texts ? count : 0, meaning.text);
}

/// Integers of a column of JSON numbers, from the reals unless the column holds whole numbers itself.
void integers_of(const LoadedColumn& column, std::span<const double> reals, ColumnValues& out) {
  if (column.style.kind == NumberKind::decimal && column.style.decimals == 0) {
    std::transform(column.values.begin(), column.values.end(), out.integer.begin(),
                   [](std::int64_t value) { return value < 0 ? value + 1 : value; });
    std::fill(out.kind.begin(), out.kind.end(), ValueKind::whole);
    return;
  }
  for (std::size_t i = 0; i < reals.size(); ++i) {
    out.kind[i] = to_whole(reals[i], out.integer[i]) ? ValueKind::whole : ValueKind::number;
  }
}

void register_integers_of(const LoadedColumn& column, ColumnValues& out) {
  switch (column.style.kind) {
    case NumberKind::float_decimal: {
      std::string bytes;
      for (std::size_t i = 0; i < column.values.size(); ++i) {
        bytes.clear();
        append_number(column.style, column.values[i], bytes);
        out.integer[i] = register_bits(bytes, column.style.order);
      }
      return;
    }
    case NumberKind::float_bits:
      std::copy(column.values.begin(), column.values.end(), out.integer.begin());
      return;
    default:
      std::copy(column.values.begin(), column.values.end(), out.integer.begin());
      std::fill(out.kind.begin(), out.kind.end(), ValueKind::whole);
  }
}

/// A column of one leaf, value by value as it is stored.
struct LeafReading {
  const LoadedColumn& column;
  LeafType type;
  WordOrder order;
  Want want;
  TextPool& pool;
  ColumnValues& out;

  [[nodiscard]] Meaning meaning(std::string_view text) const {
    return type == LeafType::json ? meaning_of(text, want, pool) : meaning_of_register(text, type, order, want);
  }

  void numbers() const {
    const std::size_t count = column.values.size();
    fill(out, count, {ValueKind::number, 0, 0, 0}, want);
    const bool through_reals = type == LeafType::json && want.integers;
    std::vector<double> temporary(want.reals || !through_reals ? 0 : count);
    double* const reals = want.reals ? out.real.data() : temporary.data();
    if (want.reals || through_reals) {
      to_reals(column.style, column.values, reals);
    }
    if (through_reals) {
      integers_of(column, {reals, count}, out);
    } else if (want.integers) {
      register_integers_of(column, out);
    }
    for (std::size_t i = 0; i < column.exception_rows.size(); ++i) {
      put(out, static_cast<std::size_t>(column.exception_rows[i]), meaning(column.texts[i]), want);
    }
  }
  void texts() const {
    std::vector<Meaning> meanings;
    for (const std::string_view text : column.texts) {
      meanings.push_back(meaning(text));
    }
    resize(out, column.values.size(), want);
    for (std::size_t i = 0; i < column.values.size(); ++i) {
      put(out, i, meanings[static_cast<std::size_t>(column.values[i])], want);
    }
  }
  void composite(std::size_t count) const {
    resize(out, count, want);
    std::string text;
    for (std::size_t i = 0; i < count; ++i) {
      text.clear();
      column.append(i, text);
      put(out, i, meaning(text), want);
    }
  }
};

/// Moves values to the rows that have them, from the back so that nothing is overwritten.
template <class T>
void spread(std::vector<T>& values, const std::vector<bool>& present, T missing) {
  std::size_t next = values.size();
  if (next == 0) {
    return;
  }
  values.resize(present.size());
  for (std::size_t row = present.size(); row-- > 0;) {
    values[row] = present[row] ? values[--next] : missing;
  }
}

void spread_all(ColumnValues& out, const std::vector<bool>& present) {
  spread(out.kind, present, ValueKind::absent);
  spread(out.real, present, 0.0);
  spread(out.integer, present, std::int64_t{0});
  spread(out.text, present, std::uint32_t{0});
}

}  // namespace

bool BlockDecoder::present_rows(std::uint32_t leaf, std::vector<bool>& present) {
  if (head_.raw_rows == 0 && table_->columns()[leaf].shapes == table_->shapes().size()) {
    return true;
  }
  if (!load_shape_of_row()) {
    return false;
  }
  std::vector<bool> has(table_->shapes().size() + 1);
  for (std::size_t s = 0; s < table_->shapes().size(); ++s) {
    const std::vector<std::uint32_t>& columns = table_->shapes()[s].columns;
    has[s + 1] = std::find(columns.begin(), columns.end(), leaf) != columns.end();
  }
  present.resize(head_.rows);
  for (std::size_t row = 0; row < head_.rows; ++row) {
    present[row] = has[static_cast<std::size_t>(shape_of_row_[row])];
  }
  return true;
}

std::string BlockDecoder::read(const std::string& path, Want want, TextPool& pool, ColumnValues& out) {
  reader_.set_budget(kBlockBudget);
  if (!shapes_good_) {
    return "the shapes of the block are damaged";
  }
  const std::optional<std::uint32_t> leaf = table_->find(path);
  if (!leaf) {
    fill(out, head_.rows, {}, want);
  } else if (!read_leaf(*leaf, want, pool, out)) {
    return "column " + path + " is damaged";
  }
  return table_->has_object(path) ? read_object(path, want, pool, out) : "";
}

bool BlockDecoder::read_leaf(std::uint32_t leaf, Want want, TextPool& pool, ColumnValues& out) {
  const LeafColumn& description = table_->columns()[leaf];
  std::vector<bool> present;
  if (!present_rows(leaf, present) || !load_leaf(leaf, column_)) {
    return false;
  }
  const std::size_t rows = present.empty() ? head_.rows : rows_of_leaf_[leaf];
  const LeafReading reading{column_, description.type, head_.order, want, pool, out};
  switch (column_.form) {
    case ColumnForm::constant:
      fill(out, rows, reading.meaning(column_.texts[0]), want);
      break;
    case ColumnForm::numbers:
      reading.numbers();
      break;
    case ColumnForm::texts:
      reading.texts();
      break;
    case ColumnForm::composite:
      reading.composite(rows);
      break;
  }
  if (!present.empty()) {
    spread_all(out, present);
  }
  return true;
}

std::string BlockDecoder::read_object(const std::string& path, Want want, TextPool& pool, ColumnValues& out) {
  if (!load_shape_of_row()) {
    return "the shapes of the rows are damaged";
  }
  std::vector<ShapePart> parts;
  for (const Shape& shape : table_->shapes()) {
    const auto object = std::find_if(shape.objects.begin(), shape.objects.end(),
                                     [&](const JsonObject& candidate) { return candidate.path == path; });
    ShapePart& part = parts.emplace_back();
    if (object != shape.objects.end()) {
      part = {object->begin, object->end, object->first, object->last};
    }
  }
  std::vector<LoadedColumn> loaded(table_->columns().size());
  RowText text(*table_, parts, [&](std::uint32_t leaf) -> const LoadedColumn* {
    return load_leaf(leaf, loaded[leaf]) ? &loaded[leaf] : nullptr;
  });
  if (!text.missing().empty()) {
    return "column " + text.missing() + " is damaged";
  }
  std::string body;
  for (std::size_t row = 0; row < head_.rows; ++row) {
    const auto shape = static_cast<std::size_t>(shape_of_row_[row]);
    if (shape == 0) {
      continue;
    }
    body.clear();
    const bool given = text.append(shape - 1, body);
    // A scalar under the same key came first where both are there.
    if (given && out.kind[row] == ValueKind::absent) {
      const std::uint32_t id = want.texts ? pool.intern(body) : 0;
      put(out, row, {ValueKind::object, 0, 0, id}, want);
    }
  }
  return "";
}

}  // namespace tacho::store
