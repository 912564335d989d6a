#include "schema/wire/json_items.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <map>

namespace tacho::wire {

namespace {

using simdjson::SUCCESS;
using simdjson::dom::element;

// Keys of an alarm that are known and not kept beside the raw answer: its time as text, in the vendor's two spellings.
constexpr std::array<std::string_view, 2> kAlarmTimeTexts{"dateTime", "dataTime"};
/// What the controller says about an alarm, in the order the texts are joined.
constexpr std::array<std::string_view, 3> kSolutionKeys{"describe", "method", "reason"};

bool all_digits(std::string_view text) {
  return !text.empty() && std::all_of(text.begin(), text.end(), [](char c) { return c >= '0' && c <= '9'; });
}

std::optional<std::int64_t> digits(std::string_view text) {
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (!all_digits(text) || error != std::errc() || end != text.data() + text.size()) {
    return std::nullopt;
  }
  return value;
}

/// A number, or a string of digits.
std::optional<std::int64_t> to_code(element value) {
  std::string_view text;
  return value.get(text) == SUCCESS ? digits(text) : to_integer(value);
}

std::string_view to_text(element value) {
  std::string_view text;
  return value.get(text) == SUCCESS ? text : std::string_view{};
}

/// describe, method and reason, joined by newlines.
class SolutionText {
 public:
  /// False when `key` is none of the three.
  bool take(std::string_view key, element value) {
    const auto* const found = std::find(kSolutionKeys.begin(), kSolutionKeys.end(), key);
    if (found == kSolutionKeys.end()) {
      return false;
    }
    parts_[static_cast<std::size_t>(found - kSolutionKeys.begin())] = to_text(value);
    return true;
  }
  void take_all(simdjson::dom::object object) {
    for (const auto& [key, value] : object) {
      take(key, value);
    }
  }
  [[nodiscard]] std::string joined() const {
    std::string text;
    for (const std::string_view part : parts_) {
      if (!part.empty()) {
        text += text.empty() ? "" : "\n";
        text += part;
      }
    }
    return text;
  }

 private:
  std::array<std::string_view, kSolutionKeys.size()> parts_;
};

/// One alarm element while its keys, in any order, are read.
struct AlarmParts {
  std::optional<std::int64_t> code;  // key `code`
  std::optional<std::int64_t> digit_key;
  std::optional<std::int64_t> digit_stamp;
  std::optional<std::int64_t> timestamp;
  std::optional<std::int64_t> times;
  std::string_view desc;
  SolutionText solution;

  /// False when the key is unknown.
  bool take(std::string_view key, element value) {
    if (all_digits(key)) {
      if (!digit_key) {
        digit_key = digits(key);
        digit_stamp = to_integer(value);
      }
    } else if (key == "code") {
      code = to_code(value);
    } else if (key == "timestamp") {
      timestamp = to_integer(value);
    } else if (key == "times") {
      times = to_integer(value);
    } else if (key == "desc") {
      desc = to_text(value);
    } else {
      return std::find(kAlarmTimeTexts.begin(), kAlarmTimeTexts.end(), key) != kAlarmTimeTexts.end() ||
             solution.take(key, value);
    }
    return true;
  }
};

bool decode_alarm(AlarmLevel level, element value, UnknownKeys& unknown, Sample& out) {
  simdjson::dom::object object;
  if (value.get(object) != SUCCESS) {
    return false;
  }
  AlarmParts parts;
  for (const auto& [key, member] : object) {
    if (!parts.take(key, member)) {
      unknown.add(kFields[kAlarmFields[static_cast<std::size_t>(level)]].json.key, key);
    }
  }
  if (!parts.code && !parts.digit_key) {
    return false;
  }
  AlarmItem item;
  item.level = level;
  item.code = parts.code ? *parts.code : *parts.digit_key;
  item.stamp_s = parts.digit_stamp ? *parts.digit_stamp : parts.timestamp.value_or(0);
  item.times = parts.times.value_or(0);
  item.desc = out.texts.intern(parts.desc);
  item.solution = out.texts.intern(parts.solution.joined());
  out.alarms.push_back(item);
  return true;
}

bool decode_point_object(simdjson::dom::object object, std::string_view list, UnknownKeys& unknown, IoPoint& point,
                         Sample& out) {
  std::optional<std::int64_t> id;
  std::optional<bool> status;
  for (const auto& [key, member] : object) {
    if (key == "id") {
      id = to_integer(member);
    } else if (key == "status") {
      status = to_flag(member);
    } else if (key == "valid") {
      const std::optional<bool> valid = to_flag(member);
      point.valid = static_cast<std::int8_t>(valid ? (*valid ? 1 : 0) : -1);
    } else if (key == "source") {
      point.source = out.texts.intern(to_text(member));
    } else {
      unknown.add(list, key);
    }
  }
  if (!id || !status || *id < std::numeric_limits<std::int32_t>::min() ||
      *id > std::numeric_limits<std::int32_t>::max()) {
    return false;
  }
  point.id = static_cast<std::int32_t>(*id);
  point.status = *status;
  return true;
}

bool decode_point(element value, std::string_view list, UnknownKeys& unknown, IoPoint& point, Sample& out) {
  simdjson::dom::object object;
  if (value.get(object) == SUCCESS) {
    return decode_point_object(object, list, unknown, point, out);
  }
  const std::optional<bool> status = to_flag(value);
  point.status = status.value_or(false);
  return status.has_value();
}

State state_of_other(element value) { return value.is_null() ? State::null : State::wrong_type; }

/// Of an array of which `read` elements could be read.
Cell list_cell(std::size_t read, bool whole) {
  return {whole || read > 0 ? State::present : State::wrong_type, 0.0, static_cast<std::int64_t>(read)};
}

}  // namespace

std::optional<std::int64_t> to_integer(element value) {
  std::int64_t integer = 0;
  if (value.get(integer) == SUCCESS) {
    return integer;
  }
  double real = 0.0;
  constexpr double kLimit = 9.2e18;  // below 2^63: everything in between converts
  if (!value.is_double() || value.get(real) != SUCCESS || std::abs(real) > kLimit || std::trunc(real) != real) {
    return std::nullopt;
  }
  return static_cast<std::int64_t>(real);
}

std::optional<bool> to_flag(element value) {
  bool flag = false;
  if (value.get(flag) == SUCCESS) {
    return flag;
  }
  const std::optional<std::int64_t> number = to_integer(value);
  return number && (*number == 0 || *number == 1) ? std::optional<bool>(*number == 1) : std::nullopt;
}

void UnknownKeys::add(std::string_view parent, std::string_view key) {
  if (out_ == nullptr) {
    return;
  }
  std::string path(parent);
  path += parent.empty() ? "" : ".";
  path += key;
  out_->unknown_keys.push_back(std::move(path));
}

bool decode_alarms(AlarmLevel level, element list, UnknownKeys& unknown, Sample& out) {
  Cell& cell = out.cells[kAlarmFields[static_cast<std::size_t>(level)]];
  simdjson::dom::array array;
  if (list.get(array) != SUCCESS) {
    cell.state = state_of_other(list);
    return true;
  }
  const std::size_t before = out.alarms.size();
  bool whole = true;
  for (const element value : array) {
    whole = decode_alarm(level, value, unknown, out) && whole;
  }
  cell = list_cell(out.alarms.size() - before, whole);
  out.alarms_incomplete.set(static_cast<std::size_t>(level), cell.has() && !whole);
  return whole;
}

void attach_solutions(AlarmLevel level, element list, Sample& out) {
  simdjson::dom::array array;
  if (list.get(array) != SUCCESS) {
    return;
  }
  std::map<std::int64_t, std::uint32_t> texts;  // code -> text id
  for (const element value : array) {
    simdjson::dom::object object;
    if (value.get(object) != SUCCESS) {
      continue;
    }
    element code;
    if (object["code"].get(code) == SUCCESS) {
      SolutionText text;
      text.take_all(object);
      texts.emplace(to_code(code).value_or(0), out.texts.intern(text.joined()));
    }
    for (const auto& [key, member] : object) {
      simdjson::dom::object words;
      if (all_digits(key) && member.get(words) == SUCCESS) {
        SolutionText text;
        text.take_all(words);
        texts.emplace(digits(key).value_or(0), out.texts.intern(text.joined()));
      }
    }
  }
  for (AlarmItem& item : out.alarms) {
    const auto found = texts.find(item.code);
    if (item.level == level && item.solution == 0 && found != texts.end()) {
      item.solution = found->second;
    }
  }
}

bool decode_points(bool output, element list, UnknownKeys& unknown, Sample& out) {
  const FieldIndex field = kPointFields[output ? 1 : 0];
  Cell& cell = out.cells[field];
  simdjson::dom::array array;
  if (list.get(array) != SUCCESS) {
    cell.state = state_of_other(list);
    return true;
  }
  const std::size_t before = out.points.size();
  bool whole = true;
  std::int32_t index = 0;
  for (const element value : array) {
    IoPoint point;
    point.output = output;
    point.id = index++;  // also counts elements that are left out: old firmware gives no other number
    if (decode_point(value, kFields[field].json.key, unknown, point, out)) {
      out.points.push_back(point);
    } else {
      whole = false;
    }
  }
  cell = list_cell(out.points.size() - before, whole);
  return whole;
}

}  // namespace tacho::wire
