#include "analyzer/analyses/battery_cycles.hpp"

#include <algorithm>
#include <cmath>

namespace tacho::battery {
namespace {

constexpr double kSlack = 1e-9;       // readings are decimal: a step of exactly h must not pass by its rounding
constexpr double kNoiseSigmas = 6.0;  // turns beyond this are no noise
constexpr double kWindowS = 900.0;    // of the fastest rates
constexpr double kUnseenPerH = 1.0;   // limit for a rate that the record never shows: 1 C
constexpr double kOwnNoise = 0.005;   // what a battery management adds to its SoC (METHODS B.2)

/// Most and likeliest variation inside a gap, see the header.
double variation_inside(const SocGap& gap, double charge_per_h, double discharge_per_h) {
  const double hours = gap.hours();
  const double both = charge_per_h + discharge_per_h;
  if (both <= 0.0) {
    return std::abs(gap.change);
  }
  const double charging = std::clamp((gap.change + discharge_per_h * hours) / both, 0.0, hours);
  return std::max(std::abs(gap.change), charge_per_h * charging + discharge_per_h * (hours - charging));
}

}  // namespace

void SocQuantum::add(double soc) {
  if (soc == last_) {
    return;
  }
  last_ = soc;
  ++changes_;
  for (std::size_t i = 0; i < kSteps.size(); ++i) {
    const double multiple = soc / kSteps[i];
    fits_[i] += std::abs(multiple - std::nearbyint(multiple)) * kSteps[i] < 1e-7 ? 1U : 0U;
  }
}

double SocQuantum::value() const {
  for (std::size_t i = 0; i < kSteps.size(); ++i) {
    if (fits_[i] * 1000 >= changes_ * 999) {
      return changes_ < 20 ? std::min(kSteps[i], 0.01) : kSteps[i];
    }
  }
  return 0.0;
}

SocPath::SocPath(const Config& config)
    : config_(config), fine_{TurningPoints(kFine[0] + kSlack), TurningPoints(kFine[1] + kSlack)} {
  for (std::size_t i = 0; i < rungs_.size(); ++i) {
    rungs_[i].filter = TurningPoints(hysteresis(i) + kSlack);
  }
}

double SocPath::hysteresis(std::size_t rung) const {
  return rung == 0 ? config_.hysteresis : std::max(config_.hysteresis, kHysteresis[rung]);
}

void SocPath::step(const Row& row, std::int32_t day) {
  if (std::isnan(row.soc)) {
    return;
  }
  quantum_.add(row.soc);
  bool bridge = false;
  if (any_ && !row.joins(t_us_)) {
    const double pause_s = row.since(t_us_);
    before_ = window_soc_ = kNone;
    if (pause_s > 0.0 && pause_s <= config_.bridge_max_h * 3600) {
      gaps_.push_back({t_us_, row.t_us, row.soc - soc_});
      bridge = true;
    } else {
      left_out_s_ += std::max(0.0, pause_s);
      restart();
    }
  } else if (any_) {
    measure(row);
  }
  push(row, days_[day], bridge);
  any_ = true;
  t_us_ = row.t_us;
  soc_ = row.soc;
}

/// Rates and noise, from a row that joins the one before.
void SocPath::measure(const Row& row) {
  const double dt = row.since(t_us_);
  observed_s_ += dt;
  ++steps_;
  if (!std::isnan(before_)) {
    const double bend = std::abs(row.soc - 2 * soc_ + before_);
    const double bin = bend > 1e-6 ? 1 + std::floor(10 * std::log10(bend / 1e-6)) : 0.0;
    ++bends_[static_cast<std::size_t>(std::min(bin, static_cast<double>(kBins - 1)))];
    ++bend_count_;
  }
  before_ = soc_;
  if (std::isnan(window_soc_)) {
    window_soc_ = soc_;
    window_s_ = 0.0;
  }
  window_s_ += dt;
  if (window_s_ >= kWindowS) {
    const double per_h = (row.soc - window_soc_) / window_s_ * 3600;
    fastest_up_ = std::max(fastest_up_, per_h);
    fastest_down_ = std::max(fastest_down_, -per_h);
    window_soc_ = row.soc;
    window_s_ = 0.0;
  }
}

void SocPath::push(const Row& row, PerRung& day, bool bridge) {
  for (std::size_t i = 0; i < rungs_.size(); ++i) {
    Rung& rung = rungs_[i];
    const int before = rung.filter.direction();
    const double growth = rung.filter.push(row.soc, row.t_us, [&](double value, Micros at) { turn(rung, value, at); });
    rung.path += growth;
    day[i] += growth / 2;
    const int after = rung.filter.direction();
    if (bridge) {
      rung.bridged += growth;
    } else if (after != 0) {
      (after > 0 ? rung.risen : rung.fallen) += growth;
    }
    if (before != after) {
      (before > 0 ? rung.rising_s : rung.falling_s) += before == 0 ? 0.0 : observed_s_ - rung.mark_s;
      rung.mark_s = observed_s_;
    }
  }
  for (std::size_t i = 0; i < fine_.size(); ++i) {
    fine_path_[i] += fine_[i].push(row.soc, row.t_us, [](double, Micros) {});
  }
}

void SocPath::turn(Rung& rung, double value, Micros at) {
  if (!std::isnan(rung.last_turn)) {
    rung.variation.add(std::abs(value - rung.last_turn));
  }
  rung.last_turn = value;
  ++rung.turns;
  rung.flow.push(value, at, [&](const RainflowCycle& c) { rung.cycles.push_back(c); });
}

/// Ends the chain of turning points; the next reading starts another one.
void SocPath::restart() {
  for (std::size_t i = 0; i < rungs_.size(); ++i) {
    Rung& rung = rungs_[i];
    const int direction = rung.filter.direction();
    const double growth = rung.filter.finish([&](double value, Micros at) { turn(rung, value, at); });
    rung.path += growth;
    if (!days_.empty()) {
      days_.rbegin()->second[i] += growth / 2;
    }
    if (direction != 0) {
      (direction > 0 ? rung.rising_s : rung.falling_s) += observed_s_ - rung.mark_s;
    }
    rung.mark_s = observed_s_;
    rung.flow.finish([&](const RainflowCycle& c) { rung.cycles.push_back(c); });
    rung.last_turn = kNone;
  }
  for (std::size_t i = 0; i < fine_.size(); ++i) {
    fine_path_[i] += fine_[i].finish([](double, Micros) {});
  }
}

PerRung SocPath::so_far() const {
  PerRung out{};
  for (std::size_t i = 0; i < rungs_.size(); ++i) {
    out[i] = rungs_[i].path / 2;
  }
  return out;
}

/// Standard deviation from the median of |second differences|: a path that is straight over three polls has none.
double SocPath::noise() const {
  if (bend_count_ < 64) {
    return 0.0;
  }
  std::uint64_t below = 0;
  std::size_t middle = 0;
  while (2 * (below + bends_[middle]) < bend_count_) {
    below += bends_[middle++];
  }
  const double typical = middle == 0 ? 0.0 : 1e-6 * std::pow(10.0, (static_cast<double>(middle) - 0.5) / 10);
  return typical / (0.6745 * std::sqrt(6.0));
}

Cycles SocPath::finish() {
  restart();
  Cycles out;
  out.quantum = quantum_.value();
  out.noise = noise();
  out.sigma_soc = std::hypot(out.quantum / std::sqrt(12.0), kOwnNoise);
  // Rounding alone bends a straight path by one quantum: that is no noise.
  const double white = out.noise > out.quantum / 2 ? out.noise : 0.0;
  const double needed = std::max({config_.hysteresis, out.quantum, kNoiseSigmas * white});
  while (out.rung + 1 < rungs_.size() && hysteresis(out.rung) < needed - kSlack) {
    ++out.rung;
  }
  out.hysteresis = hysteresis(out.rung);
  Rung& rung = rungs_[out.rung];
  Sum rainflow, mean;
  for (const RainflowCycle& c : rung.cycles) {
    rainflow.add(c.range * c.count);
    mean.add(c.mean * c.range * c.count);
    out.largest = std::max(out.largest, c.range);
  }
  out.by_soc = rung.variation.value() / 2;
  out.by_rainflow = rainflow.value();
  out.mean_soc = out.by_rainflow > 0 ? mean.value() / out.by_rainflow : kNone;
  out.bridged = rung.bridged / 2;
  out.turns = rung.turns;
  out.observed_h = observed_s_ / 3600;
  out.left_out_h = left_out_s_ / 3600;
  out.charge_per_h = rung.rising_s > 0 ? rung.risen / rung.rising_s * 3600 : 0.0;
  out.discharge_per_h = rung.falling_s > 0 ? rung.fallen / rung.falling_s * 3600 : 0.0;
  double swallowed = 0.0;
  for (std::size_t i = fine_.size(); i-- > 0;) {
    if (kFine[i] >= std::max(2 * out.quantum, kNoiseSigmas * white)) {
      swallowed = std::max(0.0, (fine_path_[i] - rung.path) / 2);
    }
  }
  bound(out, swallowed);
  out.cycles = std::move(rung.cycles);
  out.gaps = std::move(gaps_);
  return out;
}

void SocPath::bound(Cycles& out, double swallowed) const {
  const auto limit = [&](double fastest, double mean) {
    const double seen = std::max(fastest, mean);
    return seen > 0.0 ? seen + out.quantum / (kWindowS / 3600) : kUnseenPerH;
  };
  const double up = limit(fastest_up_, out.charge_per_h);
  const double down = limit(fastest_down_, out.discharge_per_h);
  const double white = out.noise > out.quantum / 2 ? out.noise : 0.0;
  double most_hidden = 0.0;
  for (const SocGap& gap : gaps_) {
    out.gap_h += gap.hours();
    most_hidden += (variation_inside(gap, up, down) - std::abs(gap.change)) / 2;
    if (out.charge_per_h > 0 && out.discharge_per_h > 0) {
      const double more = variation_inside(gap, out.charge_per_h, out.discharge_per_h) - std::abs(gap.change);
      out.hidden += more > 2 * out.hysteresis ? more / 2 : 0.0;  // a smaller turn inside would not count either
    }
  }
  const double turns = static_cast<double>(out.turns);
  const double rounding = turns * (out.quantum / 2 + 3 * white);
  const double step_h = steps_ > 0 ? observed_s_ / static_cast<double>(steps_) / 3600 : 0.0;
  const double between_polls = turns * up * down / (up + down) * step_h;
  out.lo = std::max(0.0, out.by_soc - rounding);
  out.hi = out.by_soc + rounding + swallowed + between_polls + std::max(most_hidden, out.hidden);
}

}  // namespace tacho::battery
