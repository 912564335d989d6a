#include "schema/wire/raw_members.hpp"

#include <cassert>

#include "schema/wire/requests.hpp"

namespace tacho::wire {

namespace {

// The parser has accepted the text, so every string is closed and every bracket has its partner.

std::size_t skip_any_of(std::string_view text, std::size_t at, std::string_view set) {
  const std::size_t found = text.find_first_not_of(set, at);
  return found == std::string_view::npos ? text.size() : found;
}

/// `at` stands on the opening quote; returns the position after the closing one.
std::size_t skip_string(std::string_view text, std::size_t at) {
  std::size_t quote = at;
  for (;;) {
    quote = text.find('"', quote + 1);
    if (quote == std::string_view::npos) {
      return text.size();
    }
    std::size_t backslashes = 0;
    while (text[quote - 1 - backslashes] == '\\') {
      ++backslashes;
    }
    if (backslashes % 2 == 0) {
      return quote + 1;
    }
  }
}

std::size_t skip_nested(std::string_view text, std::size_t at) {
  std::size_t depth = 0;
  while (at < text.size()) {
    switch (text[at]) {
      case '"':
        at = skip_string(text, at);
        continue;
      case '{':
      case '[':
        ++depth;
        break;
      case '}':
      case ']':
        if (--depth == 0) {
          return at + 1;
        }
        break;
      default:
        break;
    }
    ++at;
  }
  return at;
}

std::size_t skip_value(std::string_view text, std::size_t at) {
  if (at >= text.size()) {
    return text.size();
  }
  if (text[at] == '"') {
    return skip_string(text, at);
  }
  if (text[at] == '{' || text[at] == '[') {
    return skip_nested(text, at);
  }
  while (at < text.size() && text[at] != ',' && text[at] != '}' && text[at] != ']' && text[at] > ' ') {
    ++at;
  }
  return at;
}

}  // namespace

std::vector<std::string_view> member_keys(std::string_view body) {
  constexpr std::string_view kSpace = " \t\r\n";
  std::size_t at = skip_any_of(body, 0, kSpace);
  if (at >= body.size() || body[at] != '{') {
    return {};
  }
  // The body need not be JSON at all: only what looks like a key is walked over.
  std::vector<std::string_view> keys;
  at = skip_any_of(body, at + 1, kSpace);
  while (at < body.size() && body[at] == '"') {
    const std::size_t end = skip_string(body, at);
    keys.push_back(body.substr(at + 1, end - at - 2));
    const std::size_t colon = skip_any_of(body, end, kSpace);
    if (colon >= body.size() || body[colon] != ':') {
      break;
    }
    at = skip_value(body, skip_any_of(body, colon + 1, kSpace));
    at = skip_any_of(body, at, " \t\r\n,");
  }
  return keys;
}

std::string_view RawMembers::value(std::size_t index) {
  if (parent_ != nullptr) {
    text_ = parent_->value(parent_index_);
    parent_ = nullptr;
  }
  assert(index + 1 >= walked_);
  while (walked_ <= index && position_ < text_.size()) {
    // Before a key stand white space and '{' or ',', before a value white space and ':'.
    const std::size_t key = skip_any_of(text_, position_, " \t\r\n{,");
    const std::size_t begin = skip_any_of(text_, key < text_.size() ? skip_string(text_, key) : key, " \t\r\n:");
    position_ = skip_value(text_, begin);
    last_ = text_.substr(begin, position_ - begin);
    ++walked_;
  }
  return last_;
}

}  // namespace tacho::wire
