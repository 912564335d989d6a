#include "schema/text.hpp"

#include <algorithm>
#include <vector>

namespace tacho {

namespace {
char lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }
}  // namespace

std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> before(b.size() + 1);
  std::vector<std::size_t> last(b.size() + 1);
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) {
    last[j] = j;
  }
  for (std::size_t i = 1; i <= a.size(); ++i) {
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const bool same = lower(a[i - 1]) == lower(b[j - 1]);
      row[j] = std::min({last[j] + 1, row[j - 1] + 1, last[j - 1] + (same ? 0 : 1)});
      if (i > 1 && j > 1 && lower(a[i - 1]) == lower(b[j - 2]) && lower(a[i - 2]) == lower(b[j - 1])) {
        row[j] = std::min(row[j], before[j - 2] + 1);
      }
    }
    before.swap(last);
    last.swap(row);
  }
  return last[b.size()];
}

std::string nearest(std::string_view name, std::span<const std::string> candidates) {
  std::size_t best = std::max<std::size_t>(2, name.size() / 3) + 1;
  std::string_view found;
  for (const std::string& candidate : candidates) {
    const std::size_t distance = edit_distance(name, candidate);
    if (distance < best) {
      best = distance;
      found = candidate;
    }
  }
  return std::string(found);
}

std::string did_you_mean(std::string_view name, std::span<const std::string> candidates) {
  const std::string found = nearest(name, candidates);
  return found.empty() ? "" : "; did you mean '" + found + "'?";
}

std::string not_a_command(std::string_view argument, std::span<const std::string> commands) {
  if (argument.starts_with('-') || std::find(commands.begin(), commands.end(), argument) != commands.end()) {
    return "";
  }
  std::string known;
  for (const std::string& command : commands) {
    known += (known.empty() ? "" : ", ") + command;
  }
  return (argument.empty() ? "no command given"
                           : "no command '" + std::string(argument) + "'" + did_you_mean(argument, commands)) +
         "; the commands are " + known;
}

namespace {

/// Bytes of the character at `at` that steers: C0 and DEL, C1 (U+0080 to U+009F), marks of writing direction (U+200E,
/// U+200F, U+202A to U+202E, U+2066 to U+2069); 0 when it is none.
std::size_t steering(std::string_view text, std::size_t at) {
  const auto byte = [&](std::size_t i) { return at + i < text.size() ? static_cast<unsigned char>(text[at + i]) : 0U; };
  if (byte(0) < 0x20 || byte(0) == 0x7F) {
    return 1;
  }
  if (byte(0) == 0xC2 && byte(1) >= 0x80 && byte(1) < 0xA0) {
    return 2;
  }
  const bool marks = byte(1) == 0x80 && (byte(2) == 0x8E || byte(2) == 0x8F || (byte(2) >= 0xAA && byte(2) <= 0xAE));
  const bool isolates = byte(1) == 0x81 && byte(2) >= 0xA6 && byte(2) <= 0xA9;
  return byte(0) == 0xE2 && (marks || isolates) ? 3 : 0;
}

}  // namespace

std::string printable(std::string text) {
  std::size_t to = 0;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t steers = steering(text, at);
    text[to++] = steers > 0 ? ' ' : text[at];
    at += std::max<std::size_t>(steers, 1);
  }
  text.resize(to);
  return text;
}

}  // namespace tacho
