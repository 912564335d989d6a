#pragma once
// Values as text. `exact` texts are for machines: shortest decimal that reads back as the same number, no locale.
// `brief` texts are for people: as many digits as the interval deserves.

#include <string>
#include <string_view>

#include "analyzer/report/section.hpp"

namespace tacho::report {

/// Shortest decimal that reads back bit for bit; empty for NaN and infinities (the caller says why).
std::string exact(double value);
std::string exact(std::int64_t value);

/// At most `digits` significant digits, no exponent between 1e-4 and 1e9, no trailing zeros.
std::string brief(double value, int digits = 5);
/// "1.0023 [1.0011, 1.0035] m": value and interval to the second digit of the interval's half-width. Without a value:
/// the reason in brackets.
std::string brief(const Quantity& quantity);
/// The unit with a space before it; empty for counts and for ratios ("1").
std::string unit_suffix(std::string_view unit);

/// Columns a terminal needs: combining marks 0, wide East Asian characters and emoji 2. A broken byte counts as one.
std::size_t display_width(std::string_view utf8);
/// The next character of `utf8`, which is shortened by it; U+FFFD for a broken byte. Not to be called on empty text.
char32_t next_character(std::string_view& utf8);
/// Without control characters (a robot's text must not steer the terminal): each becomes a space.
std::string one_line(std::string_view utf8);
/// Cut to `width` columns, the last one an ellipsis when something is cut.
std::string shortened(std::string_view utf8, std::size_t width);

/// Lower case letters, digits, '.', '-' and '_' only: safe as a file name everywhere. Never empty.
std::string file_stem(std::string_view name);

}  // namespace tacho::report
