#include "analyzer/analyses/alarm_exposure.hpp"

#include <algorithm>

#include "schema/time.hpp"

namespace tacho {

std::int64_t LocalTime::local_s(Micros t_us) {
  const std::int64_t utc_s = floor_div(t_us, 1'000'000);
  const std::int64_t hour = floor_div(utc_s, 3'600);
  if (hour != cached_hour_) {
    cached_hour_ = hour;
    offset_s_ = zone_offset_s(zone_, t_us).value_or(0);
  }
  return utc_s + offset_s_;
}

Micros LocalTime::day_start_us(std::int64_t day) {
  const Micros as_utc = day * 86'400 * 1'000'000;
  return as_utc - static_cast<Micros>(zone_offset_s(zone_, as_utc).value_or(0)) * 1'000'000;
}

std::optional<bool> PollState::stopped() const {
  if (!task_running || !moving) {
    return std::nullopt;
  }
  return *task_running && !*moving;
}

std::optional<bool> PollState::down() const {
  const std::optional<bool> still = stopped();
  return still ? std::optional<bool>(*still && stopping.has_value()) : std::nullopt;
}

void AlarmExposure::step(const PollState& now, bool near) {
  const Micros t = now.t_mid_us();
  first_us = polls == 0 ? t : first_us;
  last_us = t;
  ++polls;
  const double dt_s = before_ && near ? static_cast<double>(t - before_->t_mid_us()) * 1e-6 : 0.0;
  if (before_ && near) {
    share(now, dt_s);
  }
  stops(now, near, dt_s);
  before_ = now;
}

void AlarmExposure::share(const PollState& now, double dt_s) {
  const PollState& then = *before_;
  ++near_steps;
  const Micros middle = then.t_mid_us() + (now.t_mid_us() - then.t_mid_us()) / 2;
  bool any = false;
  for (std::size_t l = 0; l < kAlarmLevels; ++l) {
    if (then.known[l] && now.known[l]) {
      level_s[l] += dt_s;
      any = true;
    }
  }
  if (!any) {
    return;
  }
  observed_s += dt_s;
  ten_minutes[LocalTime::floor_div(middle, 600'000'000)] += dt_s;
  days[local_.day(middle)] += dt_s;
  hours[local_.hour(middle)] += dt_s;
  if (then.odo_m && now.odo_m) {
    has_odo = true;
    const double driven = *now.odo_m - *then.odo_m;
    if (driven > 0.0 && driven <= v_max_mps_ * dt_s + 1.0) {  // a counter that fell or leapt was set, not driven
      km += driven * 1e-3;
    }
  }
  for (const PollState* end : {&then, &now}) {
    moving_s += end->moving.value_or(false) ? dt_s / 2.0 : 0.0;
    task_known = task_known || end->stopped().has_value();
    task_s += end->stopped() && *end->task_running ? dt_s / 2.0 : 0.0;
    down_s += end->down().value_or(false) ? dt_s / 2.0 : 0.0;
  }
}

void AlarmExposure::stops(const PollState& now, bool near, double dt_s) {
  const bool down = now.down().value_or(false);
  if (open_ && !near) {
    open_->cut = true;
    open_->end_hi_us = now.t_recv_us;
    downs.push_back(*open_);
    open_.reset();
  }
  if (open_) {
    open_->observed_s += down ? dt_s : dt_s / 2.0;
    if (down) {
      open_->end_lo_us = now.t_send_us;
    } else {
      open_->end_hi_us = now.t_recv_us;
      downs.push_back(*open_);
      open_.reset();
    }
  } else if (down) {
    Down fresh;
    fresh.cut = !near;
    fresh.onset_lo_us = before_ ? before_->t_send_us : now.t_send_us;
    fresh.onset_hi_us = now.t_recv_us;
    fresh.end_lo_us = now.t_send_us;
    fresh.interval = *now.stopping;
    fresh.observed_s = near ? dt_s / 2.0 : 0.0;
    open_ = fresh;
  }
}

void AlarmExposure::finish() {
  if (open_) {
    open_->cut = true;
    open_->end_hi_us = before_->t_recv_us;
    downs.push_back(*open_);
    open_.reset();
  }
}

}  // namespace tacho
