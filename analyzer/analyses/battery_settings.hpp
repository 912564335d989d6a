#pragma once
// Thresholds of the battery analysis: the rows of the settings table and their values for one robot.

#include <optional>
#include <span>
#include <string>

#include "analyzer/settings.hpp"

namespace tacho::battery {

std::span<const SettingRow> setting_rows();

/// The rows of setting_rows() as numbers, for one robot. Units are in the names.
struct Config {
  double rest_current_a = 0;
  double rest_current_max_a = 0;
  double dwell_s = 0;
  double gap_periods = 0;
  double bridge_max_h = 0;
  double session_gap_min = 0;
  double current_offset_a = 0;
  double hysteresis = 0;
  double standing_current_a = 0;
  double full_soc = 0;
  double low_soc = 0;
  double deep_soc = 0;
  double failed_s = 0;
  double failed_fail = 0;
  double contradiction_s = 0;
  double contradiction_fail = 0;
  double temp_warn_c = 0;
  double temp_max_c = 0;
  double temp_min_c = 0;
  double day_coverage = 0;
  double trend_days = 0;
  double counter_steps = 0;
  double not_full_days = 0;
  double missed_charge_min = 0;
  double missed_charge_soc = 0;
  std::optional<double> nominal_capacity_ah;
  std::string nominal_source;  ///< "config.toml:12", "not configured"

  static Config load(const Settings& settings, const std::string& robot);
};

}  // namespace tacho::battery
