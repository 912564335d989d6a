#include "schema/column_decoder.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "schema/column_cells.hpp"
#include "schema/store/block/image_text.hpp"
#include "schema/wire/registers.hpp"
#include "schema/wire/status_json.hpp"
#include "schema/wire/validity.hpp"

namespace tacho {

namespace {

using store::BlockDecoder;
using store::ColumnValues;
using store::ValueKind;
using store::Want;

constexpr StateOf kReal = states({ValueKind::number, ValueKind::whole});
constexpr StateOf kWhole = states({ValueKind::whole});
constexpr StateOf kFlag = states({ValueKind::flag, ValueKind::whole});
constexpr StateOf kText = states({ValueKind::text});
constexpr StateOf kList = states({ValueKind::array});
constexpr StateOf kStructured = states({ValueKind::array, ValueKind::object});

bool is_list(Kind kind) { return kind == Kind::alarms || kind == Kind::points; }
bool has_text(Kind kind) { return kind == Kind::text || kind == Kind::list || kind == Kind::structured; }

bool given(State state) { return state == State::present || state == State::not_supplied; }

/// Lists of more than scalars, and what their decoding needs beside them.
const std::vector<FieldIndex>& list_fields(bool points) {
  static const std::vector<FieldIndex> kAlarms{
      field("fatals"),          field("errors"),          field("warnings"),        field("notices"),
      field("alarms"),          field("fatals_solution"), field("errors_solution"), field("warnings_solution"),
      field("notices_solution")};
  static const std::vector<FieldIndex> kPoints{field("di"), field("do")};
  return points ? kPoints : kAlarms;
}

}  // namespace

struct ColumnDecoder::Impl {
  wire::JsonDecoder json;
  // Each kind has its own, or vectors would be emptied and filled again from column to column.
  ColumnValues reals;
  ColumnValues integers;
  ColumnValues texts;
  ColumnValues other;
  TextPool scratch;  ///< texts that nobody keeps
  // Of the block that is being decoded:
  BlockDecoder* block = nullptr;
  Batch* out = nullptr;
  std::string* damage = nullptr;

  [[nodiscard]] bool good() const { return damage->empty(); }

  bool read(std::string_view path, Want want, TextPool& pool, ColumnValues& into) {
    *damage = block->read(std::string(path), want, pool, into);
    return good();
  }

  // --- answers in JSON

  /// Where else a field may stand: its former spelling, its place in a push.
  static std::vector<std::string> other_paths(const Field& field) {
    std::vector<std::string> paths;
    if (!field.json.former_key.empty()) {
      paths.emplace_back(field.json.former_key);
    }
    if (const std::string_view nested = push_object(field.json.key); !nested.empty()) {
      paths.push_back(std::string(nested) + "." + std::string(field.json.key));
    }
    return paths;
  }

  bool read_field(const Field& field, Want want, TextPool& pool, ColumnValues& values) {
    if (!read(field.json.key, want, pool, values)) {
      return false;
    }
    if (!any_absent(values)) {
      return true;  // before paths are put together
    }
    for (const std::string& path : other_paths(field)) {
      if (!any_absent(values)) {
        break;
      }
      if (!read(path, want, pool, other)) {
        return false;
      }
      fill_absent(other, values);
    }
    return true;
  }

  /// What stands where an object was expected says why a field in it is missing.
  bool explain_absent(const Field& field, Column& column) {
    std::vector<std::string> paths = other_paths(field);
    paths.insert(paths.begin(), std::string(field.json.key));
    return std::all_of(paths.begin(), paths.end(),
                       [&](const std::string& path) { return explain_absent(path, column); });
  }

  bool explain_absent(std::string_view path, Column& column) {
    for (std::size_t dot = path.find('.'); dot != std::string_view::npos; dot = path.find('.', dot + 1)) {
      const std::string parent(path.substr(0, dot));
      if (!block->shapes().find(parent) ||
          std::find(column.state.begin(), column.state.end(), State::absent) == column.state.end()) {
        continue;
      }
      if (!read(parent, {}, scratch, other)) {
        return false;
      }
      for (std::size_t row = 0; row < column.state.size(); ++row) {
        const ValueKind kind = other.kind[row];
        if (column.state[row] == State::absent && kind != ValueKind::absent && kind != ValueKind::object) {
          column.state[row] = kind == ValueKind::null ? State::null : State::wrong_type;
        }
      }
    }
    return true;
  }

  bool json_column(Column& column) {
    const Field& field = kFields[column.field];
    if (field.json.key.empty()) {
      fill_absent_column(block->head().rows, column);
      return true;
    }
    const bool real = field.kind == Kind::real;
    const bool text = has_text(field.kind);
    ColumnValues& values = real ? reals : text ? texts : integers;
    if (!read_field(field, {real, !real && !text, text}, out->texts, values)) {
      return false;
    }
    bool complete = false;
    switch (field.kind) {
      case Kind::real:
        complete = set_states(kReal, values, column.state);
        put_reals(field, field.json.scale, values.real, column);
        break;
      case Kind::integer:
      case Kind::code:
        complete = set_states(kWhole, values, column.state);
        put_integers(field, values.integer, column);
        break;
      case Kind::flag:
        complete = set_states(kFlag, values, column.state);
        complete = !refuse_odd_flags(values.integer, column.state) && complete;
        std::swap(column.integer, values.integer);
        break;
      default:
        complete = set_states(field.kind == Kind::text   ? kText
                              : field.kind == Kind::list ? kList
                                                         : kStructured,
                              values, column.state);
        column.integer.assign(values.text.begin(), values.text.end());
        break;
    }
    if (complete) {
      return true;
    }
    clear_missing(column);
    return explain_absent(field, column);
  }

  /// The flag that a condition names, asked for or not.
  const Column* condition_column(FieldIndex flag, std::vector<Column>& extra) {
    if (const Column* const column = out->find(flag)) {
      return column;
    }
    Column column;
    column.field = flag;
    if (!json_column(column)) {
      return nullptr;
    }
    extra.push_back(std::move(column));
    return &extra.back();
  }

  bool apply_conditions() {
    std::vector<Column> extra;
    extra.reserve(out->columns.size());
    for (Column& column : out->columns) {
      const FieldIndex flag = wire::kConditionOf[column.field];
      if (flag == kNoField || std::none_of(column.state.begin(), column.state.end(), given)) {
        continue;
      }
      const Column* gate = nullptr;
      for (const Column& known : extra) {
        gate = known.field == flag ? &known : gate;
      }
      gate = gate == nullptr ? condition_column(flag, extra) : gate;
      if (gate == nullptr) {
        return false;
      }
      for (std::size_t i = 0; i < column.state.size(); ++i) {
        if (given(column.state[i]) && !(gate->has(i) && gate->integer[i] != 0)) {
          column.state[i] = State::not_meaningful;
        }
      }
    }
    return true;
  }

  // Arrays that change rarely are few distinct texts: each combination of them is decoded once, as an answer of its
  // own.

  static void append_value(ValueKind kind, std::string_view text, std::string& body) {
    switch (kind) {
      case ValueKind::array:
      case ValueKind::object:
        body += text;
        return;
      case ValueKind::null:
        body += "null";
        return;
      default:
        body += "0";  // every other kind is as wrong as this one
    }
  }

  bool lists(bool points) {
    FieldSet wanted;
    for (const Column& column : out->columns) {
      const Kind kind = kFields[column.field].kind;
      if (kind == (points ? Kind::points : Kind::alarms)) {
        wanted.set(column.field);
      }
    }
    if (wanted.none()) {
      return true;
    }
    const std::size_t rows = block->head().rows;
    const std::vector<FieldIndex>& fields = list_fields(points);
    std::vector<ColumnValues> read_values;
    for (const FieldIndex f : fields) {
      if (!read_field(kFields[f], {false, false, true}, scratch, read_values.emplace_back())) {
        return false;
      }
    }
    std::map<std::vector<std::uint64_t>, std::size_t> known;
    std::vector<Sample> samples;
    std::vector<std::uint64_t> key(fields.size());
    std::vector<std::uint64_t> last;
    std::size_t sample = 0;
    start_lists(points);
    for (std::size_t row = 0; row < rows; ++row) {
      for (std::size_t i = 0; i < fields.size(); ++i) {
        key[i] = static_cast<std::uint64_t>(read_values[i].kind[row]) << 32U | read_values[i].text[row];
      }
      if (key != last) {
        last = key;
        const auto [found, added] = known.try_emplace(key, samples.size());
        sample = found->second;
        if (added) {
          decode_lists(fields, read_values, row, wanted, samples.emplace_back());
        }
      }
      append_lists(samples[sample], points);
    }
    return true;
  }

  void decode_lists(const std::vector<FieldIndex>& fields, const std::vector<ColumnValues>& read_values,
                    std::size_t row, const FieldSet& wanted, Sample& sample) {
    std::string body = "{";
    for (std::size_t i = 0; i < fields.size(); ++i) {
      const ValueKind kind = read_values[i].kind[row];
      if (kind != ValueKind::absent) {
        body += body.size() > 1 ? ",\"" : "\"";
        body += kFields[fields[i]].json.key;
        body += "\":";
        append_value(kind, scratch.at(read_values[i].text[row]), body);
      }
    }
    body += '}';
    json.decode(body, wanted, false, sample);
    const auto move_text = [&](std::uint32_t id) { return out->texts.intern(sample.texts.at(id)); };
    for (AlarmItem& item : sample.alarms) {
      item.desc = move_text(item.desc);
      item.solution = move_text(item.solution);
    }
    for (IoPoint& point : sample.points) {
      point.source = move_text(point.source);
    }
  }

  void start_lists(bool points) {
    for (Column& column : out->columns) {
      if (kFields[column.field].kind == (points ? Kind::points : Kind::alarms)) {
        column.state.clear();
        column.integer.clear();
      }
    }
    (points ? out->point_begin : out->alarm_begin).assign(1, 0);
  }

  void append_lists(const Sample& sample, bool points) {
    for (Column& column : out->columns) {
      if (kFields[column.field].kind == (points ? Kind::points : Kind::alarms)) {
        column.state.push_back(sample.at(column.field).state);
        column.integer.push_back(sample.at(column.field).integer);
      }
    }
    if (points) {
      out->points.insert(out->points.end(), sample.points.begin(), sample.points.end());
      out->point_begin.push_back(static_cast<std::uint32_t>(out->points.size()));
    } else {
      out->alarms.insert(out->alarms.end(), sample.alarms.begin(), sample.alarms.end());
      out->alarm_begin.push_back(static_cast<std::uint32_t>(out->alarms.size()));
      out->alarms_incomplete.push_back(sample.alarms_incomplete);
    }
  }

  bool decode_json() {
    for (Column& column : out->columns) {
      if (!is_list(kFields[column.field].kind) && !json_column(column)) {
        return false;
      }
    }
    return apply_conditions() && lists(false) && lists(true);
  }

  // --- register images

  /// Images have no lists.
  void no_lists() {
    const std::size_t rows = block->head().rows;
    if (!out->alarm_begin.empty()) {
      out->alarm_begin.assign(rows + 1, 0);
      out->alarms_incomplete.assign(rows, {});
    }
    if (!out->point_begin.empty()) {
      out->point_begin.assign(rows + 1, 0);
    }
  }

  bool register_column(WordOrder order, Column& column) {
    const Field& field = kFields[column.field];
    const bool pair = field.reg.words() == 2;
    const WordOrder taken = block->head().order;
    const bool as_reals = gives_numbers(field.reg.type, taken == order);
    ColumnValues& values = as_reals ? reals : integers;
    if (!read(store::register_path(field.reg.address, pair), {as_reals, !as_reals, false}, scratch, values)) {
      return false;
    }
    constexpr StateOf kNumber = states({ValueKind::number, ValueKind::whole});
    bool complete = set_states(kNumber, values, column.state);
    std::vector<double>& numbers = reals.real;
    if (!as_reals) {
      numbers.resize(values.integer.size());
      std::transform(values.integer.begin(), values.integer.end(), numbers.begin(),
                     [&](std::int64_t bits) { return number(field.reg.type, bits, taken, order); });
    }
    if (!all_finite(numbers)) {
      complete = false;
      for (std::size_t i = 0; i < numbers.size(); ++i) {
        column.state[i] = std::isfinite(numbers[i]) ? column.state[i] : State::wrong_type;
      }
    }
    if (field.kind == Kind::real) {
      put_reals(field, field.reg.scale, numbers, column);
    } else {
      integers.integer.resize(numbers.size());
      for (std::size_t i = 0; i < numbers.size(); ++i) {
        integers.integer[i] = column.state[i] == State::present ? static_cast<std::int64_t>(numbers[i]) : 0;
      }
      put_integers(field, integers.integer, column);
    }
    if (!complete) {
      clear_missing(column);
    }
    return true;
  }

  /// The numbers of a block are those of the register, because the block knows its type and took its words in the right
  /// order.
  static bool gives_numbers(RegisterType type, bool same_order) {
    return type == RegisterType::u16 || (same_order && (type == RegisterType::f32 || type == RegisterType::i32));
  }

  /// `bits` as the block gives them, which took pairs of words in the order `taken`.
  static double number(RegisterType type, std::int64_t bits, WordOrder taken, WordOrder order) {
    const auto word = static_cast<std::uint32_t>(bits);
    const auto joined = [&] {
      std::uint16_t first = 0;
      std::uint16_t second = 0;
      wire::split_words(word, taken, first, second);
      return wire::join_words(first, second, order);
    };
    switch (type) {
      case RegisterType::i16:
        return static_cast<std::int16_t>(word);
      case RegisterType::i32:
        return static_cast<std::int32_t>(joined());
      case RegisterType::f32:
        return static_cast<double>(std::bit_cast<float>(joined()));
      case RegisterType::u16:
      case RegisterType::none:
        break;
    }
    return word;
  }

  /// False: the block has the words of a pair one by one, because some range ended between them.
  bool decode_registers(WordOrder order) {
    no_lists();
    for (Column& column : out->columns) {
      const Field& field = kFields[column.field];
      if (!field.reg.present() || field.reg.discrete) {
        fill_absent_column(block->head().rows, column);
        continue;
      }
      for (std::uint32_t word = 0; field.reg.words() == 2 && word < 2; ++word) {
        if (block->shapes().find(store::register_path(field.reg.address + word, false))) {
          return false;
        }
      }
      if (!register_column(order, column)) {
        break;
      }
    }
    return true;
  }

  bool decode_inputs() {
    no_lists();
    std::string loaded;  // path that `integers` holds
    for (Column& column : out->columns) {
      const Field& field = kFields[column.field];
      fill_absent_column(block->head().rows, column);
      if (!field.reg.present() || !field.reg.discrete) {
        continue;
      }
      for (const store::LeafColumn& leaf : block->shapes().columns()) {
        const std::uint32_t address = field.reg.address;
        if (address < leaf.first || address > leaf.last) {
          continue;
        }
        if (leaf.path != loaded && !read(leaf.path, {false, true, false}, scratch, integers)) {
          return true;
        }
        loaded = leaf.path;
        for (std::size_t i = 0; i < integers.kind.size(); ++i) {
          if (integers.kind[i] != ValueKind::absent) {
            column.state[i] = State::present;
            column.integer[i] = integers.integer[i] >> (address - leaf.first) & 1;
          }
        }
      }
    }
    return true;
  }
};

ColumnDecoder::ColumnDecoder() : impl_(std::make_unique<Impl>()) {}
ColumnDecoder::~ColumnDecoder() = default;

bool ColumnDecoder::decode(BlockDecoder& block, const Stream& stream, Batch& out, std::string& damage) {
  if (block.head().raw_rows > 0 || block.shapes().ambiguous()) {
    return false;
  }
  impl_->block = &block;
  impl_->out = &out;
  impl_->damage = &damage;
  impl_->scratch.clear();
  damage.clear();
  switch (source_info(block.head().source).encoding) {
    case Encoding::json:
      impl_->decode_json();
      return true;
    case Encoding::registers:
      return impl_->decode_registers(stream.word_order);
    case Encoding::inputs:
      return impl_->decode_inputs();
  }
  return false;
}

}  // namespace tacho
