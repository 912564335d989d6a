#pragma once
// JSON seen as text: where its scalars stand, and what a scalar means. Stricter than any parser used for decoding, so
// what is taken apart here is also read there.

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace tacho::store {

/// Marks the place of a leaf in a shape; valid JSON does not contain this byte.
inline constexpr char kHole = '\0';

/// Takes `text` apart into its shape (the text with every leaf replaced by kHole) and its leaves (views into `text`).
/// Objects are opened; arrays below the top are leaves as a whole. False, and nothing usable, for anything but one
/// object (or array, when `array`), and for what decoders may refuse: bad UTF-8, lone surrogates, numbers beyond a
/// double, more than 64 levels. Objects without members are part of the shape.
[[nodiscard]] bool split_json(std::string_view text, bool array, std::string& shape,
                              std::vector<std::string_view>& leaves);

/// Shape and leaves of a JSON string whose runs of digits (at most 18 long) are the leaves.
void split_digits(std::string_view text, std::string& shape, std::vector<std::string_view>& leaves);

/// A hole of the shape of an object, in order. `path`: keys joined by '.', from the root; '.' and '\' inside a key are
/// preceded by '\'.
struct JsonHole {
  std::string path;
};
/// An object inside a shape: shape[begin, end) from brace to brace, holes [first, last).
struct JsonObject {
  std::string path;
  std::size_t begin = 0;
  std::size_t end = 0;
  std::size_t first = 0;
  std::size_t last = 0;
};
inline constexpr std::size_t kMaxHoles = 4096;
inline constexpr std::size_t kMaxPathBytes = 4096;
/// Finds the names in the shape of an object. False when it is none (the shape may come from a damaged file) or has
/// more, or longer, names than these limits.
[[nodiscard]] bool name_holes(std::string_view shape, std::vector<JsonHole>& holes, std::vector<JsonObject>& objects);

/// What a JSON value is.
enum class ValueKind : std::uint8_t {
  absent,
  null,
  number,
  whole,  ///< number that `integer` holds exactly, however spelt (5, 5.0)
  flag,   ///< `integer` is 0 or 1
  text,   ///< string
  array,
  object,
};

struct JsonValue {
  ValueKind kind = ValueKind::absent;
  double real = 0;  ///< nearest double; -0.0 also for "-0"
  std::int64_t integer = 0;
};
/// The meaning of a leaf. Anything that is no JSON value is an `object`.
JsonValue json_value(std::string_view leaf);
/// The number as an integer when it is whole.
bool to_whole(double real, std::int64_t& integer);

/// The text of a JSON string without quotes and escapes.
std::string unescape(std::string_view quoted);

}  // namespace tacho::store
