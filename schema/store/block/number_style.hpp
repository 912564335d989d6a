#pragma once
// How the numbers of one column are written in the answers, so that a number and its style give back the text byte for
// byte. A style is looked for per column by looking at its texts; a text that does not fit it is an exception of that
// column.
//
// What a value (64 bits) means:
//   decimal        whole number of 10^-decimals. Zero and above as they are, below: one less, so that -1 is "-0"
//   real64         bits of a double
//   real32         bits of a float (zero-extended)
//   word, dword    a register word, or two of them as a signed whole number: big-endian bytes of a register image
//   float_bits     two register words: bits of the float (zero-extended)
//   float_decimal  two register words: whole number of 10^-decimals (as in `decimal`), rounded to the nearest float
//   byte           eight discrete inputs

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "schema/records.hpp"
#include "schema/store/block/bytes.hpp"

namespace tacho::store {

inline constexpr unsigned kMaxDecimals = 17;
/// Zero below zero, of a style that gives it a point.
inline constexpr std::string_view kPointedZero = "-0.0";

/// Stored: append only.
enum class NumberKind : std::uint8_t { decimal, real64, real32, word, dword, float_bits, float_decimal, byte };

struct NumberStyle {
  NumberKind kind = NumberKind::decimal;

  std::uint8_t decimals = 0;      ///< decimal, float_decimal: 0 to 17
  std::uint8_t min_decimals = 0;  ///< decimal: trailing zeros are cut down to this many decimals
  std::uint8_t width = 1;         ///< decimal: digits before the point at least, padded with zeros
  bool zero_with_point = false;   ///< decimal: negative zero is "-0.0" whatever min_decimals says

  /// real64, real32: significant digits (5 to 17), or fewest digits that read back as the same double or float.
  std::uint8_t digits = kShortestDouble;
  static constexpr std::uint8_t kShortestDouble = 0;
  static constexpr std::uint8_t kShortestFloat = 1;
  /// real64, real32: without exponent while the decimal point stands at one of these digits (1 = after the first).
  std::int8_t fixed_from = -4;
  std::int8_t fixed_to = 17;
  bool fixed_if_shorter = false;  ///< instead of the limits: exponent when that is shorter (std::to_chars)
  bool padded_exponent = true;    ///< e-05 or e-5
  bool plus_exponent = true;      ///< e+20 or e20
  bool whole_with_point = false;  ///< 1.0 or 1

  /// dword and floats
  WordOrder order = WordOrder::cdab;

  friend bool operator==(const NumberStyle&, const NumberStyle&) = default;
};

void put_style(const NumberStyle& style, std::string& out);
/// False when the bytes are no style. Written where it belongs: copying it costs as much as reading it.
[[nodiscard]] bool take_style(ByteReader& in, NumberStyle& style);

/// The value that append_number() turns into exactly `text`; empty when there is none.
std::optional<std::int64_t> number_value(const NumberStyle& style, std::string_view text);
/// Any value of any style that take_style() gave has a text.
void append_number(const NumberStyle& style, std::int64_t value, std::string& out);

/// The double nearest to what append_number() writes (register kinds: the value itself).
void to_reals(const NumberStyle& style, std::span<const std::int64_t> values, double* out);

/// Styles worth trying for JSON numbers or runs of digits, most promising first; none when most texts are no numbers.
std::vector<NumberStyle> json_styles(std::span<const std::string_view> texts);
/// The same for pairs of registers that hold floats.
std::vector<NumberStyle> float_styles(std::span<const std::string_view> texts, WordOrder order);

/// Two register words as they stand in an image -> 32 bits.
std::uint32_t register_bits(std::string_view four_bytes, WordOrder order);

}  // namespace tacho::store
