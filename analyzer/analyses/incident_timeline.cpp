#include "analyzer/analyses/incident_timeline.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>
#include <tuple>

#include "schema/events.hpp"

namespace tacho {
namespace {

constexpr Micros kSourceLag = 2'000'000;   // the robot's own interfaces lag behind each other
constexpr Micros kNewsAfter = 10'000'000;  // seen so much later it is told again: a source was silent in between

/// A line, and which sources have told it.
struct Told {
  std::size_t line = 0;
  std::set<std::string> sources;
};

bool same_moment(const TimeLine& first, const TimeLine& again) {
  return again.t_us - first.t_us <= kNewsAfter && again.hull_from_us - first.hull_to_us <= kSourceLag;
}

void join(TimeLine& first, const TimeLine& again) {
  const double later_s = static_cast<double>(again.t_us - first.t_us) / 1e6;
  first.source += ", " + again.source;
  first.detail += fmt::format("{}{} {:.3f} s later", first.detail.empty() ? "" : "; ", again.source, later_s);
  if (again.hull_from_us < first.hull_to_us) {
    first.hull_from_us = std::max(first.hull_from_us, again.hull_from_us);
  }
}

}  // namespace

bool is_of_robot(EventKind kind) {
  return derived_from_answers(kind) && kind != EventKind::unknown_key && kind != EventKind::undecodable;
}

std::vector<TimeLine> join_repeats(std::vector<TimeLine> lines) {
  std::stable_sort(lines.begin(), lines.end(), [](const TimeLine& a, const TimeLine& b) {
    return std::tie(a.t_us, a.rank, a.robot, a.source) < std::tie(b.t_us, b.rank, b.robot, b.source);
  });
  std::vector<TimeLine> out;
  std::map<std::tuple<std::string, std::string, std::string>, std::vector<Told>> told;  // oldest first
  for (TimeLine& line : lines) {
    if (line.of_robot) {
      std::vector<Told>& before = told[{line.robot, line.what, line.new_value}];
      // The newest that this source has not told: a flag that flickers is paired edge by edge.
      const auto same = std::find_if(before.rbegin(), before.rend(), [&](const Told& t) {
        return t.sources.count(line.source) == 0 && same_moment(out[t.line], line);
      });
      if (same != before.rend()) {
        same->sources.insert(line.source);
        join(out[same->line], line);
        continue;
      }
      before.push_back({out.size(), {line.source}});
    }
    out.push_back(std::move(line));
  }
  return out;
}

}  // namespace tacho
