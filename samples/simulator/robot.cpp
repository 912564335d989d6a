#include "samples/simulator/robot.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numbers>

#include "samples/simulator/robot_clock.hpp"
#include "samples/simulator/work.hpp"
#include "schema/time.hpp"

namespace tacho::sim {
namespace {

constexpr double kUptimeAtStartS = 5 * 3600 + 407.5;
constexpr int kCycleAtStart = 57;
constexpr int kSlowReason = 1;  // laser
constexpr double kAtStation = 0.30;

std::string station_id(int station) {
  return station < 0 ? std::string() : std::string(kStations[static_cast<std::size_t>(station)].id);
}

}  // namespace

struct Robot::Impl {
  Impl(const Scenario& s, Micros t0)
      : scenario(s),
        t0_us(t0),
        battery(scenario),
        work(scenario, t0),
        alarms(scenario, t0),
        localisation(scenario, t0) {
    update(t0);
  }

  Scenario scenario;
  Micros t0_us;
  Battery battery;
  Work work;
  Alarms alarms;
  Localisation localisation;
  std::size_t midnights_passed = 0;
  RobotState state;

  void update(Micros t_us);
  void update_motion(const Segment& segment);
  void update_battery(const Segment& segment);
};

void Robot::Impl::update(Micros t_us) {
  assert(t_us >= state.t_us);
  auto& segments = work.segments();
  while (segments.front().motion.end_us() <= t_us) {
    segments.pop_front();
    if (segments.empty()) {
      work.plan();
    }
  }
  const Segment& segment = segments.front();
  state.t_us = t_us;
  update_motion(segment);
  update_battery(segment);
  alarms.active(t_us, scenario.clock_offset_s, state.alarms);
  state.emergency = std::any_of(state.alarms.begin(), state.alarms.end(),
                                [](const ActiveAlarm& alarm) { return alarm.code == kMotorEmergencyStop; });
  state.uptime_s = kUptimeAtStartS + to_seconds(t_us - t0_us);
  state.clock_fault_us = clock_fault_us(scenario, t_us - t0_us);
}

void Robot::Impl::update_motion(const Segment& segment) {
  const Piece& motion = segment.motion;
  const Kinematics k = kinematics_at(motion, state.t_us);
  state.x_m = k.pose.x_m;
  state.y_m = k.pose.y_m;
  state.angle_rad = std::remainder(k.pose.angle_rad, 2 * std::numbers::pi);
  state.v_mps = k.v_mps;
  state.w_radps = k.w_radps;
  state.wheel_mps = k.v_mps * motion.wheel_gain;
  state.path_m = segment.path_m + k.path_m;
  state.wheel_path_m = segment.wheel_path_m + k.path_m * motion.wheel_gain;
  state.heading_sum_rad = segment.heading_sum_rad + k.heading_rad;
  state.is_stop = k.v_mps == 0 && k.w_radps == 0;
  state.still_since_us = state.is_stop ? std::min(segment.still_since_us, state.t_us) : state.t_us;
  const Localisation::Offset error = localisation.offset(state.t_us);
  state.pose_error_x_m = error.x_m;
  state.pose_error_y_m = error.y_m;

  const DayMarks& days = work.days();
  while (midnights_passed < days.midnight_us.size() && days.midnight_us[midnights_passed] <= state.t_us) {
    ++midnights_passed;
  }
  const bool first_day = midnights_passed == 0;
  state.today_wheel_path_m = state.wheel_path_m - (first_day ? 0.0 : days.wheel_path_m[midnights_passed - 1]);
  state.today_s = to_seconds(state.t_us - (first_day ? t0_us : days.midnight_us[midnights_passed - 1]));

  state.blocked = segment.blocked;
  state.slowed = motion.slowed;
  state.slow_reason = kSlowReason;
  if (segment.episodes > 0) {
    const TrueEpisode& episode = work.episodes()[segment.episodes - 1];
    state.block_reason = episode.reason;
    state.block_x_m = episode.obstacle_x_m;
    state.block_y_m = episode.obstacle_y_m;
  }
  state.task_status = segment.target < 0 ? 0 : segment.task_running ? 2 : 4;  // none, running, completed
  state.task_type = segment.target < 0 ? 0 : 3;                               // path to a station
  state.current_station = station_id(station_near(state.x_m, state.y_m, kAtStation));
  state.last_station = station_id(segment.last);
  state.target_station = station_id(segment.target);
}

void Robot::Impl::update_battery(const Segment& segment) {
  const double tau_s = to_seconds(state.t_us - segment.motion.t0_us);
  const Kinematics k = kinematics(segment.motion, tau_s);
  const BatteryState now = Battery::after(segment.battery, k, tau_s);
  state.soc = now.soc;
  state.capacity_ah = now.capacity_ah;
  state.charged_ah = now.charged_ah;
  state.discharged_ah = now.discharged_ah;
  state.soc_variation = now.variation;
  state.charging = segment.charging;
  state.current_a = Battery::current_a(segment.battery, segment.motion, k, tau_s);
  state.voltage_v = battery.voltage_v(now.soc, state.current_a, to_seconds(state.t_us - t0_us));
  state.battery_temp_c = Battery::temperature_c(now.heat_k, state.t_us);
  if (scenario.cycle_share > 0) {
    const double discharged = (now.variation + scenario.soc_start - now.soc) / 2;
    state.battery_cycle = kCycleAtStart + static_cast<int>(discharged / scenario.cycle_share);
  }
}

Robot::Robot(const Scenario& scenario, Micros t0_us) : impl_(std::make_unique<Impl>(scenario, t0_us)) {}
Robot::~Robot() = default;
Robot::Robot(Robot&&) noexcept = default;

const RobotState& Robot::at(Micros t_us) {
  impl_->update(t_us);
  return impl_->state;
}

Truth Robot::truth() const {
  const RobotState& now = impl_->state;
  Truth truth;
  truth.t0_us = impl_->t0_us;
  truth.t1_us = now.t_us;
  truth.odo_scale = impl_->scenario.odo_scale;
  truth.twist_scale = impl_->scenario.twist_scale;
  truth.angular_scale = impl_->scenario.angular_scale;
  truth.path_m = now.path_m;
  truth.counter_m = impl_->scenario.odo_scale * now.wheel_path_m;
  truth.charged_ah = now.charged_ah;
  truth.discharged_ah = now.discharged_ah;
  truth.equivalent_full_cycles_soc = now.soc_variation / 2;
  constexpr Micros kDay = 86'400'000'000;
  const auto days = static_cast<std::size_t>((now.t_us - impl_->t0_us) / kDay) + 1;
  const std::vector<double>& capacity = impl_->work.days().capacity_ah;
  truth.capacity_ah_per_day.assign(capacity.begin(),
                                   capacity.begin() + static_cast<std::ptrdiff_t>(std::min(days, capacity.size())));
  truth.alarms = impl_->alarms.truth(now.t_us);
  for (TrueEpisode episode : impl_->work.episodes()) {
    if (episode.from_us < now.t_us) {
      episode.to_us = std::min(episode.to_us, now.t_us);
      truth.blocked.push_back(episode);
    }
  }
  truth.jumps = impl_->localisation.truth(now.t_us);
  for (const TrueSlip& slip : impl_->work.slips()) {
    if (slip.from_us < now.t_us) {
      truth.slips.push_back(slip);
    }
  }
  const std::vector<Micros>& charges = impl_->work.charges();
  truth.charge_sessions =
      static_cast<int>(std::count_if(charges.begin(), charges.end(), [&](Micros t) { return t <= now.t_us; }));
  return truth;
}

const Scenario& Robot::scenario() const { return impl_->scenario; }

}  // namespace tacho::sim
