#include "schema/store/block/json_text.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <system_error>

#include "schema/store/block/number_text.hpp"

namespace tacho::store {

namespace {

constexpr int kDepth = 64;

bool is_space(char c) { return c == ' ' || c == '\n' || c == '\r' || c == '\t'; }
bool is_digit(char c) { return c >= '0' && c <= '9'; }

int hex_digit(char c) {
  if (is_digit(c)) {
    return c - '0';
  }
  const char lower = static_cast<char>(c | 0x20);
  return lower >= 'a' && lower <= 'f' ? lower - 'a' + 10 : -1;
}

/// Four hexadecimal digits at `at`, or -1.
int hex4(std::string_view text, std::size_t at) {
  if (at + 4 > text.size()) {
    return -1;
  }
  int value = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    const int digit = hex_digit(text[at + i]);
    if (digit < 0) {
      return -1;
    }
    value = value << 4 | digit;
  }
  return value;
}

constexpr int kHighSurrogate = 0xD800;
constexpr int kLowSurrogate = 0xDC00;
constexpr int kAfterSurrogates = 0xE000;

/// Length of the UTF-8 sequence at `at` (Unicode table 3-7), or 0.
std::size_t utf8_length(std::string_view text, std::size_t at) {
  const auto byte = [&](std::size_t i) { return at + i < text.size() ? static_cast<unsigned char>(text[at + i]) : 0U; };
  const auto tail = [&](std::size_t i) { return (byte(i) & 0xC0U) == 0x80U; };
  const unsigned lead = byte(0);
  if (lead >= 0xC2 && lead <= 0xDF) {
    return tail(1) ? 2 : 0;
  }
  if (lead >= 0xE0 && lead <= 0xEF) {
    const bool second = (lead != 0xE0 || byte(1) >= 0xA0) && (lead != 0xED || byte(1) < 0xA0);
    return second && tail(1) && tail(2) ? 3 : 0;
  }
  if (lead >= 0xF0 && lead <= 0xF4) {
    const bool second = (lead != 0xF0 || byte(1) >= 0x90) && (lead != 0xF4 || byte(1) < 0x90);
    return second && tail(1) && tail(2) && tail(3) ? 4 : 0;
  }
  return 0;
}

class Splitter {
 public:
  Splitter(std::string_view text, std::vector<std::string_view>& leaves) : text_(text), leaves_(leaves) {}

  bool run(bool array) {
    spaces();
    const bool good = peek() == (array ? '[' : '{') && (array ? elements(1) : members(1));
    spaces();
    return good && at_ == text_.size();
  }

 private:
  std::string_view text_;
  std::vector<std::string_view>& leaves_;
  std::size_t at_ = 0;
  bool inside_leaf_ = false;

  [[nodiscard]] char peek() const { return at_ < text_.size() ? text_[at_] : kHole; }
  void spaces() {
    while (at_ < text_.size() && is_space(text_[at_])) {
      ++at_;
    }
  }
  bool take(char c) {
    if (peek() != c) {
      return false;
    }
    ++at_;
    return true;
  }
  bool take(std::string_view word) {
    if (text_.substr(at_, word.size()) != word) {
      return false;
    }
    at_ += word.size();
    return true;
  }

  template <class Item>
  bool items(char open, char close, Item item) {
    take(open);
    spaces();
    if (take(close)) {
      return true;
    }
    do {
      spaces();
      if (!item()) {
        return false;
      }
      spaces();
    } while (take(','));
    return take(close);
  }
  bool members(int depth) {
    return items('{', '}', [&] {
      if (!string()) {
        return false;
      }
      spaces();
      if (!take(':')) {
        return false;
      }
      spaces();
      return value(depth);
    });
  }
  bool elements(int depth) {
    return items('[', ']', [&] { return value(depth); });
  }

  bool value(int depth) {
    if (depth >= kDepth) {
      return false;
    }
    if (peek() == '{') {
      return members(depth + 1);
    }
    const bool outermost = !inside_leaf_;
    const std::size_t begin = at_;
    inside_leaf_ = true;
    const bool good = leaf(depth);
    if (outermost) {
      inside_leaf_ = false;
      leaves_.push_back(text_.substr(begin, at_ - begin));
    }
    return good;
  }
  bool leaf(int depth) {
    switch (peek()) {
      case '[':
        return elements(depth + 1);
      case '"':
        return string();
      case 't':
        return take("true");
      case 'f':
        return take("false");
      case 'n':
        return take("null");
      default:
        return number();
    }
  }

  bool string() {
    if (!take('"')) {
      return false;
    }
    while (at_ < text_.size()) {
      const auto c = static_cast<unsigned char>(text_[at_]);
      if (c == '"') {
        ++at_;
        return true;
      }
      if (c == '\\') {
        if (!escape()) {
          return false;
        }
      } else if (c < 0x20) {
        return false;
      } else {
        const std::size_t length = c < 0x80 ? 1 : utf8_length(text_, at_);
        if (length == 0) {
          return false;
        }
        at_ += length;
      }
    }
    return false;
  }
  bool escape() {
    constexpr std::string_view kSimple = "\"\\/bfnrt";
    ++at_;
    const char c = peek();
    ++at_;
    if (c != 'u') {
      return c != kHole && kSimple.find(c) != std::string_view::npos;
    }
    const int unit = hex4(text_, at_);
    at_ += 4;
    if (unit < kHighSurrogate || unit >= kAfterSurrogates) {
      return unit >= 0;
    }
    const int low = unit < kLowSurrogate && take("\\u") ? hex4(text_, at_) : -1;
    at_ += 4;
    return low >= kLowSurrogate && low < kAfterSurrogates;
  }

  bool number() {
    const std::size_t begin = at_;
    while (at_ < text_.size() && (is_digit(text_[at_]) || std::string_view("+-.eE").find(text_[at_]) < 5)) {
      ++at_;
    }
    const std::string_view text = text_.substr(begin, at_ - begin);
    const NumberText seen = scan_number(text);
    if (!seen.valid || seen.padded) {
      return false;
    }
    constexpr unsigned kSurelyFits = 18;
    if (!seen.exponent && seen.whole_digits + seen.decimals <= kSurelyFits) {
      return true;
    }
    double real = 0;
    std::uint64_t whole = 0;
    const char* const end = text.data() + text.size();
    const char* const digits = text.data() + (seen.negative ? 1 : 0);
    if (!seen.exponent && seen.decimals == 0) {
      const bool fits = std::from_chars(digits, end, whole).ec == std::errc();
      return fits && (!seen.negative || whole <= std::uint64_t{1} << 63U);
    }
    return std::from_chars(text.data(), end, real).ec == std::errc();
  }
};

/// Walks the shape of an object and collects its names.
class Namer {
 public:
  Namer(std::string_view shape, std::vector<JsonHole>& holes, std::vector<JsonObject>& objects)
      : shape_(shape), holes_(holes), objects_(objects) {}

  bool run() {
    spaces();
    const bool good = object(0);
    spaces();
    return good && at_ == shape_.size();
  }

 private:
  std::string_view shape_;
  std::vector<JsonHole>& holes_;
  std::vector<JsonObject>& objects_;
  std::size_t at_ = 0;
  std::string path_;

  void spaces() {
    while (at_ < shape_.size() && is_space(shape_[at_])) {
      ++at_;
    }
  }
  bool take(char c) {
    if (at_ >= shape_.size() || shape_[at_] != c) {
      return false;
    }
    ++at_;
    return true;
  }
  bool object(int depth) {
    const std::size_t index = objects_.size();
    objects_.push_back({path_, at_, 0, holes_.size(), 0});
    if (depth >= kDepth || !take('{')) {
      return false;
    }
    spaces();
    if (!take('}')) {
      do {
        spaces();
        if (!member(depth)) {
          return false;
        }
        spaces();
      } while (take(','));
      if (!take('}')) {
        return false;
      }
    }
    objects_[index].end = at_;
    objects_[index].last = holes_.size();
    return true;
  }
  bool member(int depth) {
    const std::size_t parent = path_.size();
    if (!key(depth)) {
      return false;
    }
    spaces();
    if (!take(':')) {
      return false;
    }
    spaces();
    bool good = path_.size() <= kMaxPathBytes && holes_.size() < kMaxHoles && objects_.size() < kMaxHoles;
    if (take(kHole)) {
      holes_.push_back({path_});
    } else {
      good = good && object(depth + 1);
    }
    path_.resize(parent);
    return good;
  }
  bool key(int depth) {
    const std::size_t begin = at_;
    if (!take('"')) {
      return false;
    }
    while (at_ < shape_.size() && shape_[at_] != '"') {
      at_ += shape_[at_] == '\\' ? 2U : 1U;
    }
    if (!take('"')) {
      return false;
    }
    path_ += depth == 0 ? "" : ".";
    for (const char c : unescape(shape_.substr(begin, at_ - begin))) {
      if (c == '.' || c == '\\') {
        path_ += '\\';
      }
      path_ += c;
    }
    return true;
  }
};

void append_utf8(std::string& out, std::uint32_t point) {
  const auto tail = [&](unsigned shift) { out += static_cast<char>(0x80U | (point >> shift & 0x3FU)); };
  if (point < 0x80) {
    out += static_cast<char>(point);
  } else if (point < 0x800) {
    out += static_cast<char>(0xC0U | point >> 6U);
    tail(0);
  } else if (point < 0x10000) {
    out += static_cast<char>(0xE0U | point >> 12U);
    tail(6);
    tail(0);
  } else {
    out += static_cast<char>(0xF0U | point >> 18U);
    tail(12);
    tail(6);
    tail(0);
  }
}

/// `at` stands on the 'u'; moved to its last digit.
void append_unit(std::string& out, std::string_view text, std::size_t& at) {
  int point = std::max(hex4(text, at + 1), 0);
  at += 4;
  if (point >= kHighSurrogate && point < kLowSurrogate && text.substr(std::min(at + 1, text.size()), 2) == "\\u") {
    const int low = hex4(text, at + 3);
    if (low >= kLowSurrogate && low < kAfterSurrogates) {
      point = 0x10000 + (point - kHighSurrogate) * 0x400 + (low - kLowSurrogate);
      at += 6;
    }
  }
  append_utf8(out, static_cast<std::uint32_t>(point));
}

}  // namespace

bool split_json(std::string_view text, bool array, std::string& shape, std::vector<std::string_view>& leaves) {
  leaves.clear();
  shape.clear();
  if (!Splitter(text, leaves).run(array)) {
    return false;
  }
  const char* from = text.data();
  for (const std::string_view leaf : leaves) {
    shape.append(from, leaf.data());
    shape += kHole;
    from = leaf.data() + leaf.size();
  }
  shape.append(from, text.data() + text.size());
  return true;
}

void split_digits(std::string_view text, std::string& shape, std::vector<std::string_view>& leaves) {
  constexpr std::size_t kLongest = 18;
  leaves.clear();
  shape.clear();
  for (std::size_t at = 0; at < text.size();) {
    std::size_t end = at;
    while (end < text.size() && is_digit(text[end]) && end - at < kLongest) {
      ++end;
    }
    if (end > at) {
      leaves.push_back(text.substr(at, end - at));
      shape += kHole;
      at = end;
    } else {
      shape += text[at++];
    }
  }
}

bool name_holes(std::string_view shape, std::vector<JsonHole>& holes, std::vector<JsonObject>& objects) {
  holes.clear();
  objects.clear();
  return Namer(shape, holes, objects).run();
}

bool to_whole(double real, std::int64_t& integer) {
  constexpr double kLimit = 9.2e18;  // below 2^63: everything in between converts
  if (!(std::abs(real) <= kLimit) || std::trunc(real) != real) {
    return false;
  }
  integer = static_cast<std::int64_t>(real);
  return true;
}

JsonValue json_value(std::string_view leaf) {
  JsonValue value;
  value.kind = ValueKind::object;
  switch (leaf.empty() ? kHole : leaf.front()) {
    case '[':
      value.kind = ValueKind::array;
      return value;
    case '"':
      value.kind = leaf.size() > 1 && leaf.back() == '"' ? ValueKind::text : value.kind;
      return value;
    case 't':
    case 'f':
      value.kind = ValueKind::flag;
      value.integer = leaf.front() == 't' ? 1 : 0;
      return value;
    case 'n':
      value.kind = ValueKind::null;
      return value;
    default:
      break;
  }
  const char* const end = leaf.data() + leaf.size();
  const auto [stop, error] = std::from_chars(leaf.data(), end, value.real);
  if (error != std::errc() || stop != end) {
    return value;
  }
  value.kind = ValueKind::number;
  const auto [whole_stop, whole_error] = std::from_chars(leaf.data(), end, value.integer);
  const bool spelt_whole = whole_error == std::errc() && whole_stop == end;
  const bool fraction = leaf.find_first_of(".eE") != std::string_view::npos;
  if (spelt_whole || (fraction && to_whole(value.real, value.integer))) {
    value.kind = ValueKind::whole;
  }
  return value;
}

std::string unescape(std::string_view quoted) {
  constexpr std::string_view kNames = "bfnrt";
  constexpr std::string_view kMeanings = "\b\f\n\r\t";
  std::string text;
  const std::size_t end = quoted.size() > 1 ? quoted.size() - 1 : 0;
  for (std::size_t at = 1; at < end; ++at) {
    if (quoted[at] != '\\' || at + 1 >= end) {
      text += quoted[at];
      continue;
    }
    ++at;
    const std::size_t name = kNames.find(quoted[at]);
    if (quoted[at] == 'u') {
      append_unit(text, quoted, at);
    } else {
      text += name == std::string_view::npos ? quoted[at] : kMeanings[name];
    }
  }
  return text;
}

}  // namespace tacho::store
