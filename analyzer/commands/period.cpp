#include "analyzer/commands/period.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>

namespace tacho::commands {
namespace {

/// The part of a gap row inside the window; empty when there is none.
std::optional<Gap> clipped(Gap gap, const Window& window) {
  const Micros from_us = std::max(gap.t_from_us, window.from_us);
  const Micros to_us = std::min(gap.t_to_us, window.to_us);
  if (gap.t_from_us == gap.t_to_us) {
    return window.contains(gap.t_from_us) ? std::optional(gap) : std::nullopt;
  }
  if (from_us >= to_us) {
    return std::nullopt;
  }
  const double share = static_cast<double>(to_us - from_us) / static_cast<double>(gap.t_to_us - gap.t_from_us);
  gap.seq_count = static_cast<std::uint64_t>(std::llround(share * static_cast<double>(gap.seq_count)));
  gap.t_from_us = from_us;
  gap.t_to_us = to_us;
  return gap;
}

void add_row(Coverage& to, Micros t_us) {
  to.first_us = to.stored == 0 ? t_us : std::min(to.first_us, t_us);
  to.last_us = to.stored == 0 ? t_us : std::max(to.last_us, t_us);
  ++to.stored;
}

void add_gap(Coverage& to, const Gap& gap) {
  (gap.partial ? to.partial : to.missed) += gap.seq_count;
  to.gaps.add(gap);
}

}  // namespace

std::vector<Coverage> coverage_within(RowSource& log, const std::vector<Coverage>& whole, const Window& window) {
  std::vector<Coverage> out;
  std::set<RobotId> robots;
  for (const Coverage& c : whole) {
    Coverage mine;
    mine.robot = c.robot;
    mine.source = c.source;
    mine.period_us = c.period_us;
    out.push_back(mine);
    robots.insert(c.robot);
  }
  for (const RobotId robot : robots) {
    const auto of = [&](Source source) {
      return std::find_if(out.begin(), out.end(),
                          [&](const Coverage& c) { return c.robot == robot && c.source == source; });
    };
    Selection times;
    times.rows.fill(true);
    times.records = false;
    log.read(robot, window, times, [&](const Slice& slice) {
      for (const Batch& batch : slice.batches) {
        const auto to = of(batch.source);
        for (std::size_t row = 0; to != out.end() && row < batch.rows(); ++row) {
          add_row(*to, batch.t_send_us[row]);
        }
      }
    });
    // Gap rows of the whole log: one that began before the window may reach into it.
    log.read(robot, Window{}, Selection{}, [&](const Slice& slice) {
      for (const Gap& gap : slice.gaps) {
        const std::optional<Gap> inside = clipped(gap, window);
        if (const auto to = of(gap.source); inside && to != out.end()) {
          add_gap(*to, *inside);
        }
      }
    });
  }
  for (Coverage& c : out) {
    c.planned = c.stored + c.missed;
  }
  return out;
}

}  // namespace tacho::commands
