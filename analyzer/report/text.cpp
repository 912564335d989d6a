#include "analyzer/report/text.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

namespace tacho::report {
namespace {

struct Interval {
  char32_t from;
  char32_t to;
};
constexpr auto kWide = std::to_array<Interval>({{0x1100, 0x115F},
                                                {0x2E80, 0xA4CF},
                                                {0xAC00, 0xD7A3},
                                                {0xF900, 0xFAFF},
                                                {0xFE30, 0xFE6F},
                                                {0xFF00, 0xFF60},
                                                {0xFFE0, 0xFFE6},
                                                {0x1F300, 0x1FAFF},
                                                {0x20000, 0x3FFFD}});
constexpr auto kZero =
    std::to_array<Interval>({{0x0300, 0x036F}, {0x200B, 0x200F}, {0x20D0, 0x20FF}, {0xFE00, 0xFE0F}});

template <std::size_t N>
bool inside(const std::array<Interval, N>& intervals, char32_t c) {
  return std::any_of(intervals.begin(), intervals.end(), [c](Interval i) { return c >= i.from && c <= i.to; });
}

std::size_t character_width(char32_t c) {
  if (inside(kZero, c)) {
    return 0;
  }
  return inside(kWide, c) ? 2 : 1;
}

std::string fixed(double value, int decimals) {
  std::array<char, 400> buffer{};
  const double shown = value == 0.0 ? 0.0 : value;  // no "-0"
  const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), shown, std::chars_format::fixed,
                                 std::clamp(decimals, 0, 30));
  std::string text(buffer.data(), end.ptr);
  return text.find_first_not_of("-0.") == std::string::npos && text.front() == '-' ? text.substr(1) : text;
}

std::string without_zeros(std::string text) {
  if (text.find('.') == std::string::npos) {
    return text;
  }
  text.erase(text.find_last_not_of('0') + 1);
  if (text.back() == '.') {
    text.pop_back();
  }
  return text;
}

int exponent(double value) { return value == 0.0 ? 0 : static_cast<int>(std::floor(std::log10(std::abs(value)))); }

}  // namespace

std::string exact(double value) {
  if (!std::isfinite(value)) {
    return {};
  }
  std::array<char, 32> buffer{};
  const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value);
  return {buffer.data(), end.ptr};
}

std::string exact(std::int64_t value) {
  std::array<char, 24> buffer{};
  const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value);
  return {buffer.data(), end.ptr};
}

std::string brief(double value, int digits) {
  if (!std::isfinite(value)) {
    return "-";
  }
  const int e = exponent(value);
  if (value != 0.0 && (e < -4 || e >= 9)) {
    std::array<char, 64> buffer{};
    const auto end =
        std::to_chars(buffer.data(), buffer.data() + buffer.size(), value, std::chars_format::scientific, digits - 1);
    return {buffer.data(), end.ptr};
  }
  return without_zeros(fixed(value, digits - 1 - e));
}

std::string unit_suffix(std::string_view unit) {
  return unit.empty() || unit == "1" ? std::string() : " " + std::string(unit);
}

std::string brief(const Quantity& q) {
  if (!q.value || !std::isfinite(*q.value)) {
    return q.reason.empty() ? "-" : "(" + q.reason + ")";
  }
  const bool bounded = (q.lo && std::isfinite(*q.lo)) || (q.hi && std::isfinite(*q.hi));
  if (!bounded) {
    return brief(*q.value) + unit_suffix(q.unit);
  }
  const double half = std::max(q.lo ? *q.value - *q.lo : 0.0, q.hi ? *q.hi - *q.value : 0.0);
  const bool usable = std::isfinite(half) && half > 0.0 && exponent(*q.value) < 12;
  const int decimals = usable ? std::max(0, 1 - exponent(half)) : 0;
  const auto text = [&](double x) { return usable ? fixed(x, decimals) : brief(x); };
  const auto bound = [&](const std::optional<double>& x, const char* open) {
    return x && std::isfinite(*x) ? text(*x) : std::string(open);
  };
  return text(*q.value) + " [" + bound(q.lo, "-inf") + ", " + bound(q.hi, "inf") + "]" + unit_suffix(q.unit);
}

char32_t next_character(std::string_view& utf8) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(utf8[i]); };
  const unsigned char first = byte(0);
  const std::size_t length = first < 0x80 ? 1 : first >> 5 == 6 ? 2 : first >> 4 == 14 ? 3 : first >> 3 == 30 ? 4 : 0;
  if (length == 0 || length > utf8.size()) {
    utf8.remove_prefix(1);
    return 0xFFFD;
  }
  char32_t c = length == 1 ? first : first & (0x7FU >> length);
  for (std::size_t i = 1; i < length; ++i) {
    if (byte(i) >> 6 != 2) {
      utf8.remove_prefix(1);
      return 0xFFFD;
    }
    c = (c << 6) | (byte(i) & 0x3FU);
  }
  utf8.remove_prefix(length);
  return c;
}

std::size_t display_width(std::string_view utf8) {
  std::size_t width = 0;
  while (!utf8.empty()) {
    width += character_width(next_character(utf8));
  }
  return width;
}

std::string one_line(std::string_view utf8) {
  std::string out;
  while (!utf8.empty()) {
    const std::string_view before = utf8;
    const char32_t c = next_character(utf8);
    if (c < 0x20 || (c >= 0x7F && c < 0xA0)) {
      out += ' ';
    } else if (c == 0xFFFD) {
      out += "\xEF\xBF\xBD";
    } else {
      out += before.substr(0, before.size() - utf8.size());
    }
  }
  return out;
}

std::string shortened(std::string_view utf8, std::size_t width) {
  if (display_width(utf8) <= width) {
    return std::string(utf8);
  }
  std::string out;
  std::size_t used = 0;
  while (!utf8.empty()) {
    const std::string_view before = utf8;
    used += character_width(next_character(utf8));
    if (used + 1 > width) {
      break;
    }
    out += before.substr(0, before.size() - utf8.size());
  }
  return out + "\xE2\x80\xA6";
}

std::string file_stem(std::string_view name) {
  std::string out;
  for (const char c : name) {
    const bool upper = c >= 'A' && c <= 'Z';
    const bool plain =
        (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-' || c == '_' || (c == '.' && !out.empty());
    out += upper ? static_cast<char>(c - 'A' + 'a') : plain ? c : '_';
  }
  return out.empty() ? "unnamed" : out;
}

}  // namespace tacho::report
