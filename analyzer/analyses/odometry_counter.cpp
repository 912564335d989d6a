#include "analyzer/analyses/odometry_counter.hpp"

#include <algorithm>
#include <cmath>

namespace tacho::odometry {

double float32_step(double value) {
  const float f = static_cast<float>(std::abs(value));
  return static_cast<double>(std::nextafter(f, std::numeric_limits<float>::infinity())) - static_cast<double>(f);
}

const std::array<double, QuantumFinder::kCandidates>& QuantumFinder::candidates() {
  static const auto sorted = [] {
    std::array<double, kCandidates> all{};
    std::size_t n = 0;
    for (const double decimal : {1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6}) {
      all[n++] = decimal;
    }
    for (int k = 1; n < kCandidates; ++k) {
      all[n++] = std::ldexp(1.0, -k);
    }
    std::sort(all.begin(), all.end(), std::greater<>());
    return all;
  }();
  return sorted;
}

void QuantumFinder::add(double value) {
  if (!std::isfinite(value) || value == last_) {
    return;
  }
  last_ = value;
  largest_ = std::max(largest_, std::abs(value));
  smallest_ = std::min(smallest_, std::abs(value));
  ++changes_;
  for (std::size_t i = 0; i < kCandidates; ++i) {
    const double units = value / candidates()[i];
    const double slack = std::max(1e-6, 4.0 * std::numeric_limits<double>::epsilon() * std::abs(units));
    fits_[i] += std::abs(units - std::round(units)) <= slack ? 1U : 0U;
  }
}

std::optional<double> QuantumFinder::quantum() const {
  if (changes_ < 20) {
    return std::nullopt;
  }
  for (std::size_t i = 0; i < kCandidates; ++i) {
    if (static_cast<double>(fits_[i]) >= 0.999 * static_cast<double>(changes_)) {
      return candidates()[i];
    }
  }
  return 0.0;
}

std::string QuantumFinder::kind() const {
  const std::optional<double> q = quantum();
  if (!q) {
    return "";
  }
  if (*q == 0.0) {
    return "continuous";
  }
  int exponent = 0;
  if (std::frexp(*q, &exponent) != 0.5 || *q == 1.0) {
    return "decimal number";
  }
  // The step of float32 grows with the value: the quantum is that of the smallest values, or of 99.9 % of them.
  return *q >= float32_step(smallest_) && *q <= float32_step(largest_) ? "float32" : "binary fraction";
}

std::string_view counter_event_name(CounterEvent::What what) {
  switch (what) {
    case CounterEvent::What::fall:
      return "fall";
    case CounterEvent::What::jump:
      return "jump";
    case CounterEvent::What::stuck:
      return "stuck";
  }
  return "";
}

std::uint64_t CounterResult::count(CounterEvent::What what) const {
  return static_cast<std::uint64_t>(
      std::count_if(events.begin(), events.end(), [what](const CounterEvent& e) { return e.what == what; }));
}

std::optional<double> CounterResult::zone_h() const {
  constexpr Micros kDay = 86'400'000'000;
  constexpr Micros kQuarter = 900'000'000;
  std::optional<double> zone;
  for (const RobotDay& day : days) {
    if (day.started_by_fall && day.from_us - day.fell_after_us <= kQuarter) {
      const Micros middle = day.fell_after_us + (day.from_us - day.fell_after_us) / 2;
      const Micros of_day = ((middle % kDay) + kDay) % kDay;
      const Micros quarters = (of_day + kQuarter / 2) / kQuarter;
      const double hours = -static_cast<double>(quarters) / 4.0;
      zone = hours < -12.0 ? hours + 24.0 : hours;
    }
  }
  return zone;
}

void CounterFold::end_idle() {
  if (idle_metres_ > config_.stuck_m) {
    idle_.allowed_m = idle_metres_;
    result_.events.push_back(idle_);
  }
  idle_metres_ = 0.0;
}

void CounterFold::step(const RawRow& raw, const Prepared& prepared) {
  const double grown = raw.odo - last_.odo;
  CounterEvent event{CounterEvent::What::fall, last_.t_us, raw.t_us, last_.odo, raw.odo, raw.uptime_s, 0.0};
  if (grown < -kTremble_m) {
    result_.events.push_back(event);
  } else if (grown > config_.v_max_mps * std::max(prepared.dt_s, 0.0)) {
    event.what = CounterEvent::What::jump;
    event.allowed_m = config_.v_max_mps * std::max(prepared.dt_s, 0.0);
    result_.events.push_back(event);  // finish() adds q to what is allowed
  } else {
    result_.counted_m += grown;
  }
  if (grown != 0.0 || !prepared.joined) {
    end_idle();
  } else if (prepared.row.all(kSpeed) && last_row_.all(kSpeed)) {
    if (idle_metres_ == 0.0) {
      idle_ = event;
      idle_.what = CounterEvent::What::stuck;
    }
    idle_metres_ += interval_of(last_row_, prepared.row, config_).metres;
    idle_.to_us = raw.t_us;
  }
}

void CounterFold::add_today(const RawRow& raw) {
  if (!std::isfinite(raw.today_odo)) {
    return;
  }
  const double today = raw.today_odo + 0.0;
  today_quantum_.add(today);
  const double difference = raw.odo - today;
  const bool fell = today < last_today_ - kTremble_m;
  if (result_.days.empty() || fell || raw.odo < last_.odo - kTremble_m) {
    result_.days.push_back({raw.t_us, raw.t_us, difference, difference, fell, last_today_us_});
  }
  RobotDay& day = result_.days.back();
  day.to_us = raw.t_us;
  day.lowest = std::min(day.lowest, difference);
  day.highest = std::max(day.highest, difference);
  last_today_ = today;
  last_today_us_ = raw.t_us;
}

void CounterFold::add(const RawRow& raw, const Prepared& prepared) {
  if (!std::isfinite(raw.odo)) {
    return;
  }
  odo_quantum_.add(raw.odo);
  if (any_) {
    step(raw, prepared);
  }
  add_today(raw);
  last_ = raw;
  last_row_ = prepared.row;
  any_ = true;
}

CounterResult CounterFold::finish() {
  end_idle();
  CounterResult r = std::move(result_);
  r.seen = any_;
  r.changes = odo_quantum_.changes();
  r.quantum_m = odo_quantum_.quantum();
  r.kind = odo_quantum_.kind();
  const double step = float32_ ? float32_step(odo_quantum_.largest()) : 0.0;
  if (float32_ && any_ && r.q() < step) {
    r.quantum_m = step;
    r.kind = r.kind.empty() ? "float32" : r.kind;
  }
  const auto within = [&](CounterEvent& e) {
    if (e.what != CounterEvent::What::jump) {
      return false;
    }
    e.allowed_m += r.q();
    const bool ok = e.after_m - e.before_m <= e.allowed_m;
    r.counted_m += ok ? e.after_m - e.before_m : 0.0;
    return ok;
  };
  std::erase_if(r.events, within);
  std::stable_sort(r.events.begin(), r.events.end(),
                   [](const CounterEvent& a, const CounterEvent& b) { return a.from_us < b.from_us; });
  if (today_quantum_.largest() == 0.0) {
    r.days.clear();  // always 0: the robot does not supply it
  }
  const double q_today = today_quantum_.quantum().value_or(0.0);
  const double steps = float32_ ? step + float32_step(today_quantum_.largest()) : 0.0;
  r.today_allowed_m = r.q() + q_today + steps + 1e-9 * odo_quantum_.largest();
  for (const RobotDay& day : r.days) {
    r.today_range_m = std::max(r.today_range_m, day.highest - day.lowest);
  }
  return r;
}

}  // namespace tacho::odometry
