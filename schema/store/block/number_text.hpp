#pragma once
// What can be seen of a number by looking at its text.

#include <cstdint>
#include <string_view>

namespace tacho::store {

struct NumberText {
  bool valid = false;  ///< a JSON number, or a run of digits that may begin with zeros
  bool negative = false;
  bool exponent = false;
  bool plus = false;            ///< e+20
  bool padded = false;          ///< leading zeros before the point: 05
  bool ends_with_zero = false;  ///< last digit of the fraction
  unsigned whole_digits = 0;    ///< before the point
  unsigned decimals = 0;        ///< after the point
  unsigned significant = 0;     ///< digits without leading zeros and without trailing zeros of the fraction
  unsigned exponent_digits = 0;
  int point = 0;               ///< the number is 0.d1d2... times 10^point, d1 not 0; 1 for zero
  std::uint64_t mantissa = 0;  ///< all digits without the point; right up to 19 of them
};

inline NumberText scan_number(std::string_view text) {
  NumberText n;
  std::size_t at = 0;
  const auto is_digit = [&] { return at < text.size() && text[at] >= '0' && text[at] <= '9'; };
  const auto digit = [&] { return static_cast<unsigned>(text[at] - '0'); };
  n.negative = !text.empty() && text[0] == '-';
  at += n.negative ? 1 : 0;
  n.padded = text.size() > at + 1 && text[at] == '0' && text[at + 1] >= '0' && text[at + 1] <= '9';
  unsigned trailing_zeros = 0;
  unsigned leading_zeros = 0;
  const auto take = [&] {
    const unsigned d = digit();
    n.mantissa = n.mantissa * 10 + d;
    if (n.significant > 0 || d != 0) {
      ++n.significant;
    } else {
      ++leading_zeros;
    }
    trailing_zeros = d == 0 ? trailing_zeros + 1 : 0;
    ++at;
  };
  while (is_digit()) {
    take();
    ++n.whole_digits;
  }
  trailing_zeros = 0;
  if (at < text.size() && text[at] == '.') {
    ++at;
    while (is_digit()) {
      take();
      ++n.decimals;
    }
    if (n.decimals == 0) {
      return n;
    }
  }
  n.ends_with_zero = trailing_zeros > 0;
  n.point = n.significant == 0 ? 1 : static_cast<int>(n.whole_digits) - static_cast<int>(leading_zeros);
  n.significant -= n.significant > trailing_zeros ? trailing_zeros : 0;
  if (at < text.size() && (text[at] == 'e' || text[at] == 'E')) {
    n.exponent = true;
    ++at;
    const bool minus = at < text.size() && text[at] == '-';
    n.plus = at < text.size() && text[at] == '+';
    at += minus || n.plus ? 1 : 0;
    int exponent = 0;
    for (; is_digit(); ++at, ++n.exponent_digits) {
      constexpr int kTooLarge = 100'000;
      exponent = exponent < kTooLarge ? exponent * 10 + static_cast<int>(digit()) : exponent;
    }
    if (n.exponent_digits == 0) {
      return n;
    }
    n.point += minus ? -exponent : exponent;
  }
  n.valid = n.whole_digits > 0 && at == text.size();
  return n;
}

}  // namespace tacho::store
