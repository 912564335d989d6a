#pragma once
// The text of an object's values exactly as they stand in the body. The DOM forgets positions; this walks the bytes
// beside it, only as far as somebody asks.

#include <cstddef>
#include <string_view>

namespace tacho::wire {

/// `text` must be an object of valid JSON (the parser has accepted it); views into it are returned.
class RawMembers {
 public:
  explicit RawMembers(std::string_view text) : text_(text) {}
  /// The members of the object that is member `index` of `parent`; looked up when first asked.
  RawMembers(RawMembers& parent, std::size_t index) : parent_(&parent), parent_index_(index) {}

  /// Text of the value of member `index` (from 0, in the order of the body). Indices must not decrease from call to
  /// call.
  std::string_view value(std::size_t index);

 private:
  std::string_view text_;
  RawMembers* parent_ = nullptr;
  std::size_t parent_index_ = 0;
  std::size_t position_ = 0;  // after the last value walked over
  std::size_t walked_ = 0;    // members walked over
  std::string_view last_;     // value of member walked_ - 1
};

}  // namespace tacho::wire
