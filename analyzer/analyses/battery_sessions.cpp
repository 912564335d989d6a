#include "analyzer/analyses/battery_sessions.hpp"

#include <algorithm>
#include <cmath>

namespace tacho::battery {
namespace {

constexpr Micros kAfterUs = 60'000'000;  // what happens within this of the end may be its reason
constexpr std::int64_t kRunning = 2;     // task_status
constexpr double kMovingMps = 0.05;

double usual(double value, double otherwise) { return std::isnan(value) ? otherwise : value; }

}  // namespace

bool ChargeSession::failed(double least_s, double full_soc) const {
  return current_known && current_s <= 0.0 && seconds() > least_s && !(soc_start >= full_soc);
}

std::string ChargeSession::end_reason(double full_soc) const {
  if (soc_end >= full_soc - 0.005 || tapered) {
    return "full";
  }
  if (cut_by_gap) {
    return "gap";
  }
  if (!end_seen) {
    return "end of record";
  }
  if (emergency) {
    return "emergency";
  }
  if (alarm) {
    return "alarm";
  }
  if (task) {
    return "task";
  }
  return unplugged ? "unplugged" : "not known";
}

void ChargeCurve::clear() {
  bins_.clear();
  width_s_ = 5.0;
}

void ChargeCurve::add(double seconds, double charge_a, double voltage_v) {
  auto index = static_cast<std::size_t>(seconds / width_s_);
  while (index >= kMost) {
    for (std::size_t i = 0; 2 * i < bins_.size(); ++i) {
      const Bin second = 2 * i + 1 < bins_.size() ? bins_[2 * i + 1] : Bin{};
      const Bin& first = bins_[2 * i];
      bins_[i] = {first.a + second.a, first.v + second.v, first.n + second.n, first.n_v + second.n_v};
    }
    bins_.resize((bins_.size() + 1) / 2);
    width_s_ *= 2;
    index = static_cast<std::size_t>(seconds / width_s_);
  }
  if (bins_.size() <= index) {
    bins_.resize(index + 1);
  }
  Bin& bin = bins_[index];
  bin.a += charge_a;
  bin.n += 1;
  if (!std::isnan(voltage_v)) {
    bin.v += voltage_v;
    bin.n_v += 1;
  }
}

void ChargeCurve::split(ChargeSession& session) const {
  std::vector<double> currents;
  double highest_v = 0.0;
  for (const Bin& bin : bins_) {
    if (bin.n > 0 && bin.a > 0) {
      currents.push_back(bin.a / bin.n);
    }
    highest_v = bin.n_v > 0 ? std::max(highest_v, bin.v / bin.n_v) : highest_v;
  }
  if (currents.size() < 3) {
    return;
  }
  const auto nth = currents.begin() + static_cast<std::ptrdiff_t>(currents.size() * 9 / 10);
  std::nth_element(currents.begin(), nth, currents.end());
  const double plateau = *nth;
  std::size_t end = 0;
  for (std::size_t i = 0; i < bins_.size(); ++i) {
    end = bins_[i].n > 0 && bins_[i].a / bins_[i].n >= 0.95 * plateau ? i + 1 : end;
  }
  session.cc_s = std::min(static_cast<double>(end) * width_s_, session.seconds());
  if (highest_v <= 0.0) {
    return;
  }
  session.cv_s = 0.0;
  for (std::size_t i = end; i < bins_.size(); ++i) {
    if (bins_[i].n_v > 0 && bins_[i].v / bins_[i].n_v >= 0.995 * highest_v) {
      session.cv_s += std::clamp(session.seconds() - static_cast<double>(i) * width_s_, 0.0, width_s_);
      session.tapered = session.tapered || bins_[i].a / bins_[i].n < 0.1 * plateau;
    }
  }
}

void ChargeSessions::step(const Row& row, const FlowStep& flow, double threshold_a) {
  const double charge_a = sign_ * row.current_a;
  const bool flagged = row.charging == Flag::on;
  const bool current = charge_a > threshold_a;  // false without a current
  const bool active = flagged || current;
  if (any_ && !row.joins(t_us_)) {
    gap(row, active);
  }
  watch_end(row, active);
  watch_contact(row, threshold_a);
  if (open_ || run_) {
    if (active) {
      extend(row, flow, threshold_a);
      if (run_ && (flagged || now_.seconds() >= config_.dwell_s)) {
        open_ = true;
        run_ = false;
      }
    } else if (run_) {
      run_ = false;
    } else if (row.since(now_.to_us) >= config_.dwell_s) {
      close(true, false);
      watch_end(row, active);
    } else {
      since_active_.positive.ah += flow.moved.positive.ah;
      since_active_.negative.ah += flow.moved.negative.ah;
      since_active_.positive.wh += flow.moved.positive.wh;
      since_active_.negative.wh += flow.moved.negative.wh;
    }
  } else if (active) {
    begin(row, flow, any_ && row.joins(t_us_));
    (flagged ? open_ : run_) = true;
  }
  any_ = true;
  t_us_ = row.t_us;
}

void ChargeSessions::begin(const Row& row, const FlowStep& flow, bool seen) {
  settle();
  now_ = ChargeSession{};
  now_.from_us = now_.to_us = row.t_us;
  now_.soc_start = now_.soc_end = row.soc;
  now_.start_seen = seen;
  now_.station = row.station;
  curve_.clear();
  pause_s_ = 0.0;
  since_active_ = {};
  FlowStep first = flow;
  first.seconds = 0.0;  // current began somewhere in this step
  extend(row, first, 0.0);
}

void ChargeSessions::extend(const Row& row, const FlowStep& flow, double threshold_a) {
  const double dt = std::max(0.0, flow.seconds);
  const Moved& moved = flow.moved.at(sign_);
  const Moved& held = since_active_.at(sign_);
  now_.ah += moved.ah + held.ah;
  now_.wh += moved.wh + held.wh;
  since_active_ = {};
  now_.to_us = row.t_us;
  now_.soc_end = usual(row.soc, now_.soc_end);
  now_.soc_start = usual(now_.soc_start, row.soc);
  now_.flagged = now_.flagged || row.charging == Flag::on;
  now_.contact = now_.contact || row.docked == Flag::on || row.plugged == Flag::on;
  now_.energy_known = now_.energy_known || moved.wh > 0;
  now_.station = now_.station.empty() ? std::string(row.station) : now_.station;
  if (std::isnan(now_.minutes_to_80) && row.soc >= 0.8 && now_.soc_start < 0.8) {
    now_.minutes_to_80 = now_.seconds() / 60;
  }
  if (std::isnan(row.current_a)) {
    return;
  }
  const double charge_a = sign_ * row.current_a;
  now_.current_known = true;
  now_.peak_a = std::max(usual(now_.peak_a, charge_a), charge_a);
  now_.end_a = charge_a;
  curve_.add(now_.seconds(), charge_a, row.voltage_v);
  pause(row, charge_a, threshold_a, dt);
}

/// Time with and without current; a pause counts only while the battery could still take charge.
void ChargeSessions::pause(const Row& row, double charge_a, double threshold_a, double dt) {
  if (threshold_a > 0 && charge_a > threshold_a) {
    now_.current_s += dt;
    pause_s_ = 0.0;
    return;
  }
  pause_s_ += dt;
  if (!(row.soc >= config_.full_soc - 0.005)) {
    now_.no_current_s = std::max(now_.no_current_s, pause_s_);
  }
}

void ChargeSessions::close(bool end_seen, bool by_gap) {
  settle();
  now_.end_seen = end_seen;
  now_.cut_by_gap = by_gap;
  now_.ah += since_active_.at(sign_).ah;
  now_.wh += since_active_.at(sign_).wh;
  since_active_ = {};
  curve_.split(now_);
  after_ = std::move(now_);
  now_ = ChargeSession{};
  open_ = run_ = false;
  ending_ = true;
}

/// The ended session is complete.
void ChargeSessions::settle() {
  if (ending_) {
    sessions_.push_back(std::move(after_));
    after_ = ChargeSession{};
    ending_ = false;
  }
}

void ChargeSessions::gap(const Row& row, bool active) {
  run_ = false;
  if (!open_) {
    return;
  }
  const double pause_s = row.since(t_us_);
  const bool goes_on =
      active && pause_s > 0 && pause_s <= config_.session_gap_min * 60 && !(row.soc < now_.soc_end - 0.01);
  if (goes_on) {
    now_.gap_s += pause_s;
  } else {
    close(false, true);
  }
}

/// Looks for the reason of the end, from the last row of the session to a minute after it.
void ChargeSessions::watch_end(const Row& row, bool active) {
  if (ending_ && row.t_us - after_.to_us > kAfterUs) {
    settle();
  }
  if (!ending_ && !open_) {
    return;
  }
  ChargeSession& session = ending_ ? after_ : now_;
  const bool ended = ending_ || !active;
  session.alarm = row.alarm == Flag::on || (ended && session.alarm);
  session.emergency = row.emergency == Flag::on || (ended && session.emergency);
  session.task =
      ended && (session.task || row.task_status == kRunning || row.standing == Flag::off || row.speed_mps > kMovingMps);
  session.unplugged =
      ended && (session.unplugged || (session.contact && row.docked != Flag::on && row.plugged != Flag::on));
}

void ChargeSessions::watch_contact(const Row& row, double threshold_a) {
  const bool contact = row.docked == Flag::on || row.plugged == Flag::on;
  if (in_contact_ && (!contact || !row.joins(t_us_))) {
    close_contact();
  }
  const bool arrived = !contact_before_ && any_ && row.joins(t_us_);
  contact_before_ = contact;
  if (!contact) {
    return;
  }
  if (!in_contact_) {
    contact_ = ChargeSession{};
    contact_.from_us = row.t_us;
    contact_.soc_start = row.soc;
    contact_.station = row.station;
    contact_.contact = true;
    in_contact_ = true;
    contact_charged_ = !arrived;
  }
  contact_.to_us = row.t_us;
  contact_.soc_end = usual(row.soc, contact_.soc_end);
  contact_.current_known = contact_.current_known || !std::isnan(row.current_a);
  contact_charged_ = contact_charged_ || row.charging == Flag::on || sign_ * row.current_a > threshold_a;
}

void ChargeSessions::close_contact() {
  if (!contact_charged_ && contact_.failed(config_.failed_s, config_.full_soc)) {
    idle_contacts_.push_back(contact_);
  }
  in_contact_ = false;
}

void ChargeSessions::finish() {
  if (open_) {
    close(false, false);
  }
  run_ = false;
  settle();
  if (in_contact_) {
    close_contact();
  }
}

}  // namespace tacho::battery
