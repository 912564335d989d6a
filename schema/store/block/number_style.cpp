#include "schema/store/block/number_style.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstring>
#include <limits>

#include "schema/store/block/number_text.hpp"
#include "schema/store/block/wide_loops.hpp"

namespace tacho::store {

namespace {

constexpr unsigned kMaxDigits = 18;  // of a decimal mantissa: always fits 64 bits
constexpr unsigned kMaxSignificant = 17;

constexpr auto kPowers = [] {
  std::array<double, kMaxDigits + 1> powers{};
  double power = 1;
  for (double& p : powers) {
    p = power;
    power *= 10;
  }
  return powers;
}();

constexpr auto kWholePowers = [] {
  std::array<std::int64_t, kMaxDigits + 1> powers{};
  std::int64_t power = 1;
  for (std::int64_t& p : powers) {
    p = power;
    power *= power < 1'000'000'000'000'000'000 ? 10 : 1;
  }
  return powers;
}();

/// Sign and size of a decimal value: -1 is negative zero.
constexpr std::int64_t decimal_value(bool negative, std::int64_t size) { return negative ? -size - 1 : size; }
constexpr std::int64_t decimal_number(std::int64_t value) { return value < 0 ? value + 1 : value; }

double decimal_to_real(std::int64_t value, double power) {
  return std::copysign(static_cast<double>(decimal_number(value)) / power, static_cast<double>(value));
}

std::optional<std::int64_t> decimal_from(const NumberStyle& style, std::string_view text) {
  if (style.zero_with_point && text == kPointedZero) {
    return decimal_value(true, 0);
  }
  const NumberText number = scan_number(text);
  if (!number.valid || number.exponent) {
    return std::nullopt;
  }
  const bool trimmed = number.decimals == style.min_decimals || !number.ends_with_zero;
  const bool padded = number.whole_digits == style.width || (number.whole_digits > style.width && !number.padded);
  const unsigned missing = style.decimals - number.decimals;
  if (number.decimals < style.min_decimals || number.decimals > style.decimals || !trimmed || !padded ||
      number.whole_digits + number.decimals + missing > kMaxDigits) {
    return std::nullopt;
  }
  const std::int64_t size = static_cast<std::int64_t>(number.mantissa) * kWholePowers[missing];
  if (size == 0 && number.negative && style.zero_with_point) {
    return std::nullopt;
  }
  return decimal_value(number.negative, size);
}

void append_decimal(const NumberStyle& style, std::int64_t value, std::string& out) {
  if (value == decimal_value(true, 0) && style.zero_with_point) {
    out += kPointedZero;
    return;
  }
  char digits[64];
  char* const end = digits + sizeof digits;
  char* begin = end;
  std::uint64_t size = value < 0 ? ~static_cast<std::uint64_t>(value) : static_cast<std::uint64_t>(value);
  const std::ptrdiff_t least = style.decimals + style.width;
  while (size != 0 || end - begin < least) {
    *--begin = static_cast<char>('0' + size % 10);
    size /= 10;
  }
  std::size_t decimals = style.decimals;
  char* last = end;
  while (decimals > style.min_decimals && last[-1] == '0') {
    --decimals;
    --last;
  }
  if (value < 0) {
    out += '-';
  }
  char* const point = end - style.decimals;
  out.append(begin, point);
  if (decimals > 0) {
    out += '.';
    out.append(point, last);
  }
}

/// 0.d1d2d3... times 10^point
struct Digits {
  std::array<char, 32> digit;
  int count = 0;
  int point = 0;
};

template <class Real>
Digits digits_of(Real value, std::uint8_t significant) {
  std::array<char, 48> text{};
  const auto [end, error] =
      significant <= NumberStyle::kShortestFloat
          ? std::to_chars(text.data(), text.data() + text.size(), value, std::chars_format::scientific)
          : std::to_chars(text.data(), text.data() + text.size(), value, std::chars_format::scientific,
                          significant - 1);
  Digits digits;
  const char* at = text.data();
  for (; at != end && *at != 'e'; ++at) {
    if (*at != '.') {
      digits.digit[static_cast<std::size_t>(digits.count++)] = *at;
    }
  }
  at += at != end ? 1 : 0;
  at += at != end && *at == '+' ? 1 : 0;
  std::from_chars(at, end, digits.point);
  ++digits.point;
  while (digits.count > 1 && digits.digit[static_cast<std::size_t>(digits.count) - 1] == '0') {
    --digits.count;
  }
  return digits;
}

void append_scientific(const NumberStyle& style, const Digits& digits, std::string& out) {
  out += digits.digit[0];
  if (digits.count > 1) {
    out += '.';
    out.append(digits.digit.data() + 1, static_cast<std::size_t>(digits.count) - 1);
  }
  const int exponent = digits.point - 1;
  out += 'e';
  if (exponent < 0 || style.plus_exponent) {
    out += exponent < 0 ? '-' : '+';
  }
  const int size = std::abs(exponent);
  if (size < 10 && style.padded_exponent) {
    out += '0';
  }
  std::array<char, 8> text{};
  out.append(text.data(), std::to_chars(text.data(), text.data() + text.size(), size).ptr);
}

void append_fixed(const NumberStyle& style, const Digits& digits, std::string& out) {
  const auto count = static_cast<std::size_t>(digits.count);
  if (digits.point <= 0) {
    out += "0.";
    out.append(static_cast<std::size_t>(-digits.point), '0');
    out.append(digits.digit.data(), count);
    return;
  }
  const auto whole = static_cast<std::size_t>(digits.point);
  out.append(digits.digit.data(), std::min(whole, count));
  if (whole >= count) {
    out.append(whole - count, '0');
    out += style.whole_with_point ? ".0" : "";
  } else {
    out += '.';
    out.append(digits.digit.data() + whole, count - whole);
  }
}

template <class Real>
void append_real(const NumberStyle& style, Real value, std::string& out) {
  if (!std::isfinite(value)) {
    out += "null";  // never written by the encoder
    return;
  }
  if (value == 0 && std::signbit(value) && style.zero_with_point) {
    out += kPointedZero;
    return;
  }
  if (style.fixed_if_shorter) {
    std::array<char, 64> text{};
    out.append(text.data(), std::to_chars(text.data(), text.data() + text.size(), value).ptr);
    return;
  }
  if (std::signbit(value)) {
    out += '-';
  }
  const Digits digits = digits_of(std::abs(value), style.digits);
  if (digits.point >= style.fixed_from && digits.point <= style.fixed_to) {
    append_fixed(style, digits, out);
  } else {
    append_scientific(style, digits, out);
  }
}

template <class Real>
std::optional<Real> parse_real(std::string_view text) {
  Real value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) {
    return std::nullopt;
  }
  return value;
}

/// The value a text of this style would have; whether it prints back is not looked at.
std::optional<std::int64_t> real_from(const NumberStyle& style, std::string_view text) {
  if (style.kind == NumberKind::real32 && style.digits != NumberStyle::kShortestDouble) {
    const std::optional<float> value = parse_real<float>(text);
    return value ? std::optional<std::int64_t>(std::bit_cast<std::uint32_t>(*value)) : std::nullopt;
  }
  const std::optional<double> value = parse_real<double>(text);
  if (!value) {
    return std::nullopt;
  }
  if (style.kind == NumberKind::real64) {
    return std::bit_cast<std::int64_t>(*value);
  }
  constexpr double kLargestFloat = 3.4028234663852886e38;
  if (std::abs(*value) > kLargestFloat) {
    return std::nullopt;
  }
  return std::bit_cast<std::uint32_t>(static_cast<float>(*value));
}

float float_of(std::int64_t value) { return std::bit_cast<float>(static_cast<std::uint32_t>(value)); }

void append_json_real(const NumberStyle& style, std::int64_t value, std::string& out) {
  if (style.kind == NumberKind::real64) {
    append_real(style, std::bit_cast<double>(value), out);
  } else if (style.digits == NumberStyle::kShortestFloat) {
    append_real(style, float_of(value), out);
  } else {
    append_real(style, static_cast<double>(float_of(value)), out);
  }
}

float decimal_to_float(const NumberStyle& style, std::int64_t value) {
  return static_cast<float>(decimal_to_real(value, kPowers[style.decimals]));
}

std::optional<std::int64_t> float_decimal_from(const NumberStyle& style, std::uint32_t bits) {
  constexpr double kExact = 9007199254740992.0;  // 2^53
  const float number = std::bit_cast<float>(bits);
  const double scaled = static_cast<double>(number) * kPowers[style.decimals];
  if (!(std::abs(scaled) < kExact)) {
    return std::nullopt;
  }
  const std::int64_t value =
      decimal_value(std::signbit(number), static_cast<std::int64_t>(std::llround(std::abs(scaled))));
  return std::bit_cast<std::uint32_t>(decimal_to_float(style, value)) == bits ? std::optional(value) : std::nullopt;
}

bool high_first(WordOrder order) { return order == WordOrder::abcd || order == WordOrder::badc; }
bool swapped(WordOrder order) { return order == WordOrder::badc || order == WordOrder::dcba; }

void append_register_bits(std::uint32_t bits, WordOrder order, std::string& out) {
  std::array<char, 4> bytes{static_cast<char>(bits >> 24U), static_cast<char>(bits >> 16U),
                            static_cast<char>(bits >> 8U), static_cast<char>(bits)};
  if (!high_first(order)) {
    std::swap(bytes[0], bytes[2]);
    std::swap(bytes[1], bytes[3]);
  }
  if (swapped(order)) {
    std::swap(bytes[0], bytes[1]);
    std::swap(bytes[2], bytes[3]);
  }
  out.append(bytes.data(), bytes.size());
}

std::size_t register_bytes(NumberKind kind) {
  switch (kind) {
    case NumberKind::byte:
      return 1;
    case NumberKind::word:
      return 2;
    default:
      return 4;
  }
}

std::optional<std::int64_t> register_value(const NumberStyle& style, std::string_view text) {
  if (text.size() != register_bytes(style.kind)) {
    return std::nullopt;
  }
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  switch (style.kind) {
    case NumberKind::byte:
      return byte(0);
    case NumberKind::word:
      return byte(0) << 8 | byte(1);
    case NumberKind::dword:
      return static_cast<std::int32_t>(register_bits(text, style.order));
    case NumberKind::float_bits:
      return register_bits(text, style.order);
    default:
      return float_decimal_from(style, register_bits(text, style.order));
  }
}

bool is_real(NumberKind kind) { return kind == NumberKind::real64 || kind == NumberKind::real32; }

/// Reals of columns whose stored value is not what the text says: by way of the text.
void reals_by_text(const NumberStyle& style, std::span<const std::int64_t> values, double* out) {
  std::string text;
  for (std::size_t i = 0; i < values.size(); ++i) {
    text.clear();
    append_number(style, values[i], text);
    out[i] = parse_real<double>(text).value_or(0.0);
  }
}

/// A whole number below 2^51 as a double. Added to the bits of 1.5 * 2^52 it is the last digits of a double: processors
/// do that, but not the conversion, to several numbers at once.
double small_to_real(std::int64_t number) {
  constexpr double kShift = 6755399441055744.0;
  return std::bit_cast<double>(static_cast<std::uint64_t>(number) + std::bit_cast<std::uint64_t>(kShift)) - kShift;
}

/// As decimal_to_real() of each, through `finish`, without branches: right where all have a size below 2^51. Returns
/// the bits of all sizes, found on the way: looking first took as long as converting.
template <class Finish>
std::int64_t small_decimals(std::span<const std::int64_t> values, double power, double* out, Finish finish) {
  std::int64_t all = 0;
  run_loop([&]() __attribute__((always_inline)) {
    std::int64_t sizes = 0;
    for (std::size_t i = 0; i < values.size(); ++i) {
      const std::int64_t sign = values[i] >> 63U;
      sizes |= values[i] ^ sign;
      const auto real = std::bit_cast<std::int64_t>(small_to_real(values[i] - sign) / power);
      out[i] = finish(std::bit_cast<double>(real | (sign & std::numeric_limits<std::int64_t>::min())));
    }
    all = sizes;
  });
  return all;
}

/// As decimal_to_real() of each, through `finish`. Returns the bits of all sizes.
template <class Finish>
std::int64_t decimals_each(std::span<const std::int64_t> values, double power, double* out, Finish finish) {
  constexpr unsigned kSmallBits = 51;
  const std::int64_t sizes = small_decimals(values, power, out, finish);
  if (sizes >> kSmallBits != 0) {
    std::transform(values.begin(), values.end(), out,
                   [&](std::int64_t value) { return finish(decimal_to_real(value, power)); });
  }
  return sizes;
}

void decimal_reals(const NumberStyle& style, std::span<const std::int64_t> values, double* out) {
  constexpr unsigned kExactBits = 53;
  // Where both operands are exact, the quotient is what reading the text gives.
  if (decimals_each(values, kPowers[style.decimals], out, [](double real) { return real; }) >> kExactBits != 0) {
    reals_by_text(style, values, out);
  }
}

}  // namespace

std::uint32_t register_bits(std::string_view four_bytes, WordOrder order) {
  std::string bytes;
  const auto byte = [&](std::size_t i) { return std::uint32_t{static_cast<unsigned char>(four_bytes[i])}; };
  // Each order is its own inverse, so splitting what was read joins it.
  append_register_bits(byte(0) << 24U | byte(1) << 16U | byte(2) << 8U | byte(3), order, bytes);
  std::uint32_t bits = 0;
  for (const char c : bytes) {
    bits = bits << 8U | static_cast<unsigned char>(c);
  }
  return bits;
}

std::optional<std::int64_t> number_value(const NumberStyle& style, std::string_view text) {
  if (style.kind == NumberKind::decimal) {
    return decimal_from(style, text);
  }
  if (!is_real(style.kind)) {
    return register_value(style, text);
  }
  const std::optional<std::int64_t> value = real_from(style, text);
  if (!value) {
    return std::nullopt;
  }
  std::string printed;
  append_json_real(style, *value, printed);
  return printed == text ? value : std::nullopt;
}

void append_number(const NumberStyle& style, std::int64_t value, std::string& out) {
  switch (style.kind) {
    case NumberKind::decimal:
      append_decimal(style, value, out);
      return;
    case NumberKind::real64:
    case NumberKind::real32:
      append_json_real(style, value, out);
      return;
    case NumberKind::byte:
      out.push_back(static_cast<char>(value));
      return;
    case NumberKind::word:
      out.push_back(static_cast<char>(value >> 8U));
      out.push_back(static_cast<char>(value));
      return;
    case NumberKind::float_decimal:
      append_register_bits(std::bit_cast<std::uint32_t>(decimal_to_float(style, value)), style.order, out);
      return;
    case NumberKind::dword:
    case NumberKind::float_bits:
      append_register_bits(static_cast<std::uint32_t>(value), style.order, out);
      return;
  }
}

void to_reals(const NumberStyle& style, std::span<const std::int64_t> values, double* out) {
  const auto each = [&](auto convert) { std::transform(values.begin(), values.end(), out, convert); };
  switch (style.kind) {
    case NumberKind::decimal:
      decimal_reals(style, values, out);
      return;
    case NumberKind::real64:
      std::memcpy(out, values.data(), values.size_bytes());
      return;
    case NumberKind::real32:
      if (style.digits != NumberStyle::kShortestDouble) {
        reals_by_text(style, values, out);
        return;
      }
      [[fallthrough]];
    case NumberKind::float_bits:
      each([](std::int64_t value) { return static_cast<double>(float_of(value)); });
      return;
    case NumberKind::float_decimal:
      decimals_each(values, kPowers[style.decimals], out,
                    [](double real) { return static_cast<double>(static_cast<float>(real)); });
      return;
    case NumberKind::byte:
    case NumberKind::word:
    case NumberKind::dword:
      each([](std::int64_t value) { return static_cast<double>(value); });
      return;
  }
}

void put_style(const NumberStyle& style, std::string& out) {
  put_fixed(out, static_cast<std::uint8_t>(style.kind));
  if (style.kind == NumberKind::decimal) {
    put_fixed(out, static_cast<std::uint8_t>(style.decimals | (style.zero_with_point ? 0x80U : 0U)));
    put_fixed(out, style.min_decimals);
    put_fixed(out, style.width);
  } else if (is_real(style.kind)) {
    const unsigned flags = (style.zero_with_point ? 1U : 0U) | (style.fixed_if_shorter ? 2U : 0U) |
                           (style.padded_exponent ? 4U : 0U) | (style.plus_exponent ? 8U : 0U) |
                           (style.whole_with_point ? 16U : 0U);
    put_fixed(out, static_cast<std::uint8_t>(flags));
    put_fixed(out, style.digits);
    put_fixed(out, style.fixed_from);
    put_fixed(out, style.fixed_to);
  } else if (register_bytes(style.kind) == 4) {
    put_fixed(out, static_cast<std::uint8_t>(style.order));
    put_fixed(out, style.decimals);
  }
}

bool take_style(ByteReader& in, NumberStyle& style) {
  style = NumberStyle();
  const std::uint8_t kind = in.byte();
  if (kind > static_cast<std::uint8_t>(NumberKind::byte)) {
    return false;
  }
  style.kind = static_cast<NumberKind>(kind);
  if (style.kind == NumberKind::decimal) {
    const std::uint8_t first = in.byte();
    style.decimals = first & 0x7FU;
    style.zero_with_point = (first & 0x80U) != 0;
    style.min_decimals = in.byte();
    style.width = in.byte();
  } else if (is_real(style.kind)) {
    const std::uint8_t flags = in.byte();
    style.zero_with_point = (flags & 1U) != 0;
    style.fixed_if_shorter = (flags & 2U) != 0;
    style.padded_exponent = (flags & 4U) != 0;
    style.plus_exponent = (flags & 8U) != 0;
    style.whole_with_point = (flags & 16U) != 0;
    style.digits = in.byte();
    style.fixed_from = in.fixed<std::int8_t>();
    style.fixed_to = in.fixed<std::int8_t>();
  } else if (register_bytes(style.kind) == 4) {
    const std::uint8_t order = in.byte();
    if (order > static_cast<std::uint8_t>(WordOrder::dcba)) {
      return false;
    }
    style.order = static_cast<WordOrder>(order);
    style.decimals = in.byte();
  }
  const bool sane = style.decimals <= kMaxDecimals && style.min_decimals <= style.decimals && style.width >= 1 &&
                    style.width <= kMaxDigits && style.digits <= kMaxSignificant;
  return in.good() && sane;
}

}  // namespace tacho::store
