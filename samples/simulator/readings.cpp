#include "samples/simulator/readings.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "samples/simulator/rng.hpp"
#include "samples/simulator/site.hpp"

namespace tacho::sim {
namespace {

constexpr double kTotalTimeAtStartS = 449'741.604;
constexpr double kTwistNoise = 1e-4;
constexpr Micros kCycle = 50'000;                // of the controller: all sources asked within one show the same noise
constexpr double kStationRadiusRegister = 0.50;  // 1100 uses 0.30
constexpr std::int64_t kNoReflectors = 54018;
constexpr int kLoadInput = 12;

enum Channel : std::uint64_t {
  kX,
  kY,
  kAngle,
  kVx,
  kVy,
  kW,
  kCurrent,
  kVoltage,
  kConfidence,
  kTemp,
  kHumidity,
  kController,
  kRssi,
  kAcc,
  kRot = kAcc + 3,
  kAttitude = kRot + 3,
  kChannels = kAttitude + 3
};

void set(Readings& r, FieldIndex f, double value) { r.value[f] = value; }

bool has_alarm(const RobotState& state, std::int64_t code) {
  return std::any_of(state.alarms.begin(), state.alarms.end(), [code](const ActiveAlarm& a) { return a.code == code; });
}

int number_of(const std::string& station) {
  int number = 0;
  const std::size_t digits = station.find_first_of("0123456789");
  if (digits != std::string::npos) {
    std::from_chars(station.data() + digits, station.data() + station.size(), number);
  }
  return number;
}

// Goods are carried from odd stations to the next one.
bool loaded(const RobotState& state) { return state.task_status == 2 && number_of(state.last_station) % 2 == 1; }

void read_counters(const Scenario& scenario, const RobotState& state, Readings& r) {
  set(r, field("odo"), scenario.odo_start_m + scenario.odo_scale * state.wheel_path_m);
  set(r, field("today_odo"), scenario.odo_scale * state.today_wheel_path_m);
  set(r, field("uptime"), state.uptime_s);
  set(r, field("total_time"), kTotalTimeAtStartS + state.uptime_s);
  set(r, field("today_time"), state.today_s);
  r.clock = robot_clock(state.t_us + state.clock_fault_us, scenario.clock_offset_s);
  set(r, field("clock_year"), r.clock.year);
  set(r, field("clock_month"), r.clock.month);
  set(r, field("clock_day"), r.clock.day);
  set(r, field("clock_hour"), r.clock.hour);
  set(r, field("clock_minute"), r.clock.minute);
  set(r, field("clock_second"), r.clock.second);
}

void read_motion(const Scenario& scenario, const RobotState& state, const Noise& noise, Readings& r) {
  const double angle = state.angle_rad + scenario.heading_sigma_rad * noise.normal(kAngle);
  r.pose = {state.x_m + state.pose_error_x_m + scenario.pose_sigma_m * noise.normal(kX),
            state.y_m + state.pose_error_y_m + scenario.pose_sigma_m * noise.normal(kY),
            std::remainder(angle, 2 * std::numbers::pi)};
  set(r, field("x"), r.pose.x_m);
  set(r, field("y"), r.pose.y_m);
  set(r, field("angle"), r.pose.angle_rad);
  set(r, field("vx"), scenario.twist_scale * state.wheel_mps + kTwistNoise * noise.normal(kVx));
  set(r, field("vy"), kTwistNoise * noise.normal(kVy));
  set(r, field("w"), scenario.angular_scale * state.w_radps + kTwistNoise * noise.normal(kW));
  set(r, field("r_vx"), state.wheel_mps);
  set(r, field("r_w"), state.w_radps);
  set(r, field("is_stop"), state.is_stop);
  set(r, field("brake"), state.is_stop && state.task_status != 2);

  // A standing robot does not compute its confidence anew.
  const Noise still(scenario.seed, state.still_since_us);
  const double confidence = 0.93 + 0.025 * (state.is_stop ? still : noise).normal(kConfidence);
  set(r, field("confidence"), has_alarm(state, kNoReflectors) ? -0.0 : std::clamp(confidence, 0.3, 0.9999));
  set(r, field("reloc_status"), 1);
  set(r, field("reloc_status_register"), 1);
  set(r, field("loadmap_status"), 1);
}

void read_inertial_unit(const RobotState& state, const Noise& noise, Readings& r) {
  set(r, field("acc_x"), 0.012 + 0.01 * noise.normal(kAcc));
  set(r, field("acc_y"), -0.29 + 0.01 * noise.normal(kAcc + 1) + state.v_mps * state.w_radps);
  set(r, field("acc_z"), -9.79 + 0.02 * noise.normal(kAcc + 2));
  set(r, field("rot_x"), 0.57 + 0.05 * noise.normal(kRot));
  set(r, field("rot_y"), 0.1 + 0.05 * noise.normal(kRot + 1));
  set(r, field("rot_z"), -0.21 + 0.05 * noise.normal(kRot + 2) + state.w_radps * 180 / std::numbers::pi);
  const double roll = 0.003 + 2e-4 * noise.normal(kAttitude);
  const double pitch = -0.001 + 2e-4 * noise.normal(kAttitude + 1);
  const double yaw =
      std::remainder(state.heading_sum_rad + 0.3 + 1e-3 * noise.normal(kAttitude + 2), 2 * std::numbers::pi);
  set(r, field("roll"), roll);
  set(r, field("pitch"), pitch);
  set(r, field("yaw"), yaw);
  const double cr = std::cos(roll / 2), sr = std::sin(roll / 2);
  const double cp = std::cos(pitch / 2), sp = std::sin(pitch / 2);
  const double cy = std::cos(yaw / 2), sy = std::sin(yaw / 2);
  set(r, field("qw"), cr * cp * cy + sr * sp * sy);
  set(r, field("qx"), sr * cp * cy - cr * sp * sy);
  set(r, field("qy"), cr * sp * cy + sr * cp * sy);
  set(r, field("qz"), cr * cp * sy - sr * sp * cy);
}

void read_battery(const Scenario& scenario, const RobotState& state, const Noise& noise, Readings& r) {
  set(r, field("charging"), state.charging);
  set(r, field("auto_charge"), state.charging);
  if (!scenario.battery_fields) {
    for (const FieldIndex f : {field("battery_level"), field("battery_temp"), field("voltage"), field("current")}) {
      set(r, f, -0.0);
    }
    return;
  }
  set(r, field("battery_level"), std::round(state.soc / scenario.soc_step) * scenario.soc_step);
  set(r, field("battery_temp"), state.battery_temp_c);
  set(r, field("voltage"), state.voltage_v + 0.01 * noise.normal(kVoltage));
  set(r, field("current"), state.current_a + scenario.current_noise_a * noise.normal(kCurrent));
  set(r, field("max_charge_voltage"), scenario.nominal_voltage * 1.14);
  set(r, field("max_charge_current"), scenario.charge_current_a * 1.5);
  set(r, field("battery_cycle"), state.battery_cycle);
}

void read_controller(const RobotState& state, const Noise& noise, Readings& r) {
  set(r, field("controller_temp"), state.battery_temp_c + 22 + 0.05 * noise.normal(kTemp));
  set(r, field("controller_humi"), 16.5 + 0.02 * noise.normal(kHumidity));
  set(r, field("controller_voltage"), 23.8 + 0.02 * noise.normal(kController));
  const double to_access_point_m = std::hypot(state.x_m - 20, state.y_m - 10);
  set(r, field("rssi"), std::clamp(85 - 1.2 * to_access_point_m + 2 * noise.normal(kRssi), 0.0, 100.0));
}

void read_obstacles(const RobotState& state, Readings& r) {
  set(r, field("blocked"), state.blocked);
  set(r, field("block_reason"), state.blocked ? state.block_reason : 1);  // registers show 1 while not blocked
  set(r, field("block_x"), state.block_x_m);
  set(r, field("block_y"), state.block_y_m);
  set(r, field("block_ultrasonic_id"), state.blocked && state.block_reason == 0 ? 3 : 0);
  set(r, field("block_di"), state.blocked && state.block_reason >= 2 && state.block_reason <= 4 ? 8 : 0);
  set(r, field("slowed"), state.slowed);
  set(r, field("slow_reason"), state.slowed ? state.slow_reason : 1);
  set(r, field("slow_x"), state.x_m + 1.8 * std::cos(state.angle_rad));
  set(r, field("slow_y"), state.y_m + 1.8 * std::sin(state.angle_rad));
  set(r, field("manualblock"), 1);
}

void read_task(const RobotState& state, Readings& r) {
  set(r, field("task_status"), state.task_status);
  set(r, field("task_type"), state.task_type);
  const int here = station_near(state.x_m, state.y_m, kStationRadiusRegister);
  set(r, field("current_station_id"), here < 0 ? 0 : station_number(here));
  set(r, field("last_station_id"), number_of(state.last_station));
  set(r, field("target_station_id"), number_of(state.target_station));
  set(r, field("next_station_id"), state.task_status == 2 ? number_of(state.target_station) : 0);
  set(r, field("loaded"), loaded(state));
  set(r, field("fork_auto_flag"), 1);
  set(r, field("fork_height_in_place"), 1);
  set(r, field("fork_height"), loaded(state) ? 0.2489 : 0.085);
}

void read_alarms(const RobotState& state, Readings& r) {
  const bool stopped = has_alarm(state, kMotorEmergencyStop);
  set(r, field("emergency"), state.emergency);
  set(r, field("driver_emc"), stopped);
  constexpr FieldIndex kErrors[] = {field("error_code_1"), field("error_code_2"), field("error_code_3"),
                                    field("error_code_4"), field("error_code_5"), field("error_code_6")};
  std::size_t errors = 0;
  const auto first = [&r](FieldIndex code, FieldIndex has, const ActiveAlarm& alarm) {
    set(r, code, r[has] != 0 ? r[code] : static_cast<double>(alarm.code));
    set(r, has, 1);
  };
  for (const ActiveAlarm& alarm : state.alarms) {
    switch (alarm.level) {
      case AlarmLevel::fatal:
        first(field("fatal_code"), field("has_fatal"), alarm);
        break;
      case AlarmLevel::error:
        first(field("error_code"), field("has_error"), alarm);
        if (errors < std::size(kErrors)) {
          set(r, kErrors[errors++], static_cast<double>(alarm.code));
        }
        break;
      case AlarmLevel::warning:
        first(field("warning_code"), field("has_warning"), alarm);
        break;
      case AlarmLevel::notice:
        break;
    }
  }
}

void read_identity(const Scenario& scenario, Readings& r) {
  unsigned part[4] = {};
  if (std::sscanf(scenario.ip.c_str(), "%u.%u.%u.%u", &part[0], &part[1], &part[2], &part[3]) == 4) {
    constexpr FieldIndex kParts[] = {field("ip_1"), field("ip_2"), field("ip_3"), field("ip_4")};
    for (std::size_t i = 0; i < 4; ++i) {
      set(r, kParts[i], part[i]);
    }
  }
  set(r, field("version_major"), 3);
  set(r, field("version_minor"), 4);
  set(r, field("version_patch"), 7);
  set(r, field("version_redistribute"), 2000);
  set(r, field("rfid"), -1);
  set(r, field("di_count"), kNormalInputs);
  set(r, field("do_count"), kNormalOutputs);
}

// Inputs and outputs that have a discrete input of their own.
void read_points(const RobotState& state, Readings& r) {
  constexpr int kWithInput = 16;
  static const auto fields = [] {
    std::array<std::array<FieldIndex, kWithInput>, 2> found{};
    for (std::size_t i = 0; i < kWithInput; ++i) {
      found[0][i] = find_field("di_" + std::to_string(i));
      found[1][i] = find_field("do_" + std::to_string(i));
    }
    return found;
  }();
  for (int i = 0; i < kWithInput; ++i) {
    set(r, fields[0][static_cast<std::size_t>(i)], digital_input(state, i));
    set(r, fields[1][static_cast<std::size_t>(i)], digital_output(state, i));
  }
}

}  // namespace

bool digital_input(const RobotState& state, int id) {
  switch (id) {
    case 8:
      return state.blocked && state.block_reason >= 2 && state.block_reason <= 4;
    case 9:
      return state.charging;
    case 10:
      return state.emergency;
    case kLoadInput:
      return loaded(state);
    case 13:
      return !state.current_station.empty();
    default:
      return id < 8 || id == 14 || id == 15 || id == 23;
  }
}

bool digital_output(const RobotState& state, int id) {
  switch (id) {
    case 5:
      return state.charging;  // contactor
    case 7:
      return !state.is_stop;  // moving light
    case 8:
      return state.blocked || !state.alarms.empty();  // horn
    default:
      return id == 10 || id == 13 || id == 14;
  }
}

void read_sensors(const Scenario& scenario, const RobotState& state, Readings& out) {
  const Noise noise(scenario.seed, state.t_us / kCycle);
  out.value.fill(0.0);
  read_counters(scenario, state, out);
  read_motion(scenario, state, noise, out);
  read_inertial_unit(state, noise, out);
  read_battery(scenario, state, noise, out);
  read_controller(state, noise, out);
  read_obstacles(state, out);
  read_task(state, out);
  read_alarms(state, out);
  read_identity(scenario, out);
  read_points(state, out);
}

}  // namespace tacho::sim
