// Reading the values of one path of a block, in bulk.

#include <algorithm>
#include <array>
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
  out.alike = false;
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
  out.alike = true;
}

/// A column of one leaf, value by value as it is stored. `column` has no numbers: those come run by run.
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

  /// Before the first run of numbers.
  void start_numbers(std::size_t count) const {
    resize(out, count, want);
    std::fill(out.kind.begin(), out.kind.end(), ValueKind::number);
    std::fill(out.text.begin(), out.text.end(), 0);
    out.alike = true;
  }
  void numbers(std::size_t begin, std::span<const std::int64_t> values) const {
    if (want.reals) {
      to_reals(column.style, values, out.real.data() + begin);
    }
    if (want.integers && type == LeafType::json) {
      integers(begin, values);
    } else if (want.integers) {
      register_integers(begin, values);
    }
  }
  /// After the last run of numbers.
  void exceptions() const {
    for (std::size_t i = 0; i < column.exception_rows.size(); ++i) {
      put(out, static_cast<std::size_t>(column.exception_rows[i]), meaning(column.texts[i]), want);
    }
    out.alike = out.alike && column.exception_rows.empty();
  }
  void texts() const {
    std::vector<Meaning> meanings;
    for (const std::string_view text : column.texts) {
      meanings.push_back(meaning(text));
    }
    resize(out, column.values.size(), want);
    out.alike = std::all_of(meanings.begin(), meanings.end(),
                            [&](const Meaning& meaning) { return meaning.kind == meanings[0].kind; });
    if (out.alike) {
      std::fill(out.kind.begin(), out.kind.end(), meanings[0].kind);
    } else {
      each(meanings, &Meaning::kind, out.kind);
    }
    each(meanings, &Meaning::real, out.real);
    each(meanings, &Meaning::integer, out.integer);
    each(meanings, &Meaning::text, out.text);
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

 private:
  /// Whole numbers, from the reals unless the column holds whole numbers itself.
  void integers(std::size_t begin, std::span<const std::int64_t> values) const {
    std::int64_t* const integers = out.integer.data() + begin;
    ValueKind* const kinds = out.kind.data() + begin;
    if (column.style.kind == NumberKind::decimal && column.style.decimals == 0) {
      std::transform(values.begin(), values.end(), integers,
                     [](std::int64_t value) { return value < 0 ? value + 1 : value; });
      std::fill_n(kinds, values.size(), ValueKind::whole);
      return;
    }
    std::array<double, IntReader::kRun> reals{};
    to_reals(column.style, values, reals.data());
    for (std::size_t i = 0; i < values.size(); ++i) {
      kinds[i] = to_whole(reals[i], integers[i]) ? ValueKind::whole : ValueKind::number;
    }
    out.alike = false;
  }
  void register_integers(std::size_t begin, std::span<const std::int64_t> values) const {
    std::int64_t* const integers = out.integer.data() + begin;
    if (column.style.kind == NumberKind::float_decimal) {
      std::string bytes;
      for (std::size_t i = 0; i < values.size(); ++i) {
        bytes.clear();
        append_number(column.style, values[i], bytes);
        integers[i] = register_bits(bytes, column.style.order);
      }
      return;
    }
    std::copy(values.begin(), values.end(), integers);
    if (column.style.kind != NumberKind::float_bits) {
      std::fill_n(out.kind.data() + begin, values.size(), ValueKind::whole);
    }
  }
  /// One property of the meaning of every value of a column of texts; nothing where it is not wanted.
  template <class T>
  void each(const std::vector<Meaning>& meanings, T Meaning::*property, std::vector<T>& values) const {
    for (std::size_t i = 0; i < values.size(); ++i) {
      values[i] = meanings[static_cast<std::size_t>(column.values[i])].*property;
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
  out.alike = false;
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
  if (!present_rows(leaf, present)) {
    return false;
  }
  const std::size_t rows = present.empty() ? head_.rows : rows_of_leaf_[leaf];
  if (rows == 0) {
    fill(out, head_.rows, {}, want);
    return true;
  }
  const LeafReading reading{column_, description.type, head_.order, want, pool, out};
  const IntReader::UseRun numbers = [&](std::size_t begin, std::span<const std::int64_t> values) {
    if (begin == 0) {
      reading.start_numbers(rows);
    }
    reading.numbers(begin, values);
  };
  if (!load_leaf(leaf, column_, &numbers)) {
    return false;
  }
  switch (column_.form) {
    case ColumnForm::constant:
      fill(out, rows, reading.meaning(column_.texts[0]), want);
      break;
    case ColumnForm::numbers:
      reading.exceptions();
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
  out.alike = false;
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
