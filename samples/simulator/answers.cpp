#include "samples/simulator/answers.hpp"

#include <algorithm>
#include <bit>
#include <cassert>
#include <limits>
#include <nlohmann/json.hpp>
#include <vector>

#include "samples/simulator/json_text.hpp"
#include "samples/simulator/readings.hpp"
#include "samples/simulator/status_slots.hpp"
#include "samples/simulator/status_template.hpp"
#include "schema/wire/registers.hpp"
#include "schema/wire/requests.hpp"

namespace tacho::sim {
namespace {

constexpr int kShapeWithSolutions = 1;
constexpr int kShapeWithNested = 3;

// A piece of an answer: literal text, then one value.
struct Part {
  enum class Value { none, rounded, full, flag, writer };
  When when = When::always;
  std::string literal;
  Value value = Value::none;
  FieldIndex field = kNoField;
  double per_unit = 1;  // JSON number per SI unit
  int decimals = 0;
  SlotWriter writer = nullptr;
};

FieldIndex field_of_key(std::string_view key) {
  for (FieldIndex f = 0; f < kFieldCount; ++f) {
    if (kFields[f].json.key == key) {
      return f;
    }
  }
  assert(false && "a template key with a number must be in the field table");
  return kNoField;
}

// Reads the slot after '@' at `at` into `part`; returns where the text goes on.
std::size_t parse_slot(std::string_view key, std::string_view text, std::size_t at, Part& part) {
  const char c = text[at];
  if (c == '{') {
    const std::size_t end = text.find('}', at);
    part.value = Part::Value::writer;
    part.writer = slot_writer(text.substr(at + 1, end - at - 1));
    return end + 1;
  }
  part.field = field_of_key(key);
  part.per_unit = 1 / kFields[part.field].json.scale;
  part.value = c == 'b' ? Part::Value::flag : c == 'f' ? Part::Value::full : Part::Value::rounded;
  part.decimals = part.value == Part::Value::rounded ? c - '0' : 0;
  return at + 1;
}

// `,"key":value` as parts.
std::vector<Part> parse_key(const StatusKey& row) {
  std::vector<Part> parts;
  std::string literal = ",\"" + std::string(row.key) + "\":";
  std::size_t at = 0;
  while (at < row.value.size()) {
    const std::size_t slot = std::min(row.value.find('@', at), row.value.size());
    literal += row.value.substr(at, slot - at);
    at = slot;
    if (at < row.value.size()) {
      Part& part = parts.emplace_back();
      part.when = row.when;
      part.literal = std::move(literal);
      literal.clear();
      at = parse_slot(row.key, row.value, at + 1, part);
    }
  }
  if (!literal.empty()) {
    Part& part = parts.emplace_back();
    part.when = row.when;
    part.literal = std::move(literal);
  }
  return parts;
}

bool mergeable(const Part& part) { return part.when == When::always && part.value == Part::Value::none; }

// All keys in a row; literals that always follow each other are one.
std::vector<Part> flatten(const std::vector<std::vector<Part>>& keys) {
  std::vector<Part> flat;
  for (const std::vector<Part>& key : keys) {
    for (const Part& part : key) {
      if (!flat.empty() && mergeable(flat.back()) && part.when == When::always) {
        const std::string before = std::move(flat.back().literal);
        flat.back() = part;
        flat.back().literal = before + part.literal;
      } else {
        flat.push_back(part);
      }
    }
  }
  return flat;
}

void append_value(std::string& out, const Part& part, const Moment& m) {
  switch (part.value) {
    case Part::Value::none:
      return;
    case Part::Value::rounded:
      append_rounded(out, m.readings[part.field] * part.per_unit, part.decimals);
      return;
    case Part::Value::full:
      append_shortest(out, m.readings[part.field] * part.per_unit);
      return;
    case Part::Value::flag:
      out += m.readings[part.field] != 0 ? "true" : "false";
      return;
    case Part::Value::writer:
      part.writer(out, m);
      return;
  }
}

bool holds(When when, const Moment& m, bool with_lasers) {
  switch (when) {
    case When::always:
      return true;
    case When::battery:
      return m.scenario.battery_fields;
    case When::blocked:
      return m.state.blocked;
    case When::slowed:
      return m.state.slowed;
    case When::lasers:
      return with_lasers;
    case When::solutions:
      return m.scenario.alarm_shape == kShapeWithSolutions;
    case When::nested:
      return m.scenario.alarm_shape == kShapeWithNested;
  }
  return false;
}

void append_parts(std::string& out, const std::vector<Part>& parts, const Moment& m, bool with_lasers) {
  for (const Part& part : parts) {
    if (holds(part.when, m, with_lasers)) {
      out += part.literal;
      append_value(out, part, m);
    }
  }
}

std::int64_t as_integer(double value, std::int64_t lo, std::int64_t hi) {
  return std::clamp<std::int64_t>(std::llround(value), lo, hi);
}

}  // namespace

struct AnswerMaker::Impl {
  explicit Impl(const Scenario& s) : scenario(s), identity(make_identity(s)) {
    for (const StatusKey& row : kStatusKeys) {
      keys.push_back(parse_key(row));
    }
    flat = flatten(keys);
    for (const StatusKey& row : kIoKeys) {
      io_keys.push_back(parse_key(row));
    }
    for (const Part& part : flat) {
      if (part.value == Part::Value::rounded && part.field != field("confidence")) {
        rounding[part.field] = {part.per_unit, part.decimals};
      }
    }
  }

  /// How the controller rounds a field.
  struct Rounding {
    double per_unit = 1;
    int decimals = -1;  ///< not at all
  };

  Scenario scenario;
  Identity identity;
  std::vector<std::vector<Part>> keys;  // like kStatusKeys
  std::vector<Part> flat;
  std::vector<std::vector<Part>> io_keys;
  std::array<Rounding, kFieldCount> rounding{};
  Readings readings;

  Moment read(const RobotState& state) {
    read_sensors(scenario, state, readings);
    return {scenario, identity, state, readings};
  }

  /// What a float register shows of the field, in the unit of the register.
  [[nodiscard]] float in_register(FieldIndex f) const {
    const auto [per_unit, decimals] = rounding[f];
    const bool rounds = scenario.registers_rounded && decimals >= 0;
    const double value = rounds ? rounded(readings[f] * per_unit, decimals) / per_unit : readings[f];
    return static_cast<float>(value / kFields[f].reg.scale);
  }
};

AnswerMaker::AnswerMaker(const Scenario& scenario) : impl_(std::make_unique<Impl>(scenario)) {}
AnswerMaker::~AnswerMaker() = default;
AnswerMaker::AnswerMaker(AnswerMaker&&) noexcept = default;

std::string AnswerMaker::status(const RobotState& state, std::span<const std::string> keys, bool with_lasers) {
  const Moment moment = impl_->read(state);
  std::string out;
  out.reserve(with_lasers ? 100'000 : 10'000);
  if (keys.empty()) {
    append_parts(out, impl_->flat, moment, with_lasers);
  } else {
    for (std::size_t i = 0; i < std::size(kStatusKeys); ++i) {
      const std::string_view key = kStatusKeys[i].key;
      const bool of_every_answer = key == "create_on" || key == "ret_code";
      if (of_every_answer || std::find(keys.begin(), keys.end(), key) != keys.end()) {
        append_parts(out, impl_->keys[i], moment, with_lasers);
      }
    }
  }
  out.front() = '{';
  out += '}';
  return out;
}

std::string AnswerMaker::io(const RobotState& state) {
  const Moment moment = impl_->read(state);
  std::string out;
  out.reserve(4'000);
  for (const std::vector<Part>& key : impl_->io_keys) {
    append_parts(out, key, moment, false);
  }
  out.front() = '{';
  out += '}';
  return out;
}

std::array<std::uint16_t, 140> AnswerMaker::registers(const RobotState& state) {
  impl_->read(state);
  std::array<std::uint16_t, 140> words{};
  for (FieldIndex f = 0; f < kFieldCount; ++f) {
    const RegisterSource& reg = kFields[f].reg;
    if (!reg.present() || reg.discrete) {
      continue;
    }
    const double value = impl_->readings[f] / reg.scale;
    const std::size_t at = reg.address - 1u;
    switch (reg.type) {
      case RegisterType::u16:
        words[at] = static_cast<std::uint16_t>(as_integer(value, 0, 0xFFFF));
        break;
      case RegisterType::i16:
        words[at] = static_cast<std::uint16_t>(as_integer(value, -0x8000, 0x7FFF));
        break;
      case RegisterType::i32:
        wire::split_words(static_cast<std::uint32_t>(as_integer(value, std::numeric_limits<std::int32_t>::min(),
                                                                std::numeric_limits<std::int32_t>::max())),
                          impl_->scenario.word_order, words[at], words[at + 1]);
        break;
      case RegisterType::f32:
        wire::split_words(std::bit_cast<std::uint32_t>(impl_->in_register(f)), impl_->scenario.word_order, words[at],
                          words[at + 1]);
        break;
      case RegisterType::none:
        break;
    }
  }
  return words;
}

std::array<std::uint8_t, 80> AnswerMaker::inputs(const RobotState& state) {
  impl_->read(state);
  std::array<std::uint8_t, 80> bits{};
  for (FieldIndex f = 0; f < kFieldCount; ++f) {
    const RegisterSource& reg = kFields[f].reg;
    if (reg.present() && reg.discrete) {
      bits[reg.address - 1u] = impl_->readings[f] != 0 ? 1 : 0;
    }
  }
  return bits;
}

std::string AnswerMaker::body(Source source, const RobotState& state) {
  std::string image;
  switch (source) {
    case Source::status:
    case Source::ring:
      return status(state);
    case Source::io:
      return io(state);
    case Source::push:
      return push(state);
    case Source::pose: {
      const std::vector<std::string> keys(kPoseKeys.begin(), kPoseKeys.end());
      return status(state, keys);
    }
    case Source::registers: {
      const auto words = registers(state);
      for (const wire::Range& range : wire::plan_ranges(false)) {
        wire::append_words(image, range, std::span(words).subspan(range.first - 1u, range.count));
      }
      return image;
    }
    case Source::inputs: {
      const auto bits = inputs(state);
      for (const wire::Range& range : wire::plan_ranges(true)) {
        wire::append_bits(image, range, std::span(bits).subspan(range.first - 1u, range.count));
      }
      return image;
    }
  }
  return image;
}

std::string AnswerMaker::push(const RobotState& state) {
  nlohmann::ordered_json out{{"battery_extra", ""},         {"dsp_version", "v1.2.1"}, {"gyro_version", "v1.0"},
                             {"map", {{"userData", "[]"}}}, {"model", "AMB-150"},      {"requestCurrent", 0.0},
                             {"requestVoltage", 0.0},       {"version", "v3.4.7.12"}};
  nlohmann::ordered_json flat = nlohmann::ordered_json::parse(status(state));
  for (auto& [key, value] : flat.items()) {
    const std::string_view object = push_object(key);
    (object.empty() ? out : out[std::string(object)])[key] = std::move(value);
  }
  return out.dump();
}

}  // namespace tacho::sim
