#include "analyzer/analyses/alarm_measures.hpp"
#include "schema/time.hpp"

#include <algorithm>
#include <deque>

namespace tacho {
namespace {

/// Mean of 1 / r over successive raises, r at least 1 s.
struct ChatterIndex {
  double mid = 0.0, lo = 0.0, hi = 0.0;
  void add(const Raise& a, const Raise& b) {
    const auto term = [](double r) { return 1.0 / std::max(1.0, r); };
    mid += term(to_seconds(b.mid_us() - a.mid_us()));
    lo += term(to_seconds(b.hi_us - a.lo_us));
    hi += term(to_seconds(b.lo_us - a.hi_us));
  }
};

}  // namespace

std::vector<Raise> raises_of(std::span<const AlarmInterval> intervals, std::size_t robot) {
  std::vector<Raise> raises;
  for (const AlarmInterval& a : intervals) {
    if (a.counts()) {
      raises.push_back({a.onset_lo_us.value_or(a.onset_hi_us), a.onset_hi_us, a.key, robot});
    }
  }
  sort_by_middle(raises);
  return raises;
}

void sort_by_middle(std::vector<Raise>& raises) {
  std::stable_sort(raises.begin(), raises.end(),
                   [](const Raise& a, const Raise& b) { return a.mid_us() < b.mid_us(); });
}

std::vector<Flood> find_floods(std::span<const Raise> raises, const FloodRule& rule, Micros end_us) {
  std::vector<Flood> floods;
  std::deque<Raise> window;
  bool in_flood = false;
  const auto expire = [&](Micros now_us) {
    while (!window.empty() && window.front().mid_us() + rule.window_us <= now_us) {
      const Micros left_us = window.front().mid_us() + rule.window_us;
      window.pop_front();
      if (in_flood && window.size() < rule.below) {
        floods.back().to_us = left_us;
        in_flood = false;
      }
    }
  };
  for (const Raise& raise : raises) {
    expire(raise.mid_us());
    window.push_back(raise);
    if (!in_flood && window.size() > rule.above) {
      in_flood = true;
      floods.push_back({raise.mid_us(), 0, window.size(), window.size(), window.front()});
    } else if (in_flood) {
      ++floods.back().raises;
      floods.back().peak = std::max(floods.back().peak, window.size());
    }
  }
  expire(end_us);
  if (in_flood) {
    floods.back().to_us = std::max(end_us, floods.back().from_us);
  }
  return floods;
}

Chatter chattering(std::span<const Raise> raises, const ChatterRule& rule) {
  Chatter out;
  ChatterIndex index;
  Micros run_end_us = 0;
  std::size_t first = 0;
  for (std::size_t i = 0; i < raises.size(); ++i) {
    if (i > 0) {
      index.add(raises[i - 1], raises[i]);
    }
    while (raises[i].mid_us() - raises[first].mid_us() > rule.window_us) {
      ++first;
    }
    out.most = std::max(out.most, i - first + 1);
    if (i + 1 >= rule.raises) {
      const Raise& start = raises[i + 1 - rule.raises];
      out.sure = out.sure || raises[i].hi_us - start.lo_us <= rule.window_us;
      out.possible = out.possible || raises[i].lo_us - start.hi_us <= rule.window_us;
    }
    if (i - first + 1 >= rule.raises) {
      const bool fresh = out.runs == 0 || raises[first].mid_us() > run_end_us;
      out.from_us = out.runs == 0 ? raises[first].mid_us() : out.from_us;
      out.to_us = out.runs == 0 || (out.runs == 1 && !fresh) ? raises[i].mid_us() : out.to_us;
      out.runs += fresh ? 1 : 0;
      run_end_us = raises[i].mid_us();
    }
  }
  if (raises.size() > 1) {
    const double n = static_cast<double>(raises.size() - 1);
    out.index = index.mid / n;
    out.index_lo = index.lo / n;
    out.index_hi = index.hi / n;
  }
  return out;
}

Lasting fleeting(std::span<const AlarmInterval> intervals, double limit_s) {
  Lasting out;
  for (const AlarmInterval& a : intervals) {
    const std::optional<double> hi = a.duration_hi_s();
    out.sure += hi && *hi < limit_s ? 1 : 0;
    out.possible += a.duration_lo_s() < limit_s && a.clear != Clear::open ? 1 : 0;
  }
  return out;
}

Lasting stale(std::span<const AlarmInterval> intervals, double limit_s) {
  Lasting out;
  for (const AlarmInterval& a : intervals) {
    const std::optional<double> hi = a.duration_hi_s();
    // The end of an open alarm is the future: what can be said is how long it has been standing.
    const std::optional<double> longest =
        a.clear == Clear::open && a.onset_lo_us ? to_seconds(a.clear_lo_us - *a.onset_lo_us) : hi;
    out.sure += a.duration_lo_s() > limit_s ? 1 : 0;
    out.possible += !longest || *longest > limit_s ? 1 : 0;
  }
  return out;
}

std::optional<double> dispersion(std::span<const double> counts, std::span<const double> exposures) {
  double k = 0.0;
  double e = 0.0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    k += counts[i];
    e += exposures[i];
  }
  if (counts.size() < 5 || k < 5.0 || e <= 0.0) {
    return std::nullopt;
  }
  double chi = 0.0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    const double mean = k / e * exposures[i];
    chi += mean > 0.0 ? (counts[i] - mean) * (counts[i] - mean) / mean : 0.0;
  }
  return chi / static_cast<double>(counts.size() - 1);
}

}  // namespace tacho
