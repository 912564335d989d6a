#pragma once
// Numbers and texts as a robot's JSON writer prints them.

#include <charconv>
#include <cmath>
#include <cstdint>
#include <string>
#include <string_view>
#include <type_traits>

namespace tacho::sim {

template <class Integer>
void append_integer(std::string& out, Integer value) {
  static_assert(std::is_integral_v<Integer>);
  char text[24];
  out.append(text, std::to_chars(text, text + sizeof text, value).ptr);
}

/// Shortest text that reads back as the same double or float; negative zero is "-0.0".
template <class Real>
void append_shortest(std::string& out, Real value) {
  if (value == 0) {
    out += std::signbit(value) ? "-0.0" : "0";
    return;
  }
  char text[32];
  out.append(text, std::to_chars(text, text + sizeof text, value).ptr);
}

inline constexpr std::int64_t kPowersOfTen[] = {1,       10,        100,        1'000,       10'000,
                                                100'000, 1'000'000, 10'000'000, 100'000'000, 1'000'000'000};

/// The number that append_rounded() prints.
inline double rounded(double value, int decimals) {
  const auto unit = static_cast<double>(kPowersOfTen[decimals]);
  return std::copysign(static_cast<double>(std::llround(std::abs(value) * unit)) / unit, value);
}

/// Rounded to `decimals` (0..9), without trailing zeros: 15, 0.82, -0.0 where a small negative value was rounded away.
inline void append_rounded(std::string& out, double value, int decimals) {
  const std::int64_t unit = kPowersOfTen[decimals];
  const std::int64_t scaled = std::llround(value * static_cast<double>(unit));
  if (scaled == 0) {
    out += std::signbit(value) ? "-0.0" : "0";
    return;
  }
  if (scaled < 0) {
    out += '-';
  }
  const std::int64_t size = scaled < 0 ? -scaled : scaled;
  append_integer(out, size / unit);
  std::int64_t fraction = size % unit;
  if (fraction == 0) {
    return;
  }
  out += '.';
  for (std::int64_t place = unit / 10; fraction != 0; place /= 10) {
    out += static_cast<char>('0' + fraction / place);
    fraction %= place;
  }
}

/// The inside of a JSON string.
inline void append_escaped(std::string& out, std::string_view text) {
  constexpr char kHex[] = "0123456789abcdef";
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      out += '\\';
      out += c;
    } else if (c == '\n') {
      out += "\\n";
    } else if (static_cast<unsigned char>(c) < 0x20) {
      out += "\\u00";
      out += kHex[(c >> 4) & 15];
      out += kHex[c & 15];
    } else {
      out += c;
    }
  }
}

}  // namespace tacho::sim
