#pragma once
// A simulated robot: motion primitives and battery in closed form, so its state is exact at any time and its truth is
// known without integration error.
//
// What the scales of a scenario mean (everything else in RobotState is true):
//   odo         = odo_start_m + odo_scale * wheel_path_m     centre path; turning on the spot adds nothing
//   vx, vy, w   = twist_scale * wheel_mps, 0, angular_scale * w_radps, plus noise of 1e-4
//   x, y, angle = true pose + pose_error (a localisation fault) + white noise
// wheel_path_m = path_m except where the wheels slip. battery_level is relative to the present capacity, as a BMS
// reports it; the capacity is learnt anew at the end of each charge.

#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "samples/simulator/scenario.hpp"

namespace tacho::sim {

/// Raised while the motors are in emergency stop.
inline constexpr std::int64_t kMotorEmergencyStop = 54004;

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
  double pose_error_x_m = 0, pose_error_y_m = 0;  ///< localisation fault, added to every reported pose
  double path_m = 0;                              ///< true metres driven since the start, forwards and backwards
  double wheel_mps = 0;                        ///< speed of the wheels over ground; differs from v_mps while slipping
  double wheel_path_m = 0;                     ///< metres the wheels have driven since the start
  double today_wheel_path_m = 0, today_s = 0;  ///< since the robot's midnight (zone UTC-11) or the start
  double heading_sum_rad = 0;                  ///< signed sum of all turning since the start
  Micros still_since_us = 0;                   ///< when it came to rest; t_us while it moves
  bool is_stop = true, blocked = false, slowed = false, charging = false, emergency = false;
  int block_reason = 0, slow_reason = 0;
  double block_x_m = 0, block_y_m = 0;  ///< last obstacle, also while not blocked
  double soc = 0, current_a = 0, voltage_v = 0, battery_temp_c = 25, capacity_ah = 0;
  double charged_ah = 0, discharged_ah = 0;  ///< since the start, terminal
  double soc_variation = 0;                  ///< sum of |change of soc| since the start
  int battery_cycle = 0;
  int task_status = 0, task_type = 0;
  std::string current_station, last_station, target_station;
  double uptime_s = 0;
  Micros clock_fault_us = 0;  ///< what the robot's clock is off beside clock_offset_s
  std::vector<ActiveAlarm> alarms;
};

struct TrueEpisode {
  Micros from_us = 0, to_us = 0;
  double x_m = 0, y_m = 0;  ///< robot
  double obstacle_x_m = 0, obstacle_y_m = 0;
  int reason = 0;
};
/// The localisation steps by this vector at t_us.
struct TrueJump {
  Micros t_us = 0;
  double dx_m = 0, dy_m = 0;
};
/// The wheels drive `metres` further than the robot.
struct TrueSlip {
  Micros from_us = 0, to_us = 0;
  double metres = 0;
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
  double counter_m = 0;  ///< growth of `odo`
  double charged_ah = 0, discharged_ah = 0;
  double equivalent_full_cycles_soc = 0;    ///< half the total variation of SoC
  std::vector<double> capacity_ah_per_day;  ///< element i: at t0 + i days
  std::vector<TrueAlarm> alarms;            ///< intervals that overlap [t0, t1], open ones end at t1
  std::vector<TrueEpisode> blocked;         ///< likewise
  std::vector<TrueJump> jumps;
  std::vector<TrueSlip> slips;
  int charge_sessions = 0;  ///< begun
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
/// An array of them as a file. Throws Error when it cannot be written.
void write_truth(const std::filesystem::path& file, std::span<const std::string> robots, std::span<const Truth> truths);

}  // namespace tacho::sim
