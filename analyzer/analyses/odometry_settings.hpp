#pragma once
// Thresholds of the odometry analysis: the rows of the settings table and their values for one robot.

#include <span>
#include <string>

#include "analyzer/settings.hpp"

namespace tacho::odometry {

std::span<const SettingRow> setting_rows();

/// The rows of setting_rows() as numbers, for one robot. Units are in the names.
struct Config {
  double v_max_mps = 0;
  double accel_floor_mps2 = 0;
  double turn_accel_floor_radps2 = 0;
  double still_mps = 0;
  double still_radps = 0;
  double gap_periods = 0;
  double gap_min_s = 0;
  double period_max_s = 0;
  double driven_min_m = 0;
  double window_m = 0;
  double window_max_m = 0;
  double speed_u_max = 0;
  double stride_m = 0;
  double stride_sigmas = 0;
  double stride_turn_rad = 0;
  double stride_ratio_min = 0;
  double stuck_m = 0;
  double correction_doubt = 0;
  double pivot_mps = 0;
  double pivot_min_rad = 0;
  double jump_m = 0;
  double jump_rad = 0;
  double jump_sigmas = 0;
  double jump_min_km = 0;
  double jump_seen_m = 0;
  double still_run_s = 0;
  double chord_min = 0;
  double scale_pass = 0;
  double speed_fail = 0;
  double path_fail = 0;
  double drift_pass_deg = 0;
  double drift_fail_deg = 0;
  double drift_n_min = 0;
  double jumps_fail_per_10km = 0;
  double cross_pass = 0;
  double cross_fail = 0;
  double soc_tolerance = 0;
  double draws = 0;
  std::optional<double> track_m;

  static Config load(const Settings& settings, const std::string& robot);
};

}  // namespace tacho::odometry
