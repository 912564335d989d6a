#include "recorder/roster.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace tacho::recorder {

void Roster::know(Row row) { rows_[row.id] = std::move(row); }

void Roster::assign(const std::string& configured, const Row& row) {
  know(row);
  assigned_[configured] = {row.id, false};
}

void Roster::leave(const std::string& configured) {
  if (const auto found = assigned_.find(configured); found != assigned_.end()) {
    found->second.left = true;
  }
}

void Roster::learn(RobotId row, const Identity& told) {
  if (const auto found = rows_.find(row); found != rows_.end()) {
    found->second.identity.learn(told);
  }
}

const Roster::Row* Roster::find(const std::string& configured) const {
  const auto found = assigned_.find(configured);
  return found == assigned_.end() ? nullptr : &rows_.at(found->second.row);
}

std::string Roster::recorded_for(RobotId row) const {
  const auto found = std::find_if(assigned_.begin(), assigned_.end(),
                                  [row](const auto& item) { return item.second.row == row && !item.second.left; });
  return found == assigned_.end() ? "" : found->first;
}

Roster::Place Roster::place(const std::string& configured, const Identity& other) const {
  for (const auto& [id, row] : rows_) {
    if (row.identity.same(other)) {
      const std::string holder = recorded_for(id);
      return {row.name, row.identity, !holder.empty() && holder != configured};
    }
  }
  return new_place(configured, other);
}

const Roster::Row* Roster::named(const std::string& name) const {
  const auto found =
      std::find_if(rows_.begin(), rows_.end(), [&](const auto& item) { return item.second.name == name; });
  return found == rows_.end() ? nullptr : &found->second;
}

Roster::Place Roster::new_place(const std::string& configured, const Identity& other) const {
  int number = 2;
  while (named(fmt::format("{} ({})", configured, number)) != nullptr) {
    ++number;
  }
  return {fmt::format("{} ({})", configured, number), other, false};
}

Roster::Place Roster::first_place(const std::string& configured) const {
  const Row* const row = named(configured);
  if (row == nullptr) {
    return {configured, {}, false};
  }
  return recorded_for(row->id).empty() ? Place{row->name, row->identity, false} : new_place(configured, {});
}

}  // namespace tacho::recorder
