// BLK-01: share of the task time lost to blockage.

#include <fmt/format.h>

#include <algorithm>

#include "analyzer/analyses/blockage_results.hpp"
#include "analyzer/analyses/cells.hpp"

namespace tacho {
namespace {

constexpr std::size_t kEvidence = 5;

/// Lost time of some episodes: sums for the limits, and the worst of them.
struct LostSum {
  double mid_s = 0.0, lo_s = 0.0, hi_s = 0.0, squares = 0.0;
  std::vector<const Loss*> episodes;
};

LostSum lost(const BlockageData& data, std::optional<std::size_t> robot) {
  LostSum sum;
  for (const Loss& loss : data.losses) {
    if (loss.costs && (!robot || *robot == loss.robot)) {
      sum.mid_s += loss.mid_s;
      sum.lo_s += loss.lo_s;
      sum.hi_s += loss.hi_s;
      sum.squares += loss.mid_s * loss.mid_s;
      sum.episodes.push_back(&loss);
    }
  }
  std::stable_sort(sum.episodes.begin(), sum.episodes.end(),
                   [](const Loss* a, const Loss* b) { return a->mid_s > b->mid_s; });
  return sum;
}

/// Two causes of doubt, put together: how many episodes there might have been (scaled Poisson), and how long each was
/// between its polls.
Quantity share(const LostSum& sum, double exposure_s, double typical_s) {
  Quantity q;
  if (sum.mid_s > 0.0) {
    const math::Limits limits = math::scaled_limits(sum.mid_s, sum.squares);
    q = cells::bounded(100.0 * sum.mid_s / exposure_s, 100.0 * limits.lo / exposure_s * sum.lo_s / sum.mid_s,
                       std::min(100.0, 100.0 * limits.hi / exposure_s * sum.hi_s / sum.mid_s), "%");
  } else {
    q = cells::bounded(0.0, 0.0, std::min(100.0, 100.0 * math::garwood(0).hi * typical_s / exposure_s), "%");
    q.reason = fmt::format("no time lost; upper limit for episodes of {:g} s", typical_s);
  }
  q.n = static_cast<std::int64_t>(sum.episodes.size());
  q.exposure = exposure_s / 3'600.0;
  return q;
}

/// What would make the interval narrower: its width comes from the number of episodes, or from the polls their ends lie
/// between. More hours help against the first only.
std::string how_to_narrow(const LostSum& sum, const BlockageData& data, std::optional<std::size_t> robot) {
  const math::Limits limits = sum.mid_s > 0.0 ? math::scaled_limits(sum.mid_s, sum.squares) : math::Limits{};
  if (sum.mid_s <= 0.0 || sum.hi_s - sum.lo_s <= limits.hi - limits.lo) {
    return "record longer";
  }
  Micros period_us = 0;
  std::string source;
  for (std::size_t r = 0; r < data.robots.size(); ++r) {
    if ((!robot || *robot == r) && data.robots[r].period_us > period_us) {
      period_us = data.robots[r].period_us;
      source = data.robots[r].source;
    }
  }
  const double period_s = static_cast<double>(period_us) * 1e-6;
  return period_us > 1'000'000
             ? fmt::format("poll {} at 1 Hz: at a period of {:g} s the ends of episodes are not known", source,
                           period_s)
             : fmt::format("poll {} faster than every {:g} s: episodes are about as short", source, period_s);
}

void unknown(Finding& f, const std::string& reason, const std::string& advice) {
  f.verdict = Verdict::unknown;
  f.value = cells::missing("%", reason);
  f.advice = advice;
}

Finding lost_share(const BlockageData& data, std::optional<std::size_t> robot) {
  const std::string name = robot ? data.robots[*robot].name : "";
  const double pass = data.settings.number("blockage.lost_share_pass", name);
  const double fail = data.settings.number("blockage.lost_share_fail", name);
  Finding f;
  f.id = "BLK-01";
  f.robot = name;
  f.title = "Share of task time lost to blockage";
  f.severity = 6;
  f.threshold = fmt::format("PASS up to {:g} %, FAIL above {:g} %", 100 * pass, 100 * fail);
  f.threshold_source = data.settings.sources({"blockage.lost_share_pass", "blockage.lost_share_fail"}, name);
  double exposure_s = 0.0;
  std::string why_not;
  for (std::size_t r = 0; r < data.robots.size(); ++r) {
    if (!robot || *robot == r) {
      const RobotBlockage& one = data.robots[r];
      exposure_s += one.task_known ? one.task_s : one.observed_s;
      why_not = one.why_not;
    }
  }
  if (!why_not.empty() && exposure_s <= 0.0) {
    unknown(f, why_not, "record status answers (1100) with the key blocked, or the discrete inputs");
    return f;
  }
  if (exposure_s <= 0.0) {
    unknown(f, "no two polls near each other with a running task", "record while the robot works");
    return f;
  }
  const LostSum sum = lost(data, robot);
  f.value = share(sum, exposure_s, data.settings.number("blockage.typical_episode_s", name));
  f.verdict = cells::judge_small(*f.value.lo, *f.value.hi, 100 * pass, 100 * fail);
  f.advice = f.verdict == Verdict::unknown
                 ? "the interval is wider than the PASS band: " + how_to_narrow(sum, data, robot)
                 : "see top_cells and the map of lost time for the places";
  for (std::size_t i = 0; i < std::min(kEvidence, sum.episodes.size()); ++i) {
    const Episode& e = *sum.episodes[i]->episode;
    f.evidence.push_back(
        {e.onset_lo_us.value_or(e.onset_hi_us), e.end_hi_us.value_or(e.end_lo_us),
         data.robots[sum.episodes[i]->robot].source,
         fmt::format("{:.0f} s lost, {}{}", sum.episodes[i]->mid_s, reason_name(e.reason.value_or(kNoReason)),
                     e.at ? fmt::format(" at {:.2f}, {:.2f}", e.at->x, e.at->y) : "")});
  }
  return f;
}

}  // namespace

std::vector<Finding> blockage_findings(const BlockageData& data) {
  std::vector<Finding> out;
  if (data.robots.size() > 1) {
    out.push_back(lost_share(data, std::nullopt));
  }
  for (std::size_t r = 0; r < data.robots.size(); ++r) {
    out.push_back(lost_share(data, r));
  }
  return out;
}

}  // namespace tacho
