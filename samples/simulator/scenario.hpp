#pragma once
// What a simulated robot is: its site, its work, its body and its faults. Read from JSON (samples/scenarios/*.json).

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "samples/simulator/link_faults.hpp"
#include "schema/records.hpp"

namespace tacho::sim {

/// A stretch of floor that makes trouble: while a robot passes it, it is blocked with this probability per pass.
struct HotSpot {
  double x_m = 0.0;
  double y_m = 0.0;
  double radius_m = 1.0;
  double probability = 0.0;  ///< per pass
  double mean_duration_s = 12.0;
  int reason = 1;  ///< code of block_reason
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
  double min_gap_s = 5.0;  ///< at least this long from an end to the next arrival of the same alarm
};

struct Scenario {
  std::string name = "robot";
  std::uint64_t seed = 1;
  std::string map = "hall";

  // Work: stations on a loop of corridors, driven in turn, waits in between, charging when low.
  double cruise_mps = 1.0;
  double accel_mps2 = 0.5;
  double turn_radps = 0.6;
  double wait_s = 8.0;       ///< mean stay at a station, uniform 0.5..1.5 times this
  bool always_idle = false;  ///< stands at its dock and only charges

  // Odometry: counter metres per true metre, measured twist per true twist, localisation noise (white, per 50 ms).
  double odo_scale = 1.0;      ///< growth of `odo` = odo_scale x path of the wheels' centre; turning on the spot adds 0
  double twist_scale = 1.0;    ///< reported vx = twist_scale x v
  double angular_scale = 1.0;  ///< reported w = angular_scale x true w
  double pose_sigma_m = 0.004;
  double heading_sigma_rad = 0.002;
  double odo_start_m = 21773.948;
  double slips_per_km = 0.0;  ///< stretches of 2 m on which the wheels drive slip_m further than the robot
  double slip_m = 0.4;
  double jumps_per_hour = 0.0;  ///< localisation is wrong by jump_m for 20 s, then right again
  double jump_m = 0.5;

  // Battery: 24 or 48 V pack.
  double capacity_ah = 40.0;
  double nominal_voltage = 48.0;
  double soc_start = 0.9;
  double charge_below = 0.35;
  double charge_until = 0.95;
  double charge_current_a = 18.5;
  double fade_per_efc = 2e-4;  ///< share of capacity lost per equivalent full cycle
  double current_noise_a = 0.05;
  double internal_resistance_ohm = 0.06;
  double resistance_growth_per_day = 0.0;  ///< share of internal_resistance_ohm added per day
  double soc_step = 0.0001;                ///< resolution of the reported battery_level
  double cycle_share = 0.0;  ///< battery_cycle counts each discharge of this share of capacity; 0 = stays 0

  std::vector<AlarmSpec> alarms;  ///< 54004 (motor emergency stop) also sets `emergency`
  std::vector<HotSpot> hot_spots;
  double blocks_per_km = 0.0;  ///< blocked anywhere on the corridors, by a dynamic obstacle
  double slowed_per_km = 0.0;  ///< stretches of 3 m driven at 0.3 m/s with `slowed`

  // Reported shape.
  int alarm_shape = 2;  ///< 0: {"code":ts}; 1: + desc, times; 2: + code, dateTime, ...; 3: nested `alarms` too
  WordOrder word_order = WordOrder::cdab;
  bool registers_rounded = true;  ///< floats of registers: as the JSON answer prints them; false: noise in every bit
  bool battery_fields = true;     ///< false: the answer has no battery_* keys and zero registers
  bool ignores_keys = false;      ///< 1100 with `keys` is answered with everything
  double clock_offset_s = 0.0;    ///< robot clock minus true time
  // Faults of the robot's clock; times since the start. Stamps of alarms follow clock_offset_s alone.
  double clock_drift_ppm = 0.0;
  double clock_step_s = 0.0;  ///< added from clock_step_at_s on
  double clock_step_at_s = 0.0;
  double clock_frozen_from_s = 0.0;  ///< shows the same time for clock_frozen_s, then goes on that much behind
  double clock_frozen_s = 0.0;
  std::string ip = "127.0.0.1";          ///< what the robot says its address is
  int modbus_unit = 1;                   ///< requests for another unit get no answer; -1 = any
  std::string body_file;                 ///< serve exactly these bytes as every 11100 answer
  std::string io_body_file;              ///< the same for 11013
  std::vector<FaultWindow> link_faults;  ///< of `serve`: what goes wrong on its ports, and when
};

/// One file may hold one scenario object or an array of them; paths in it are relative to its folder. Throws Error
/// naming file and key.
std::vector<Scenario> load_scenarios(const std::filesystem::path& file);

/// A scenario of everyday work with alarms and blockages, for demos and tests.
Scenario busy_day(std::uint64_t seed);

}  // namespace tacho::sim
