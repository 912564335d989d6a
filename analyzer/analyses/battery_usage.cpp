#include "analyzer/analyses/battery_usage.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace tacho::battery {

void TimeHistogram::add(double value, double seconds) {
  const double bin = std::floor((value - from_) / width_);
  seconds_[static_cast<std::size_t>(std::clamp(bin, 0.0, static_cast<double>(seconds_.size() - 1)))] += seconds;
}

double TimeHistogram::total() const { return std::accumulate(seconds_.begin(), seconds_.end(), 0.0); }

double TimeHistogram::quantile(double share) const {
  const double all = total();
  if (all <= 0.0) {
    return kNone;
  }
  double below = 0.0;
  std::size_t bin = 0;
  for (; bin + 1 < seconds_.size(); ++bin) {
    below += seconds_[bin];
    if (below >= share * all) {
      break;
    }
  }
  return edge(bin + 1);
}

void SocCurve::step(const Row& row) {
  if (std::isnan(row.soc)) {
    return;
  }
  const Micros bucket = row.t_us / bucket_us_;
  const bool gap = open_ && !row.joins(last_us_);
  if (open_ && (gap || bucket != bucket_)) {
    flush();
    if (gap) {
      t_.push_back(last_us_ + (row.t_us - last_us_) / 2);
      value_.push_back(kNone);
    }
  }
  const Point point{row.t_us, row.soc};
  if (!open_) {
    low_ = high_ = point;
    bucket_ = bucket;
    open_ = true;
  }
  low_ = point.soc < low_.soc ? point : low_;
  high_ = point.soc > high_.soc ? point : high_;
  last_us_ = row.t_us;
}

void SocCurve::flush() {
  const bool low_first = low_.t_us <= high_.t_us;
  const Point& first = low_first ? low_ : high_;
  const Point& second = low_first ? high_ : low_;
  t_.push_back(first.t_us);
  value_.push_back(first.soc);
  if (second.t_us != first.t_us) {
    t_.push_back(second.t_us);
    value_.push_back(second.soc);
  }
  open_ = false;
}

void SocCurve::finish() {
  if (open_) {
    flush();
  }
}

void Lasting::step(const Row& row, bool holds) {
  if (open_ && (!holds || !row.joins(t_us_))) {
    finish();
  }
  t_us_ = row.t_us;
  if (!holds) {
    return;
  }
  if (!open_) {
    now_ = {row.t_us, row.t_us, false};
    open_ = true;
  }
  now_.to_us = row.t_us;
}

void Lasting::finish() {
  const double length = static_cast<double>(now_.to_us - now_.from_us) * 1e-6;
  if (open_ && length >= least_s_) {
    seconds_ += length;
    ++count_;
    if (examples_.size() < 20) {
      examples_.push_back(now_);
    }
  }
  open_ = false;
}

Usage::Usage(const Config& config, Micros curve_bucket_us)
    : curve(curve_bucket_us),
      deep(0.0),
      low(0.0),
      hot(60.0),
      warm(60.0),
      cold(60.0),
      missed_charge(config.missed_charge_min * 60),
      config_(config) {}

void Usage::step(const Row& row, const FlowStep& flow) {
  const double dt = any_ && row.joins(t_us_) ? row.since(t_us_) : 0.0;
  any_ = true;
  t_us_ = row.t_us;
  observed_s += dt;
  if (!std::isnan(row.soc)) {
    soc_s += dt;
    above_90_s += row.soc > 0.9 ? dt : 0.0;
    below_20_s += row.soc < 0.2 ? dt : 0.0;
    below_10_s += row.soc < 0.1 ? dt : 0.0;
    if (!(row.soc >= soc_min)) {
      soc_min = row.soc;
      soc_min_us = row.t_us;
    }
    soc_max = std::isnan(soc_max) ? row.soc : std::max(soc_max, row.soc);
    if (!full_known_ || row.soc >= config_.full_soc - 0.005) {
      full_known_ = true;
      full_us_ = row.t_us;
    }
    longest_not_full_s = std::max(longest_not_full_s, row.since(full_us_));
  }
  if (!std::isnan(row.temp_c)) {
    if (!(row.temp_c <= temp_max)) {
      temp_max = row.temp_c;
      temp_max_us = row.t_us;
    }
    temp_min = std::isnan(temp_min) ? row.temp_c : std::min(temp_min, row.temp_c);
    temperature.add(row.temp_c, dt);
  }
  if (flow.seconds > 0.0) {
    (flow.mean_a > 0 ? current.positive : current.negative).add(std::abs(flow.mean_a), flow.seconds);
  }
  curve.step(row);
  deep.step(row, row.soc < config_.deep_soc);
  low.step(row, row.soc < config_.low_soc);
  hot.step(row, row.temp_c > config_.temp_max_c);
  warm.step(row, row.temp_c > config_.temp_warn_c);
  cold.step(row, row.temp_c < config_.temp_min_c);
  constexpr std::int64_t kWaiting = 1, kRunning = 2, kSuspended = 3;
  const bool busy = row.task_status == kWaiting || row.task_status == kRunning || row.task_status == kSuspended;
  missed_charge.step(
      row, row.standing == Flag::on && !busy && row.charging == Flag::off && row.soc < config_.missed_charge_soc);
}

void Usage::finish() {
  curve.finish();
  for (Lasting* lasting : {&deep, &low, &hot, &warm, &cold, &missed_charge}) {
    lasting->finish();
  }
}

}  // namespace tacho::battery
