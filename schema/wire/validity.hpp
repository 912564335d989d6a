#pragma once
// When a given value means nothing: its condition is off, or it is the "no sensor" mark. Used by the JSON and the
// register decoder alike.

#include <array>
#include <cmath>

#include "schema/fields.hpp"

namespace tacho::wire {

/// Per field the flag it depends on, or kNoField.
inline constexpr std::array<FieldIndex, kFieldCount> kConditionOf = [] {
  std::array<FieldIndex, kFieldCount> flags{};
  for (std::size_t i = 0; i < kFieldCount; ++i) {
    flags[i] = kFields[i].condition.empty() ? kNoField : find_field(kFields[i].condition);
  }
  return flags;
}();

/// Every flag that some condition names.
inline const FieldSet& condition_flags() {
  static const FieldSet flags = [] {
    FieldSet set;
    for (const FieldIndex flag : kConditionOf) {
      if (flag != kNoField) {
        set.set(flag);
      }
    }
    return set;
  }();
  return flags;
}

/// `value` as the robot sent it, before scaling.
inline bool is_sentinel(Sentinel sentinel, double value) {
  switch (sentinel) {
    case Sentinel::minus_one:
      return value == -1.0;
    case Sentinel::negative_zero:
      return value == 0.0 && std::signbit(value);
    case Sentinel::any_zero:
      return value == 0.0;
    case Sentinel::none:
      break;
  }
  return false;
}

/// -0 is 0, but where it is a mark.
inline double without_minus_zero(Sentinel sentinel, double value) {
  return sentinel == Sentinel::negative_zero ? value : value + 0.0;
}

}  // namespace tacho::wire
