#pragma once
// What a simulated robot is: its site, its work, its body and its faults. Read from JSON (samples/scenarios/*.json).

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "schema/records.hpp"

namespace tacho::sim {

/// A stretch of floor that makes trouble: while a robot passes it, it is blocked with this probability per pass.
struct HotSpot {
  double x_m = 0.0;
  double y_m = 0.0;
  double radius_m = 1.0;
  double probability = 0.0;       ///< per pass
  double mean_duration_s = 12.0;
  int reason = 1;                 ///< code of block_reason
};

/// An alarm that comes at random times, independent of place.
struct AlarmSpec {
  AlarmLevel level = AlarmLevel::warning;
  std::int64_t code = 54018;
  double per_hour = 0.2;
  double mean_duration_s = 40.0;
  double min_duration_s = 0.0;
  bool stops_robot = false;
  std::string desc;
};

struct Scenario {
  std::string name = "robot";
  std::uint64_t seed = 1;
  std::string map = "hall";

  // Work: stations on a loop of corridors, driven in turn, waits in between, charging when low.
  double cruise_mps = 1.0;
  double accel_mps2 = 0.5;
  double turn_radps = 0.6;
  double wait_s = 8.0;
  bool always_idle = false;

  // Odometry: counter metres per true metre, measured twist per true twist, localisation noise.
  double odo_scale = 1.0;
  double twist_scale = 1.0;
  double angular_scale = 1.0;
  double pose_sigma_m = 0.004;
  double heading_sigma_rad = 0.002;
  double odo_start_m = 21773.948;

  // Battery: 24 or 48 V pack.
  double capacity_ah = 40.0;
  double nominal_voltage = 48.0;
  double soc_start = 0.9;
  double charge_below = 0.35;
  double charge_until = 0.95;
  double charge_current_a = 18.5;
  double fade_per_efc = 2e-4;      ///< share of capacity lost per equivalent full cycle
  double current_noise_a = 0.05;
  double internal_resistance_ohm = 0.06;
  double resistance_growth_per_day = 0.0;

  std::vector<AlarmSpec> alarms;
  std::vector<HotSpot> hot_spots;

  // Reported shape.
  int alarm_shape = 2;             ///< 0: {"code":ts}; 1: + desc, times; 2: + code, dateTime, ...; 3: nested `alarms` too
  WordOrder word_order = WordOrder::cdab;
  bool battery_fields = true;      ///< false: the answer has no battery_* keys and zero registers
  double clock_offset_s = 0.0;     ///< robot clock minus true time
  std::string body_file;           ///< serve exactly these bytes as every 11100 answer
};

/// One file may hold one scenario object or an array of them. Throws Error naming file and key.
std::vector<Scenario> load_scenarios(const std::filesystem::path& file);

/// A scenario of everyday work with alarms and blockages, for demos and tests.
Scenario busy_day(std::uint64_t seed);

}  // namespace tacho::sim
