#pragma once
// Code lists: numbers the robot sends and the words they stand for. Unknown codes are kept and shown as numbers.

#include <array>
#include <cstdint>
#include <span>
#include <string_view>

namespace tacho {

struct Code {
  std::int64_t value;
  std::string_view name;     ///< snake_case, stable: it is printed in reports and stored in logs
  std::string_view meaning;  ///< one clause
};

}  // namespace tacho

#include "schema/code_lists.hpp"
