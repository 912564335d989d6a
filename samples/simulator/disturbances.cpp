#include "samples/simulator/disturbances.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace tacho::sim {
namespace {

enum Stream : std::uint64_t { kBlocks = 101, kSlowed = 102, kSlips = 103, kJumps = 104, kAlarms = 1000 };

constexpr double kBlockMargin = 0.3;
constexpr double kSlowedLength = 3.0;
constexpr double kSlowedSpeed = 0.3;
constexpr double kSlipLength = 2.0;
constexpr double kJumpLasts = 20.0;
constexpr int kDynamicObstacle = 6;

Micros micros(double seconds) { return std::llround(seconds * 1e6); }

// Where the run is inside the circle of a hot spot: [from, to] in metres along it.
struct Span {
  double from_m;
  double to_m;
};

std::vector<Span> spans_inside(const Run& run, Pose pose, const HotSpot& spot) {
  constexpr double kStep = 0.05;
  std::vector<Span> spans;
  bool inside = false;
  double base = 0;
  for (const Stretch& stretch : run) {
    Piece piece;
    piece.start = pose;
    piece.curvature = stretch.curvature;
    piece.v0_mps = 1;
    const auto steps = static_cast<int>(std::ceil(stretch.length_m / kStep));
    for (int i = 0; i < steps; ++i) {
      const double s = stretch.length_m * i / steps;
      const Pose p = kinematics(piece, s).pose;
      const bool now = std::hypot(p.x_m - spot.x_m, p.y_m - spot.y_m) <= spot.radius_m;
      if (now && !inside) {
        spans.push_back({base + s, base + s});
      } else if (now) {
        spans.back().to_m = base + s;
      }
      inside = now;
    }
    pose = kinematics(piece, stretch.length_m).pose;
    base += stretch.length_m;
  }
  return spans;
}

// Changes [from, to] of a run with `edit`, splitting stretches at its ends.
template <class Edit>
Run edited(const Run& run, double from_m, double to_m, Edit edit) {
  Run result;
  double base = 0;
  for (const Stretch& stretch : run) {
    const double end = base + stretch.length_m;
    const double a = std::clamp(from_m, base, end);
    const double b = std::clamp(to_m, base, end);
    const double cuts[] = {base, a, b, end};
    for (int i = 0; i < 3; ++i) {
      if (cuts[i + 1] - cuts[i] <= 1e-6) {
        continue;
      }
      result.push_back(stretch);
      result.back().length_m = cuts[i + 1] - cuts[i];
      if (i == 1) {
        edit(result.back());
      }
    }
    base = end;
  }
  return result;
}

}  // namespace

AlarmTimeline::AlarmTimeline(const AlarmSpec& spec, std::uint64_t seed, std::uint64_t stream, Micros t0_us)
    : spec_(spec), key_(mix64(seed ^ mix64(stream))), rng_(seed, stream), frontier_us_(t0_us) {}

std::optional<Interval> AlarmTimeline::next(Micros t_us) {
  if (spec_.per_hour <= 0) {
    return std::nullopt;
  }
  while (cursor_ < intervals_.size() && intervals_[cursor_].to_us <= t_us) {
    ++cursor_;
  }
  while (cursor_ == intervals_.size()) {
    const double wait_s = (intervals_.empty() ? 0.0 : spec_.min_gap_s) + rng_.exponential(3600 / spec_.per_hour);
    const double lasts_s = spec_.min_duration_s + rng_.exponential(spec_.mean_duration_s);
    const Micros from = frontier_us_ + micros(wait_s);
    frontier_us_ = from + std::max<Micros>(1, micros(lasts_s));
    intervals_.push_back({from, frontier_us_});
    if (frontier_us_ <= t_us) {
      ++cursor_;
    }
  }
  return intervals_[cursor_];
}

std::int64_t AlarmTimeline::times(Micros from_us, Micros t_us) const {
  const Noise noise(key_, from_us);
  if (noise.uniform(0) > 1.0 / 3) {
    return 1;
  }
  return 1 + (t_us - from_us) / micros(5 + 25 * noise.uniform(1));
}

Alarms::Alarms(const Scenario& scenario, Micros t0_us) {
  std::uint64_t stream = kAlarms;
  for (const AlarmSpec& spec : scenario.alarms) {
    reported_.emplace_back(spec, scenario.seed, stream, t0_us);
    if (spec.stops_robot) {
      stopping_.emplace_back(spec, scenario.seed, stream, t0_us);
    }
    ++stream;
  }
}

std::optional<Interval> Alarms::next_stop(Micros t_us) {
  std::optional<Interval> first;
  for (AlarmTimeline& timeline : stopping_) {
    const std::optional<Interval> interval = timeline.next(t_us);
    if (interval && (!first || interval->from_us < first->from_us)) {
      first = interval;
    }
  }
  return first;
}

void Alarms::active(Micros t_us, double clock_offset_s, std::vector<ActiveAlarm>& out) {
  out.clear();
  for (AlarmTimeline& timeline : reported_) {
    const std::optional<Interval> interval = timeline.next(t_us);
    if (!interval || interval->from_us > t_us) {
      continue;
    }
    const AlarmSpec& spec = timeline.spec();
    const Micros robot_us = interval->from_us + micros(clock_offset_s);
    out.push_back({spec.level, spec.code, robot_us / 1'000'000, timeline.times(interval->from_us, t_us), spec.desc});
  }
}

std::vector<TrueAlarm> Alarms::truth(Micros t1_us) const {
  std::vector<TrueAlarm> result;
  for (const AlarmTimeline& timeline : reported_) {
    for (const Interval& interval : timeline.intervals()) {
      if (interval.from_us < t1_us) {
        result.push_back(
            {timeline.spec().level, timeline.spec().code, interval.from_us, std::min(interval.to_us, t1_us)});
      }
    }
  }
  std::stable_sort(result.begin(), result.end(),
                   [](const TrueAlarm& a, const TrueAlarm& b) { return a.from_us < b.from_us; });
  return result;
}

FloorTrouble::FloorTrouble(const Scenario& scenario)
    : scenario_(scenario),
      blocks_(scenario.seed, kBlocks),
      slowed_(scenario.seed, kSlowed),
      slips_(scenario.seed, kSlips) {}

std::vector<Block> FloorTrouble::blocks(const Run& run, Pose start) {
  std::vector<Block> all;
  const auto add = [&](double at_m, double mean_s, int reason) {
    all.push_back({at_m, 2 + blocks_.exponential(std::max(0.0, mean_s - 2)), blocks_.uniform(0.6, 1.0), reason});
  };
  for (const HotSpot& spot : scenario_.hot_spots) {
    for (const Span& span : spans_inside(run, start, spot)) {
      if (blocks_.chance(spot.probability)) {
        add(blocks_.uniform(span.from_m, span.to_m), spot.mean_duration_s, spot.reason);
      }
    }
  }
  const double total = length(run);
  if (blocks_.chance(scenario_.blocks_per_km * total / 1000)) {
    add(blocks_.uniform(0, total), 10, kDynamicObstacle);
  }
  std::sort(all.begin(), all.end(), [](const Block& a, const Block& b) { return a.at_m < b.at_m; });
  std::vector<Block> kept;
  for (const Block& block : all) {
    const double last = kept.empty() ? 0 : kept.back().at_m;
    if (block.at_m > last + kBlockMargin && block.at_m < total - kBlockMargin) {
      kept.push_back(block);
    }
  }
  return kept;
}

Run FloorTrouble::roughen(Run run) {
  const double total = length(run);
  if (slowed_.chance(scenario_.slowed_per_km * total / 1000)) {
    const double from = slowed_.uniform(0, total);
    run = edited(run, from, from + kSlowedLength, [](Stretch& s) {
      s.slowed = true;
      s.v_max_mps = std::min(s.v_max_mps, kSlowedSpeed);
    });
  }
  if (total > 2 * kSlipLength && slips_.chance(scenario_.slips_per_km * total / 1000)) {
    const double from = slips_.uniform(0, total - kSlipLength);
    const double gain = 1 + scenario_.slip_m / kSlipLength;
    run = edited(run, from, from + kSlipLength, [gain](Stretch& s) { s.wheel_gain = gain; });
  }
  return run;
}

Localisation::Localisation(const Scenario& scenario, Micros t0_us) : scenario_(scenario), rng_(scenario.seed, kJumps) {
  if (scenario_.jumps_per_hour > 0) {
    generate(t0_us);
  }
}

void Localisation::generate(Micros t_us) {
  const Micros at = t_us + micros(rng_.exponential(3600 / scenario_.jumps_per_hour));
  const double direction = rng_.uniform(-std::numbers::pi, std::numbers::pi);
  const TrueJump wrong{at, scenario_.jump_m * std::cos(direction), scenario_.jump_m * std::sin(direction)};
  jumps_.push_back(wrong);
  jumps_.push_back({at + micros(kJumpLasts), -wrong.dx_m, -wrong.dy_m});
}

Localisation::Offset Localisation::offset(Micros t_us) {
  while (passed_ < jumps_.size() && jumps_[passed_].t_us <= t_us) {
    const TrueJump jump = jumps_[passed_];
    // Sums of the two steps must be zero again, exactly.
    now_ = passed_ % 2 == 0 ? Offset{jump.dx_m, jump.dy_m} : Offset{};
    if (++passed_ == jumps_.size()) {
      generate(jump.t_us);
    }
  }
  return now_;
}

std::vector<TrueJump> Localisation::truth(Micros t1_us) const {
  std::vector<TrueJump> result;
  for (const TrueJump& jump : jumps_) {
    if (jump.t_us <= t1_us) {
      result.push_back(jump);
    }
  }
  return result;
}

}  // namespace tacho::sim
