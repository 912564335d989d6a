#pragma once
// What a field is, and how one is looked up. The rows themselves are in field_table.hpp.
//
// Everything that depends on a field (decoding, request planning, CSV headers, FIELDS.md, the `field` table of a log,
// the simulator's answers) is a loop over kFields. Names are the identity of a column: rows may be reordered, never
// renamed; a removed row stays with `retired`.

#include <array>
#include <bitset>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "schema/codes.hpp"

namespace tacho {

enum class Kind : std::uint8_t {
  real,        ///< double, SI unit
  integer,     ///< 64-bit integer
  flag,        ///< boolean
  code,        ///< integer with a code list; unknown codes survive
  text,        ///< UTF-8 string
  list,        ///< array of scalars, kept as its JSON text
  structured,  ///< nested JSON, kept as its JSON text
  alarms,      ///< fatals, errors, warnings, notices: see AlarmItem in sample.hpp; the cell holds the count
  points,      ///< DI, DO: see IoPoint in sample.hpp; the cell holds the count
};

/// Where a field stands in a 11100 / 11013 answer or a 19301 push. `key` may be a path: "calib_status.desc". Empty: not
/// in JSON.
struct JsonSource {
  std::string_view key;
  double scale = 1.0;           ///< JSON number times scale = SI value
  std::string_view former_key;  ///< spelling of older firmware, read when `key` is absent
  bool push_only = false;       ///< no answer has it, only the push
  [[nodiscard]] constexpr JsonSource times(double s) const { return {key, s, former_key, push_only}; }
  [[nodiscard]] constexpr JsonSource formerly(std::string_view k) const { return {key, scale, k, push_only}; }
};

/// The push nests what answers have flat: jack_height is "jack": {"jack_height": ...}. Members of `object` are the keys
/// that begin with `prefix`.
struct PushObject {
  std::string_view object;
  std::string_view prefix;
};
inline constexpr std::array kPushObjects{PushObject{"fork", "fork_"}, PushObject{"fork", "forward_"},
                                         PushObject{"jack", "jack_"}, PushObject{"roller", "roller_"},
                                         PushObject{"hook", "hook_"}};
/// The object that nests `key` in a push; empty: none.
constexpr std::string_view push_object(std::string_view key) {
  for (const PushObject& row : kPushObjects) {
    if (key.starts_with(row.prefix)) {
      return row.object;
    }
  }
  return {};
}

enum class RegisterType : std::uint8_t { none, u16, i16, i32, f32 };

/// Where a field stands in the input registers [3x] (FC4) or the discrete inputs [1x] (FC2: `discrete`).
/// Addresses are as documented, from 1; wire/registers subtracts 1 in one place.
struct RegisterSource {
  std::uint16_t address = 0;
  RegisterType type = RegisterType::none;
  double scale = 1.0;
  bool discrete = false;
  [[nodiscard]] constexpr RegisterSource times(double s) const { return {address, type, s, discrete}; }
  [[nodiscard]] constexpr bool present() const { return address != 0; }
  /// 16-bit words occupied.
  [[nodiscard]] constexpr std::uint16_t words() const {
    return type == RegisterType::i32 || type == RegisterType::f32 ? 2 : 1;
  }
};

/// A value that means "the robot does not supply this" (FIELD-FACTS section 0, rows 10 to 12).
enum class Sentinel : std::uint8_t {
  none,
  minus_one,      ///< -1 = not supported by this battery, or no RFID read
  negative_zero,  ///< -0.0 = sensor absent
  any_zero,       ///< 0 and -0.0 = no estimate (confidence)
};

struct Field {
  std::string_view name;
  Kind kind = Kind::real;
  std::string_view unit;  ///< SI unit symbol; "1" for a ratio, "" where a unit makes no sense
  JsonSource json;
  RegisterSource reg;
  std::string_view meaning;      ///< one clause, no full stop
  std::string_view condition{};  ///< name of a flag; while it is false the field means nothing
  std::span<const Code> codes{};
  Sentinel sentinel = Sentinel::none;
  bool retired = false;  ///< struck out in the vendor's document; still decoded
};

constexpr JsonSource json(std::string_view key) { return {key, 1.0, {}, false}; }
constexpr JsonSource push(std::string_view key) { return {key, 1.0, {}, true}; }
inline constexpr JsonSource no_json{};
inline constexpr RegisterSource no_register{};
constexpr RegisterSource u16(std::uint16_t a) { return {a, RegisterType::u16, 1.0, false}; }
constexpr RegisterSource i16(std::uint16_t a) { return {a, RegisterType::i16, 1.0, false}; }
constexpr RegisterSource i32(std::uint16_t a) { return {a, RegisterType::i32, 1.0, false}; }
constexpr RegisterSource f32(std::uint16_t a) { return {a, RegisterType::f32, 1.0, false}; }
constexpr RegisterSource bit(std::uint16_t a) { return {a, RegisterType::u16, 1.0, true}; }

}  // namespace tacho

#include "schema/field_table.hpp"

namespace tacho {

inline constexpr std::size_t kFieldCount = kFields.size();
using FieldIndex = std::uint16_t;
inline constexpr FieldIndex kNoField = 0xFFFF;
/// A set of fields, one bit per row of kFields.
using FieldSet = std::bitset<kFieldCount>;

constexpr FieldIndex find_field(std::string_view name) {
  for (std::size_t i = 0; i < kFieldCount; ++i) {
    if (kFields[i].name == name) {
      return static_cast<FieldIndex>(i);
    }
  }
  return kNoField;
}

/// The index of a field that must exist: a misspelt name does not compile.
consteval FieldIndex field(std::string_view name) {
  const FieldIndex i = find_field(name);
  if (i == kNoField) {
    throw "no such field";
  }
  return i;
}

constexpr const Field& field_at(FieldIndex i) { return kFields[i]; }

/// The name of `code` in the field's list, or empty when the list does not know it.
std::string_view code_name(const Field& field, std::int64_t code);

/// The field whose name is nearest to a misspelt one, for "did you mean"; empty when nothing is near.
std::string_view nearest_field(std::string_view name);

}  // namespace tacho
