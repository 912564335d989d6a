#include "schema/wire/status_json.hpp"

#include <simdjson.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include "schema/wire/json_items.hpp"
#include "schema/wire/key_index.hpp"
#include "schema/wire/raw_members.hpp"
#include "schema/wire/validity.hpp"

namespace tacho::wire {

namespace {

using simdjson::SUCCESS;
using simdjson::dom::element;

/// After a larger body the parser's memory is given back.
constexpr std::size_t kKeptBodyBytes = 1u << 20;

static_assert(std::all_of(kFields.begin(), kFields.end(),
                          [](const Field& f) { return f.json.scale == 1.0 || f.kind == Kind::real; }));

template <std::size_t N>
bool any_of(const FieldSet& set, const std::array<FieldIndex, N>& fields) {
  return std::any_of(fields.begin(), fields.end(), [&](FieldIndex f) { return set.test(f); });
}

template <std::size_t N>
void add_all(FieldSet& set, const std::array<FieldIndex, N>& fields) {
  for (const FieldIndex f : fields) {
    set.set(f);
  }
}

/// What has to be looked at to answer `wanted`: lists as a whole, and the flags that conditions name.
FieldSet needed_for(const FieldSet& wanted) {
  FieldSet needed = wanted;
  if (any_of(wanted, kAlarmFields)) {
    add_all(needed, kAlarmFields);
  }
  if (any_of(wanted, kPointFields)) {
    add_all(needed, kPointFields);
  }
  for (std::size_t i = 0; i < kFieldCount; ++i) {
    if (wanted.test(i) && kConditionOf[i] != kNoField) {
      needed.set(kConditionOf[i]);
    }
  }
  return needed;
}

/// One body being decoded.
class Decoding {
 public:
  Decoding(const FieldSet& needed, bool collect_unknown, Sample& out)
      : needed_(needed), collect_unknown_(collect_unknown), unknown_(collect_unknown, out), out_(out) {}

  void run(simdjson::dom::object root, std::string_view body) {
    RawMembers raw(body);
    walk(kRootNode, root, raw);
    decode_lists();
    apply_conditions();
    std::sort(out_.unknown_keys.begin(), out_.unknown_keys.end());
    out_.unknown_keys.erase(std::unique(out_.unknown_keys.begin(), out_.unknown_keys.end()), out_.unknown_keys.end());
  }

 private:
  const FieldSet& needed_;
  bool collect_unknown_;
  UnknownKeys unknown_;
  Sample& out_;
  FieldSet from_former_;
  // Arrays are decoded after the walk, when it is known which of them are there.
  std::array<std::optional<element>, kAlarmFields.size()> alarms_;
  std::array<std::optional<element>, kSolutionFields.size()> solutions_;
  std::array<std::optional<element>, kPointFields.size()> points_;
  std::optional<element> nested_alarms_;

  void walk(NodeId node, simdjson::dom::object object, RawMembers& raw) {
    const KeyIndex& keys = KeyIndex::instance();
    std::size_t index = 0;
    for (const auto& [key, value] : object) {
      const KeyEntry* const entry = keys.find(node, key);
      if (entry == nullptr) {
        if (collect_unknown_) {
          unknown_.add("", keys.path(node, key));
        }
      } else if (entry->field == kNoField) {
        flattened(entry->node, value, raw, index);
      } else {
        member(*entry, value, raw, index);
      }
      ++index;
    }
  }

  void flattened(NodeId node, element value, RawMembers& raw, std::size_t index) {
    simdjson::dom::object object;
    if (value.get(object) == SUCCESS) {
      RawMembers members(raw, index);
      walk(node, object, members);
      return;
    }
    for (const auto& [f, former] : KeyIndex::instance().below(node)) {
      if (needed_.test(f) && out_.cells[f].state == State::absent) {
        out_.cells[f].state = value.is_null() ? State::null : State::wrong_type;
        from_former_.set(f, former);
      }
    }
  }

  void member(const KeyEntry& entry, element value, RawMembers& raw, std::size_t index) {
    capture(entry.field, value);
    if (!needed_.test(entry.field)) {
      return;
    }
    // The first of a doubled key counts, and the present spelling beats the former one wherever it stands.
    Cell& cell = out_.cells[entry.field];
    if (cell.state != State::absent && (entry.former || !from_former_.test(entry.field))) {
      return;
    }
    from_former_.set(entry.field, entry.former);
    cell = value.is_null() ? Cell{State::null} : decode_cell(kFields[entry.field], value, raw, index);
  }

  /// Remembers arrays that decode_lists() needs.
  void capture(FieldIndex field, element value) {
    if (field == kNestedAlarmsField) {
      nested_alarms_ = nested_alarms_.value_or(value);
    } else if (kFields[field].kind == Kind::alarms) {
      keep(alarms_, kAlarmFields, field, value);
    } else if (kFields[field].kind == Kind::points) {
      keep(points_, kPointFields, field, value);
    } else if (kFields[field].kind == Kind::structured) {
      keep(solutions_, kSolutionFields, field, value);
    }
  }

  /// Nothing when `field` is none of `fields` or came before.
  template <std::size_t N>
  static void keep(std::array<std::optional<element>, N>& slots, const std::array<FieldIndex, N>& fields,
                   FieldIndex field, element value) {
    const auto slot = static_cast<std::size_t>(std::find(fields.begin(), fields.end(), field) - fields.begin());
    if (slot < N && !slots[slot]) {
      slots[slot] = value;
    }
  }

  Cell decode_cell(const Field& field, element value, RawMembers& raw, std::size_t index) {
    switch (field.kind) {
      case Kind::real:
        return real_cell(field, value, raw, index);
      case Kind::integer:
      case Kind::code:
        return integer_cell(field, to_integer(value));
      case Kind::flag:
        return flag_cell(to_flag(value));
      case Kind::text: {
        std::string_view text;
        return value.get(text) == SUCCESS ? text_cell(text) : Cell{State::wrong_type};
      }
      case Kind::list:
        return value.is_array() ? text_cell(raw.value(index)) : Cell{State::wrong_type};
      case Kind::structured:
        return value.is_array() || value.is_object() ? text_cell(raw.value(index)) : Cell{State::wrong_type};
      case Kind::alarms:
      case Kind::points:
        break;  // decode_lists()
    }
    return Cell{};
  }

  static Cell real_cell(const Field& field, element value, RawMembers& raw, std::size_t index) {
    double number = 0.0;
    if (value.get(number) != SUCCESS) {
      return Cell{State::wrong_type};
    }
    if (number == 0.0 && field.sentinel == Sentinel::negative_zero && value.is_int64() &&
        raw.value(index).substr(0, 1) == "-") {
      number = -0.0;  // the parser reads "-0" as the integer 0
    }
    const State state = is_sentinel(field.sentinel, number) ? State::not_supplied : State::present;
    return Cell{state, without_minus_zero(field.sentinel, number * field.json.scale), 0};
  }

  static Cell integer_cell(const Field& field, std::optional<std::int64_t> number) {
    if (!number) {
      return Cell{State::wrong_type};
    }
    const bool mark = is_sentinel(field.sentinel, static_cast<double>(*number));
    return Cell{mark ? State::not_supplied : State::present, 0.0, *number};
  }

  static Cell flag_cell(std::optional<bool> flag) {
    return flag ? Cell{State::present, 0.0, *flag ? 1 : 0} : Cell{State::wrong_type};
  }

  Cell text_cell(std::string_view text) {
    return Cell{State::present, 0.0, static_cast<std::int64_t>(out_.texts.intern(text))};
  }

  void decode_lists() {
    if (any_of(needed_, kAlarmFields)) {
      for (std::size_t level = 0; level < alarms_.size(); ++level) {
        if (alarms_[level]) {
          tell_odd(decode_alarms(static_cast<AlarmLevel>(level), *alarms_[level], unknown_, out_), "",
                   kAlarmFields[level]);
        }
      }
      decode_nested_alarms();
      for (std::size_t level = 0; level < solutions_.size(); ++level) {
        if (solutions_[level]) {
          attach_solutions(static_cast<AlarmLevel>(level), *solutions_[level], out_);
        }
      }
    }
    if (any_of(needed_, kPointFields)) {
      for (std::size_t i = 0; i < points_.size(); ++i) {
        if (points_[i]) {
          tell_odd(decode_points(i == 1, *points_[i], unknown_, out_), "", kPointFields[i]);
        }
      }
    }
  }

  /// An element of a list that could not be read is told as the unknown key "errors[]".
  void tell_odd(bool whole, std::string_view parent, FieldIndex list) {
    if (!whole && collect_unknown_) {
      unknown_.add(parent, std::string(kFields[list].json.key) + "[]");
    }
  }

  /// Reports of a fleet manager carry the same alarms twice; the nested ones count only where the flat array is absent.
  void decode_nested_alarms() {
    simdjson::dom::object nested;
    if (!nested_alarms_ || nested_alarms_->get(nested) != SUCCESS) {
      return;
    }
    UnknownKeys nothing(false, out_);  // inside a structured key
    for (std::size_t level = 0; level < kAlarmFields.size(); ++level) {
      element list;
      if (!alarms_[level] && nested[kFields[kAlarmFields[level]].json.key].get(list) == SUCCESS) {
        tell_odd(decode_alarms(static_cast<AlarmLevel>(level), list, nothing, out_),
                 kFields[kNestedAlarmsField].json.key, kAlarmFields[level]);
      }
    }
  }

  void apply_conditions() {
    for (std::size_t i = 0; i < kFieldCount; ++i) {
      if (kConditionOf[i] == kNoField || !needed_.test(i)) {
        continue;
      }
      const Cell& flag = out_.cells[kConditionOf[i]];
      State& state = out_.cells[i].state;
      const bool given = state == State::present || state == State::not_supplied;
      if (given && !(flag.has() && flag.integer != 0)) {
        state = State::not_meaningful;
      }
    }
  }
};

}  // namespace

struct JsonDecoder::Impl {
  simdjson::dom::parser parser;
  FieldSet wanted;  // of the last call
  FieldSet needed;  // needed_for(wanted)
};

JsonDecoder::JsonDecoder() : impl_(std::make_unique<Impl>()) {}
JsonDecoder::~JsonDecoder() = default;
JsonDecoder::JsonDecoder(JsonDecoder&&) noexcept = default;
JsonDecoder& JsonDecoder::operator=(JsonDecoder&&) noexcept = default;

void JsonDecoder::decode(std::string_view body, const FieldSet& wanted, bool collect_unknown, Sample& out) {
  const AnswerMeta meta = out.meta;
  out.clear();
  out.meta = meta;
  if (wanted != impl_->wanted) {
    impl_->wanted = wanted;
    impl_->needed = needed_for(wanted);
  }
  simdjson::dom::element root;
  simdjson::dom::object object;
  // The parser copies the body once into its own padded buffer, kept from call to call.
  if (impl_->parser.parse(body.data(), body.size()).get(root) == SUCCESS && root.get(object) == SUCCESS) {
    Decoding(impl_->needed, collect_unknown, out).run(object, body);
  } else {
    out.decodable = false;
  }
  if (body.size() > kKeptBodyBytes) {
    impl_->parser = simdjson::dom::parser();
  }
}

}  // namespace tacho::wire
