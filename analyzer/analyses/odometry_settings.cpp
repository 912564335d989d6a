#include "analyzer/analyses/odometry_settings.hpp"

#include <array>

namespace tacho::odometry {
namespace {

constexpr auto kTable = std::to_array<ConfigRow<Config>>({
    {{"odometry.v_max_mps", 2.5, "m/s", "Fastest the robot can drive; a counter that grows faster jumped", kAbove0},
     &Config::v_max_mps},
    {{"odometry.accel_floor_mps2", 0.3, "m/s2", "Lowest acceleration bound used between two polls"},
     &Config::accel_floor_mps2},
    {{"odometry.turn_accel_floor_radps2", 0.3, "rad/s2", "Lowest angular acceleration bound used between two polls"},
     &Config::turn_accel_floor_radps2},
    {{"odometry.still_mps", 0.005, "m/s", "Slower counts as standing"}, &Config::still_mps},
    {{"odometry.still_radps", 0.005, "rad/s", "Turning slower counts as standing"}, &Config::still_radps},
    {{"odometry.gap_periods", 3, "1", "A pause longer than so many median periods is a gap", kFrom1},
     &Config::gap_periods},
    {{"odometry.gap_min_s", 2, "s", "Shorter pauses are no gap"}, &Config::gap_min_s},
    {{"odometry.period_max_s", 2, "s", "With slower polling (5 % for jitter), path, drift and jumps are unknown",
      kAbove0},
     &Config::period_max_s},
    {{"odometry.driven_min_m", 100, "m", "Less driven distance decides nothing"}, &Config::driven_min_m},
    {{"odometry.window_m", 20, "m", "Shortest window of counter against speed", kAbove0}, &Config::window_m},
    {{"odometry.window_max_m", 500, "m", "A window grows up to this length to reach speed_u_max", kAbove0},
     &Config::window_max_m},
    {{"odometry.speed_u_max", 0.01, "1", "Counter against speed is unknown when the usual window is less certain"},
     &Config::speed_u_max},
    {{"odometry.stride_m", 0.20, "m", "Shortest stride of counter against path", kAbove0}, &Config::stride_m},
    {{"odometry.stride_sigmas", 10, "1", "A stride is at least so many sigmas of the pose noise"},
     &Config::stride_sigmas},
    {{"odometry.stride_turn_rad", 1, "rad", "Strides that turn more are left out, with their counter metres"},
     &Config::stride_turn_rad},
    {{"odometry.stride_ratio_min", 0.85, "1", "Strides more bent than this chord/arc ratio are left out", kShare},
     &Config::stride_ratio_min},
    {{"odometry.stuck_m", 1, "m", "A counter that stands while the speed says so many metres is stuck"},
     &Config::stuck_m},
    {{"odometry.correction_doubt", 0.25, "1", "Share of the arc and noise corrections that widens the interval",
      kShare},
     &Config::correction_doubt},
    {{"odometry.pivot_mps", 0.02, "m/s", "Slower driving while turning is turning on the spot"}, &Config::pivot_mps},
    {{"odometry.pivot_min_rad", 30, "rad", "Turning on the spot needed to say what the counter counts"},
     &Config::pivot_min_rad},
    {{"odometry.jump_m", 0.10, "m", "Smaller localisation steps are no jumps"}, &Config::jump_m},
    {{"odometry.jump_rad", 0.0523598775598299, "rad", "Smaller heading steps are no jumps (3 degrees)"},
     &Config::jump_rad},
    {{"odometry.jump_sigmas", 6, "1", "Steps within so many sigmas of the noise are no jumps"}, &Config::jump_sigmas},
    {{"odometry.jump_min_km", 1, "km", "No unexplained jump is a PASS only after this distance"}, &Config::jump_min_km},
    {{"odometry.jump_seen_m", 0.5, "m", "It is one only if a step of this size would have shown on most of it"},
     &Config::jump_seen_m},
    {{"odometry.still_run_s", 10, "s", "Shortest standstill that pose noise is measured in"}, &Config::still_run_s},
    {{"odometry.chord_min", 0.95, "1", "Straightness (chord/arc) of the pairs of the position drift law", kShare},
     &Config::chord_min},
    {{"odometry.scale_pass", 0.01, "1", "PASS below this deviation of counter against speed and path"},
     &Config::scale_pass},
    {{"odometry.speed_fail", 0.03, "1", "FAIL above this deviation of counter against speed"}, &Config::speed_fail},
    {{"odometry.path_fail", 0.02, "1", "FAIL above this deviation of counter against path"}, &Config::path_fail},
    {{"odometry.drift_pass_deg", 2, "deg", "PASS below this mean heading drift over 10 m"}, &Config::drift_pass_deg},
    {{"odometry.drift_fail_deg", 5, "deg", "FAIL above this mean heading drift over 10 m"}, &Config::drift_fail_deg},
    {{"odometry.drift_n_min", 10, "1", "Independent 10 m stretches needed to judge heading drift", kFrom1},
     &Config::drift_n_min},
    {{"odometry.jumps_fail_per_10km", 2, "1/10km", "FAIL above this rate of unexplained localisation jumps"},
     &Config::jumps_fail_per_10km},
    {{"odometry.cross_pass", 1e-4, "1", "PASS up to this share of JSON-Modbus differences outside tolerance", kShare},
     &Config::cross_pass},
    {{"odometry.cross_fail", 0.01, "1", "FAIL above this share of JSON-Modbus differences outside tolerance", kShare},
     &Config::cross_fail},
    {{"odometry.soc_tolerance", 0.01, "1", "State of charge may differ so much between JSON and the integer register",
      kShare},
     &Config::soc_tolerance},
    {{"odometry.bootstrap_draws", 999, "1", "Draws of the moving-block bootstrap", kFrom1}, &Config::draws},
    {{"odometry.track_m", std::nullopt, "m", "Distance between the driven wheels", kAbove0}, &Config::track_m},
});

}  // namespace

std::span<const SettingRow> setting_rows() {
  static constexpr auto kRows = rows_of(kTable);
  return kRows;
}

Config Config::load(const Settings& settings, const std::string& robot) {
  Config config;
  fill(config, kTable, settings, robot);
  return config;
}

}  // namespace tacho::odometry
