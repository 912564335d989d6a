#pragma once
// Which answers of a part are asked for.

#include <array>
#include <functional>
#include <optional>
#include <string>

#include "schema/row_source.hpp"

namespace tacho::store {

struct AnswerQuery {
  RobotId robot = 0;
  std::array<bool, kSourceCount> sources{};
  Window window;
  std::optional<SessionId> session = std::nullopt;  ///< empty: all
  [[nodiscard]] bool asks_for(SessionId of, RobotId id, Source source) const {
    return id == robot && of == session.value_or(of) && sources[static_cast<std::size_t>(source)];
  }
};

/// Told of damage, in words.
using Report = std::function<void(const std::string&)>;

}  // namespace tacho::store
