#pragma once
// Which answers of a part are asked for.

#include <array>
#include <functional>
#include <string>

#include "schema/row_source.hpp"

namespace tacho::store {

struct AnswerQuery {
  RobotId robot = 0;
  std::array<bool, kSourceCount> sources{};
  Window window;
  [[nodiscard]] bool asks_for(RobotId id, Source source) const {
    return id == robot && sources[static_cast<std::size_t>(source)];
  }
};

/// Told of damage, in words.
using Report = std::function<void(const std::string&)>;

}  // namespace tacho::store
