#include "samples/simulator/work.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "samples/simulator/robot_clock.hpp"

namespace tacho::sim {
namespace {

constexpr std::uint64_t kChoices = 1;
constexpr Micros kSecond = 1'000'000;
constexpr Micros kDay = 86'400 * kSecond;
constexpr Micros kLongestStand = 600 * kSecond;  // temperature and cut-off are looked at anew
constexpr double kTurnAccel = 1.0;               // rad/s^2
constexpr double kBrake = 1.5;                   // m/s^2, when an alarm stops the robot
constexpr double kTurnBrake = 3.0;               // rad/s^2
constexpr int kFirstStation = 0;

Micros micros(double seconds) { return std::llround(seconds * 1e6); }

}  // namespace

Work::Work(const Scenario& scenario, Micros t0_us)
    : scenario_(scenario),
      battery_(scenario),
      alarms_(scenario, t0_us),
      floor_(scenario),
      choices_(scenario.seed, kChoices),
      t_us_(t0_us),
      station_(scenario.always_idle ? kDock : kFirstStation),
      next_midnight_us_(next_robot_midnight(t0_us, scenario.clock_offset_s)),
      next_day_us_(t0_us) {
  pose_ = station_pose(station_);
  charge_ = battery_.initial();
  tip_.still_since_us = t0_us;
  stand(micros(scenario.wait_s) + kSecond);
}

void Work::plan() {
  if (charge_.soc < scenario_.charge_below) {
    if (station_ != kDock) {
      drive_to(kDock);
    }
    charge();
  } else if (scenario_.always_idle) {
    stand(kLongestStand);
    return;
  } else {
    const auto other = static_cast<int>(choices_.uniform(0, kDock - 1));
    drive_to(other >= station_ ? other + 1 : other);
  }
  stand(micros(scenario_.wait_s * choices_.uniform(0.5, 1.5)) + 1);
}

void Work::drive_to(int station) {
  const double cruise = scenario_.cruise_mps;
  const SpeedLimits limits{cruise, std::min(cruise, 0.6), std::min(cruise, 0.4)};
  tip_.task_running = true;
  tip_.target = station;
  for (const Step& step : route(station_, station, choices_.chance(0.5), limits)) {
    if (const auto* turn = std::get_if<Turn>(&step)) {
      turn_to(turn->to_heading_rad);
    } else {
      drive(std::get<Drive>(step));
    }
  }
  tip_.task_running = false;
  tip_.last = station;
  station_ = station;
}

void Work::drive(const Drive& drive) {
  if (drive.direction < 0) {
    drive_unblocked(drive.run, drive.direction);
    return;
  }
  double driven = 0;
  const Run run = floor_.roughen(drive.run);
  for (const Block& block : floor_.blocks(run, pose_)) {
    drive_unblocked(take(drop(run, driven), block.at_m - driven), 1);
    driven = block.at_m;
    stand_blocked(block);
  }
  drive_unblocked(drop(run, driven), 1);
}

// Drives `run`; when an alarm stops the robot on the way, brakes, waits for its end and drives the rest.
void Work::drive_unblocked(Run run, int direction) {
  while (!run.empty()) {
    wait_for_clearance();
    const std::vector<Piece> plan = plan_run(run, pose_, t_us_, scenario_.accel_mps2, direction);
    const std::vector<Piece> rest = follow(plan);
    if (rest.empty()) {
      return;
    }
    const double speed = std::abs(rest.front().v0_mps);
    run = drop(run, path(plan) - path(rest));
    if (speed * speed / (2 * kBrake) >= length(run)) {
      push_all(rest);
      return;
    }
    const std::vector<Piece> brake = plan_brake(run, pose_, t_us_, speed, kBrake, direction);
    push_all(brake);
    run = drop(run, path(brake));
  }
}

void Work::turn_to(double heading_rad) {
  double angle = std::remainder(heading_rad - pose_.angle_rad, 2 * std::numbers::pi);
  if (std::abs(angle) > std::numbers::pi - 1e-6) {
    angle = choices_.chance(0.5) ? std::numbers::pi : -std::numbers::pi;
  }
  const double goal = pose_.angle_rad + angle;
  while (true) {
    wait_for_clearance();
    const std::vector<Piece> rest =
        follow(plan_turn(goal - pose_.angle_rad, pose_, t_us_, scenario_.turn_radps, kTurnAccel));
    if (rest.empty()) {
      return;
    }
    const double speed = rest.front().w0_radps;
    if (speed * speed / (2 * kTurnBrake) >= std::abs(goal - pose_.angle_rad)) {
      push_all(rest);
      return;
    }
    Piece brake = rest.front();
    brake.duration_us = micros(std::abs(speed) / kTurnBrake);
    if (brake.duration_us > 0) {
      brake.w_accel = -speed / (static_cast<double>(brake.duration_us) * 1e-6);
      push(brake);
    }
  }
}

void Work::wait_for_clearance() {
  for (auto stop = alarms_.next_stop(t_us_); stop && stop->from_us <= t_us_; stop = alarms_.next_stop(t_us_)) {
    stand(stop->to_us - t_us_);
  }
}

// Follows a plan until an alarm stops the robot; returns what is left of it.
std::vector<Piece> Work::follow(const std::vector<Piece>& pieces) {
  const auto stop = alarms_.next_stop(t_us_);
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    if (!stop || pieces[i].end_us() <= stop->from_us) {
      push(pieces[i]);
      continue;
    }
    std::vector<Piece> rest(pieces.begin() + static_cast<std::ptrdiff_t>(i), pieces.end());
    if (stop->from_us > pieces[i].t0_us) {
      push(head(pieces[i], stop->from_us));
      rest.front() = tail(pieces[i], stop->from_us);
    }
    return rest;
  }
  return {};
}

void Work::stand_blocked(const Block& block) {
  const Micros duration = micros(block.duration_s);
  TrueEpisode episode;
  episode.from_us = t_us_;
  episode.to_us = t_us_ + duration;
  episode.x_m = pose_.x_m;
  episode.y_m = pose_.y_m;
  episode.obstacle_x_m = pose_.x_m + block.obstacle_m * std::cos(pose_.angle_rad);
  episode.obstacle_y_m = pose_.y_m + block.obstacle_m * std::sin(pose_.angle_rad);
  episode.reason = block.reason;
  episodes_.push_back(episode);
  tip_.blocked = true;
  ++tip_.episodes;
  stand(duration);
  tip_.blocked = false;
}

void Work::charge() {
  stand(5 * kSecond);
  charges_.push_back(t_us_);
  tip_.charging = true;
  for (const ChargeStage& stage : battery_.stages(charge_)) {
    Piece still;
    still.t0_us = t_us_;
    still.duration_us = stage.duration_us;
    still.start = pose_;
    push(still, Battery::charge(charge_, stage));
  }
  tip_.charging = false;
  battery_.learn_capacity(charge_);
}

void Work::stand(Micros duration_us) {
  while (duration_us > 0) {
    Piece still;
    still.t0_us = t_us_;
    still.duration_us = std::min(duration_us, kLongestStand);
    still.start = pose_;
    push(still);
    duration_us -= still.duration_us;
  }
}

void Work::push_all(const std::vector<Piece>& pieces) {
  for (const Piece& piece : pieces) {
    push(piece);
  }
}

void Work::push(const Piece& motion) { push(motion, battery_.load(charge_, motion)); }

void Work::push(const Piece& motion, const BatteryPiece& battery) {
  if (motion.duration_us <= 0) {
    return;
  }
  Segment segment = tip_;
  segment.motion = motion;
  segment.battery = battery;
  const Kinematics end = kinematics_at(motion, motion.end_us());
  const bool moves = end.path_m > 0 || end.pivot_rad > 0;
  mark_days(segment);
  segments_.push_back(segment);
  if (motion.wheel_gain != 1 && moves) {
    if (slips_.empty() || slips_.back().to_us != motion.t0_us) {
      slips_.push_back({motion.t0_us, motion.t0_us, 0});
    }
    slips_.back().to_us = motion.end_us();
    slips_.back().metres += (motion.wheel_gain - 1) * end.path_m;
  }
  charge_ = Battery::after(battery, end, static_cast<double>(motion.duration_us) * 1e-6);
  pose_ = end.pose;
  t_us_ = motion.end_us();
  tip_.path_m += end.path_m;
  tip_.wheel_path_m += end.path_m * motion.wheel_gain;
  tip_.heading_sum_rad += end.heading_rad;
  tip_.still_since_us = moves ? t_us_ : tip_.still_since_us;
}

void Work::mark_days(const Segment& segment) {
  const Piece& motion = segment.motion;
  for (; next_midnight_us_ < motion.end_us(); next_midnight_us_ += kDay) {
    days_.midnight_us.push_back(next_midnight_us_);
    days_.wheel_path_m.push_back(segment.wheel_path_m +
                                 kinematics_at(motion, next_midnight_us_).path_m * motion.wheel_gain);
  }
  for (; next_day_us_ < motion.end_us(); next_day_us_ += kDay) {
    days_.capacity_ah.push_back(segment.battery.start.capacity_ah);
  }
}

}  // namespace tacho::sim
