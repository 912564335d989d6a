#pragma once
// A simulated robot: motion primitives and battery in closed form, so its state is exact at any time and its truth is
// known without integration error.

#include <memory>
#include <string>
#include <vector>

#include "samples/simulator/scenario.hpp"

namespace tacho::sim {

struct ActiveAlarm {
  AlarmLevel level = AlarmLevel::warning;
  std::int64_t code = 0;
  std::int64_t stamp_s = 0;
  std::int64_t times = 1;
  std::string desc;
};

/// What the robot would say now. True values; noise and rounding are added where answers are made.
struct RobotState {
  Micros t_us = 0;
  double x_m = 0, y_m = 0, angle_rad = 0;
  double v_mps = 0, w_radps = 0;
  double path_m = 0;        ///< true metres driven since the start
  double heading_sum_rad = 0;
  bool is_stop = true, blocked = false, slowed = false, charging = false, emergency = false;
  int block_reason = 0;
  double block_x_m = 0, block_y_m = 0;  ///< last obstacle, also while not blocked
  double soc = 0, current_a = 0, voltage_v = 0, battery_temp_c = 25, capacity_ah = 0;
  double charged_ah = 0, discharged_ah = 0;  ///< since the start, terminal
  int task_status = 0, task_type = 0;
  std::string current_station, last_station, target_station;
  double uptime_s = 0;
  std::vector<ActiveAlarm> alarms;
};

struct TrueEpisode {
  Micros from_us = 0, to_us = 0;
  double x_m = 0, y_m = 0;      ///< robot
  double obstacle_x_m = 0, obstacle_y_m = 0;
  int reason = 0;
};
struct TrueAlarm {
  AlarmLevel level = AlarmLevel::warning;
  std::int64_t code = 0;
  Micros from_us = 0, to_us = 0;
};

/// Everything that is true of [t0, now]; written beside a log as truth.json.
struct Truth {
  Micros t0_us = 0, t1_us = 0;
  double odo_scale = 1, twist_scale = 1, angular_scale = 1;
  double path_m = 0;
  double counter_m = 0;           ///< growth of `odo`
  double charged_ah = 0, discharged_ah = 0;
  double equivalent_full_cycles_soc = 0;  ///< half the total variation of SoC
  std::vector<double> capacity_ah_per_day;
  std::vector<TrueAlarm> alarms;  ///< intervals that overlap [t0, t1], open ones end at t1
  std::vector<TrueEpisode> blocked;
  int charge_sessions = 0;
};

class Robot {
 public:
  Robot(const Scenario& scenario, Micros t0_us);
  ~Robot();
  Robot(Robot&&) noexcept;

  /// State at `t_us`; times must not decrease from call to call.
  const RobotState& at(Micros t_us);
  [[nodiscard]] Truth truth() const;  ///< up to the last at()
  [[nodiscard]] const Scenario& scenario() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// The truth as JSON text (one object per robot).
std::string truth_json(const std::string& robot, const Truth& truth);

}  // namespace tacho::sim
