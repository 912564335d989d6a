#include "schema/rollup_check.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace tacho {

namespace {

std::string name_of(const Rollup& row) {
  return fmt::format("rollup of robot {} {} {} minute {}", row.robot, source_name(row.source), field_at(row.field).name,
                     row.minute);
}

/// Sums were added up block by block, here answer by answer.
bool same_sum(const Rollup& a, const Rollup& b) {
  const double size = static_cast<double>(a.rows) * std::max(std::abs(a.min), std::abs(a.max));
  return std::abs(a.sum - b.sum) <= 1e-12 * static_cast<double>(a.rows) * size;
}

bool same(const Rollup& a, const Rollup& b) {
  return a.rows == b.rows && a.min == b.min && a.max == b.max && a.last == b.last && same_sum(a, b);
}

}  // namespace

void RollupCheck::add(const Sample& sample) {
  if (sample.meta.source == Source::status) {
    status_gave_ |= sample.valued();
  }
  store::add_to(made_[static_cast<std::size_t>(sample.meta.source)], sample.meta, sample, store::rollup_fields());
}

std::string RollupCheck::difference(const Rollup& stored) const {
  const store::RollupRows& rows = made_[static_cast<std::size_t>(stored.source)];
  const auto made = rows.find({stored.minute, stored.field});
  if (made == rows.end()) {
    return name_of(stored) + ": there is no such answer";
  }
  const bool partly = stored.source != Source::status && status_gave_[stored.field];
  if (partly ? stored.rows <= made->second.rows : same(stored, made->second)) {
    return "";
  }
  return fmt::format("{}: it says {} rows, {} to {}, sum {}, last {}; the answers say {}, {} to {}, {}, {}",
                     name_of(stored), stored.rows, stored.min, stored.max, stored.sum, stored.last, made->second.rows,
                     made->second.min, made->second.max, made->second.sum, made->second.last);
}

std::vector<std::string> RollupCheck::compare(const std::vector<Rollup>& stored) {
  std::vector<std::string> wrong;
  for (const Rollup& row : stored) {
    if (std::string words = difference(row); !words.empty()) {
      wrong.push_back(std::move(words));
    }
    made_[static_cast<std::size_t>(row.source)].erase({row.minute, row.field});
  }
  for (const store::RollupRows& rows : made_) {
    for (const auto& [key, row] : rows) {
      if (!stored.empty() && (row.source == Source::status || !status_gave_[row.field])) {
        wrong.push_back(name_of(row) + " is missing");
      }
    }
  }
  *this = RollupCheck();
  return wrong;
}

}  // namespace tacho
