#include "analyzer/analyses/battery_states.hpp"

#include <algorithm>
#include <cmath>

namespace tacho::battery {

BySign<double> signed_area(double a, double b, double seconds) {
  if (a >= 0 && b >= 0) {
    return {(a + b) / 2 * seconds, 0.0};
  }
  if (a <= 0 && b <= 0) {
    return {0.0, -(a + b) / 2 * seconds};
  }
  const double crossing = a / (a - b);  // share of the step before zero
  const double first = std::abs(a) / 2 * crossing * seconds;
  const double second = std::abs(b) / 2 * (1 - crossing) * seconds;
  return a > 0 ? BySign<double>{first, second} : BySign<double>{second, first};
}

FlowStep Throughput::step(const Row& row, std::int32_t day) {
  FlowStep out;
  if (std::isnan(row.current_a)) {
    return out;  // the run goes on when the next value comes in time
  }
  if (!has_last_ || !row.joins(last_.t_us)) {
    end_run();
    has_last_ = has_anchor_ = true;
    last_ = anchor_ = {row.t_us, row.current_a};
    last_v_ = row.voltage_v;
    return out;
  }
  if (day != day_) {
    close_day();
    day_ = day;
  }
  out.seconds = row.since(last_.t_us);
  out.mean_a = (row.current_a + last_.a) / 2;
  const BySign<double> area = signed_area(last_.a, row.current_a, out.seconds);
  out.moved.positive.ah = area.positive / 3600;
  out.moved.negative.ah = area.negative / 3600;
  (out.mean_a > 0 ? out.moved.positive : out.moved.negative).seconds = out.seconds;
  if (!std::isnan(row.voltage_v) && !std::isnan(last_v_)) {
    const BySign<double> energy = signed_area(last_.a * last_v_, row.current_a * row.voltage_v, out.seconds);
    out.moved.positive.wh = energy.positive / 3600;
    out.moved.negative.wh = energy.negative / 3600;
    energy_known_ = true;
  }
  const auto add = [](Total& total, const Moved& moved) {
    total.ah.add(moved.ah);
    total.wh.add(moved.wh);
    total.seconds.add(moved.seconds);
  };
  add(totals_.positive, out.moved.positive);
  add(totals_.negative, out.moved.negative);
  seconds_.add(out.seconds);

  single_.positive += out.moved.positive.ah;
  single_.negative += out.moved.negative.ah;
  if (odd_) {
    const BySign<double> wide = signed_area(anchor_.a, row.current_a, row.since(anchor_.t_us));
    close_thinned(wide.positive / 3600, wide.negative / 3600);
    anchor_ = {row.t_us, row.current_a};
  }
  odd_ = !odd_;
  last_ = {row.t_us, row.current_a};
  last_v_ = row.voltage_v;
  return out;
}

void Throughput::close_thinned(double positive_ah, double negative_ah) {
  totals_.positive.thinned_ah.add(positive_ah);
  totals_.negative.thinned_ah.add(negative_ah);
  day_diff_.positive += single_.positive - positive_ah;
  day_diff_.negative += single_.negative - negative_ah;
  single_ = {};
}

void Throughput::end_run() {
  if (odd_) {
    close_thinned(single_.positive, single_.negative);  // a last step without partner is the same in both sums
  }
  odd_ = false;
}

void Throughput::close_day() {
  totals_.positive.thinned_diff2.add(day_diff_.positive * day_diff_.positive);
  totals_.negative.thinned_diff2.add(day_diff_.negative * day_diff_.negative);
  day_diff_ = {};
}

void Throughput::finish() {
  end_run();
  close_day();
  has_last_ = false;
}

double Throughput::sigma_ah(int sign, double offset_a) const {
  const Total& t = total(sign);
  const double offset = offset_a * t.seconds.value() / 3600;
  const double difference = t.ah.value() - t.thinned_ah.value();
  return std::sqrt(offset * offset + std::max(difference * difference / 3, t.thinned_diff2.value()));
}

void CurrentSign::step(const Row& row) {
  if (std::isnan(row.current_a) || std::isnan(row.soc)) {
    return;
  }
  if (!std::isnan(soc_) && row.joins(t_us_)) {
    const double mean = (row.current_a + current_a_) / 2;
    if (std::abs(mean) > 1.0) {
      sum_.add(mean * (row.soc - soc_));
      absolute_.add(std::abs(mean * (row.soc - soc_)));
    }
  }
  t_us_ = row.t_us;
  soc_ = row.soc;
  current_a_ = row.current_a;
}

double CurrentSign::agreement() const {
  const double all = absolute_.value();
  return all > 0 ? (1 + std::abs(sum_.value()) / all) / 2 : 0.0;
}

void CurrentNoise::step(const Row& row) {
  if (std::isnan(row.current_a)) {
    return;
  }
  const bool standing = row.standing == Flag::on;
  if (standing && standing_ && row.charging == charging_ && !std::isnan(current_a_) && row.joins(t_us_)) {
    const double size = std::abs(row.current_a - current_a_);
    const double bin = size > 1e-6 ? 1 + std::floor(10 * std::log10(size / 1e-6)) : 0.0;
    ++bins_[static_cast<std::size_t>(std::min(bin, static_cast<double>(kBins - 1)))];
    if (++count_ >= 64 && count_ % 64 == 0) {
      std::uint64_t below = 0;
      std::size_t middle = 0;
      while (2 * (below + bins_[middle]) < count_) {
        below += bins_[middle++];
      }
      const double typical = middle == 0 ? 0.0 : 1e-6 * std::pow(10.0, (static_cast<double>(middle) - 0.5) / 10);
      sigma_a_ = typical / (0.6745 * std::sqrt(2.0));
    }
  }
  t_us_ = row.t_us;
  current_a_ = row.current_a;
  charging_ = row.charging;
  standing_ = standing;
}

void UseClock::step(const Row& row, double threshold_a) {
  if (std::isnan(row.current_a)) {
    return;
  }
  const Use use = row.current_a > threshold_a    ? Use::positive
                  : row.current_a < -threshold_a ? Use::negative
                                                 : Use::rest;
  if (!running_ || !row.joins(t_us_)) {
    finish();
    state_ = candidate_ = use;
    running_ = true;
    t_us_ = row.t_us;
    return;
  }
  const double dt = row.since(t_us_);
  t_us_ = row.t_us;
  double& now = seconds_[static_cast<std::size_t>(state_)];
  if (use == state_) {
    now += candidate_s_ + dt;
    candidate_s_ = 0.0;
    return;
  }
  if (use != candidate_) {
    now += candidate_s_;
    candidate_s_ = 0.0;
    candidate_ = use;
  }
  candidate_s_ += dt;
  if (candidate_s_ >= dwell_s_) {
    seconds_[static_cast<std::size_t>(use)] += candidate_s_;
    candidate_s_ = 0.0;
    state_ = use;
  }
}

void UseClock::finish() {
  seconds_[static_cast<std::size_t>(state_)] += candidate_s_;
  candidate_s_ = 0.0;
  running_ = false;
}

void Contradictions::step(const Row& row, double threshold_a) {
  if (std::isnan(row.current_a) || row.charging == Flag::unknown) {
    return;
  }
  const bool joined = row.joins(t_us_);
  compared_s_ += joined ? row.since(t_us_) : 0.0;
  t_us_ = row.t_us;
  const bool flag_on = row.charging == Flag::on;
  const double charge_a = sign_ * row.current_a;
  const bool contradicts = flag_on ? charge_a < -threshold_a : charge_a > threshold_a;
  if (is_open_ && (!joined || !contradicts || flag_on != open_.flag_on)) {
    close();
  }
  if (contradicts) {
    if (!is_open_) {
      open_ = {row.t_us, row.t_us, flag_on};
      is_open_ = true;
    }
    open_.to_us = row.t_us;
  }
}

void Contradictions::close() {
  const double length = static_cast<double>(open_.to_us - open_.from_us) * 1e-6;
  if (is_open_ && length > least_s_) {
    ++count_;
    seconds_ += length;
    if (examples_.size() < 100) {
      examples_.push_back(open_);
    }
  }
  is_open_ = false;
}

}  // namespace tacho::battery
