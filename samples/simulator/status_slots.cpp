#include "samples/simulator/status_slots.hpp"

#include <array>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "samples/simulator/json_text.hpp"
#include "samples/simulator/rng.hpp"
#include "samples/simulator/site.hpp"

namespace tacho::sim {
namespace {

constexpr double kWheelRadius = 0.1;
constexpr double kHalfTrack = 0.25;
constexpr double kTicksPerRad = 10000;
constexpr std::uint64_t kMotorNoise = 100;  // channels of the readings are below, of laser beams above
constexpr std::uint64_t kBeamNoise = 1000;

std::string hex_of(std::string_view text, std::size_t digits) {
  std::uint64_t hash = 0xCBF29CE484222325u;
  for (const char c : text) {
    hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001B3u;
  }
  std::string out;
  for (std::size_t i = 0; i < digits; ++i) {
    out += "0123456789abcdef"[mix64(hash + i) & 15];
  }
  return out;
}

void append_point(std::string& out, double x, double y) {
  out += R"({"x":)";
  append_shortest(out, x);
  out += R"(,"y":)";
  append_shortest(out, y);
  out += '}';
}

// A point given in the robot's frame.
void append_in_map(std::string& out, const Pose& pose, double ahead, double left) {
  const double c = std::cos(pose.angle_rad);
  const double s = std::sin(pose.angle_rad);
  append_point(out, pose.x_m + c * ahead - s * left, pose.y_m + s * ahead + c * left);
}

void robot_region(std::string& out, const Moment& m) {
  constexpr std::array<std::array<double, 2>, 4> kCorners{{{0.62, -0.39}, {-0.58, -0.39}, {-0.58, 0.39}, {0.62, 0.39}}};
  for (const auto& corner : kCorners) {
    out += &corner == &kCorners[0] ? "" : ",";
    append_in_map(out, m.readings.pose, corner[0], corner[1]);
  }
}

// While blocked the obstacle; else a wall on the left, at the robot's own uncertainty.
void nearest_obstacle(std::string& out, const Moment& m) {
  if (m.state.blocked) {
    append_point(out, m.state.block_x_m, m.state.block_y_m);
  } else {
    append_in_map(out, m.readings.pose, 0.4, 1.1 + 0.1 * std::sin(m.state.path_m));
  }
}

void append_nanoseconds(std::string& out, const Moment& m, std::int64_t offset) {
  append_integer(out, std::llround(m.state.uptime_s * 1e6) * 1000 + offset);
}

void imu_nsec(std::string& out, const Moment& m) { append_nanoseconds(out, m, -1'660'584); }

struct Motor {
  int id;
  std::string_view name;
  double position;
  double speed;
};

void append_motor(std::string& out, const Moment& m, const Motor& motor) {
  const Noise noise(m.scenario.seed, m.state.t_us);
  const bool turns = motor.speed != 0;
  const double measured = turns ? motor.speed + 0.01 * noise.normal(kMotorNoise + static_cast<unsigned>(motor.id)) : 0;
  out += R"({"calib":true,"can_id":)";
  append_integer(out, motor.id);
  out += R"(,"can_router":1,"current":)";
  append_integer(out, std::lround(measured * 3));
  out += R"(,"emc":)";
  out += m.state.emergency ? "true" : "false";
  out += R"(,"encoder":)";
  append_integer(out, std::llround(motor.position * kTicksPerRad));
  out += R"(,"err":false,"error_code":0,"follow_err":false,"header":{"data_nsec":")";
  append_nanoseconds(out, m, -21'703'921 - motor.id * 1'000'003);
  out += R"(","frame_id":"","pub_nsec":"0","seq":"0"},"motor_name":")";
  out += motor.name;
  out += R"(","passive":false,"position":)";
  append_shortest(out, static_cast<float>(motor.position));
  out += R"(,"raw_position":)";
  append_shortest(out, static_cast<float>(std::fmod(motor.position, 2 * std::numbers::pi)));
  out += R"(,"speed":)";
  append_shortest(out, static_cast<float>(measured));
  out += R"(,"stop":)";
  out += turns ? "false" : "true";
  out += R"(,"temperature":28,"type":0,"voltage":0})";
}

void motor_info(std::string& out, const Moment& m) {
  const double path = m.state.wheel_path_m;
  const double turned = kHalfTrack * m.state.heading_sum_rad;
  const double turn_speed = kHalfTrack * m.state.w_radps;
  append_motor(out, m, {1, "left", (path - turned) / kWheelRadius, (m.state.wheel_mps - turn_speed) / kWheelRadius});
  out += ',';
  append_motor(out, m, {2, "right", (path + turned) / kWheelRadius, (m.state.wheel_mps + turn_speed) / kWheelRadius});
  out += ',';
  append_motor(out, m, {3, "linear", m.readings[field("fork_height")], 0});
}

void steer(std::string& out, const Moment& m) {
  const Noise noise(m.scenario.seed, m.state.t_us);
  const double play = m.state.is_stop ? 0 : 1e-3 * noise.normal(kMotorNoise);
  append_shortest(out, std::atan2(m.state.w_radps, 0.01 + std::abs(m.state.wheel_mps)) + play);
}

void append_inputs(std::string& out, const Moment& m) {
  for (int id = 0; id < kInputCount; ++id) {
    out += id == 0 ? R"({"id":)" : R"(,{"id":)";
    append_integer(out, id);
    out += id < kNormalInputs ? R"(,"source":"normal","status":)" : R"(,"source":"virtual","status":)";
    out += digital_input(m.state, id) ? R"(true,"valid":true})" : R"(false,"valid":true})";
  }
}

void append_outputs(std::string& out, const Moment& m) {
  for (int id = 0; id < kOutputCount; ++id) {
    out += id == 0 ? R"({"id":)" : R"(,{"id":)";
    append_integer(out, id);
    out += id < kNormalOutputs ? R"(,"source":"normal","status":)" : R"(,"source":"reserve","status":)";
    out += digital_output(m.state, id) ? "true}" : "false}";
  }
}

// Two safety scanners of 270 degrees; free floor with a wall.
void lasers(std::string& out, const Moment& m) {
  constexpr int kBeams = 541;
  const Noise noise(m.scenario.seed, m.state.t_us);
  for (int scanner = 0; scanner < 2; ++scanner) {
    out += scanner == 0 ? R"({"beams":[)" : R"(,{"beams":[)";
    for (int i = 0; i < kBeams; ++i) {
      out += i == 0 ? R"({"angle":)" : R"(,{"angle":)";
      append_rounded(out, -135 + 0.5 * i, 4);
      out += R"(,"dist":)";
      append_rounded(out, 4 + 2 * std::sin(0.02 * i) + 0.01 * noise.uniform(kBeamNoise + static_cast<unsigned>(i)), 3);
      out += R"(,"rssi":50,"valid":true})";
    }
    out += R"(],"device_info":{"device_name":"laser)";
    append_integer(out, scanner);
    out += R"(","max_angle":135,"max_range":40,"min_angle":-135,"pub_step":0.5,"real_step":0.5,"scan_freq":33},)"
           R"("header":{"data_nsec":")";
    append_nanoseconds(out, m, -10'040'000);
    out += R"(","frame_id":"scanner"},"install_info":{"x":0.55,"y":0.35,"yaw":45},"use_forLoc":true})";
  }
}

void target_point(std::string& out, const Moment& m) {
  out += '[';
  for (std::size_t i = 0; i < kStations.size(); ++i) {
    if (kStations[i].id == m.state.target_station) {
      const Pose pose = station_pose(static_cast<int>(i));
      append_rounded(out, pose.x_m, 3);
      out += ',';
      append_rounded(out, pose.y_m, 3);
      out += ',';
      append_rounded(out, pose.angle_rad, 4);
    }
  }
  out += ']';
}

void append_quoted(std::string& out, std::string_view text) {
  out += '"';
  append_escaped(out, text);
  out += '"';
}

void finished(std::string& out, const Moment& m) {
  const std::string& done = m.state.task_status == 2 ? m.state.last_station : m.state.target_station;
  if (!done.empty()) {
    append_quoted(out, done);
  }
}

void unfinished(std::string& out, const Moment& m) {
  if (m.state.task_status == 2) {
    append_quoted(out, m.state.target_station);
  }
}

std::string description(const ActiveAlarm& alarm) {
  return alarm.desc.empty() ? "alarm " + std::to_string(alarm.code) : alarm.desc;
}

// {"54018":1767225600 ... in the scenario's shape
void append_alarm(std::string& out, const ActiveAlarm& alarm, int shape) {
  out += "{\"";
  append_integer(out, alarm.code);
  out += "\":";
  append_integer(out, alarm.stamp_s);
  if (shape >= 2) {
    out += R"(,"code":)";
    append_integer(out, alarm.code);
    out += R"(,"dateTime":")" + alarm_date_time(alarm.stamp_s) + '"';
  }
  if (shape >= 1) {
    out += R"(,"desc":)";
    append_quoted(out, description(alarm));
  }
  if (shape >= 2) {
    out += R"(,"describe":)";
    append_quoted(out, description(alarm));
    out += R"(,"method":"Look at the robot and its surroundings.\n","reason":"")";
  }
  if (shape >= 1) {
    out += R"(,"times":)";
    append_integer(out, alarm.times);
  }
  if (shape >= 2) {
    out += R"(,"timestamp":)";
    append_integer(out, alarm.stamp_s);
  }
  out += '}';
}

// The copy that fleet manager reports carry beside the flat arrays.
void append_nested_alarm(std::string& out, const ActiveAlarm& alarm) {
  out += R"({"code":)";
  append_integer(out, alarm.code);
  out += R"(,"desc":)";
  append_quoted(out, description(alarm));
  out += R"(,"times":)";
  append_integer(out, alarm.times);
  out += R"(,"timestamp":)";
  append_integer(out, alarm.stamp_s);
  out += '}';
}

void append_solution(std::string& out, const ActiveAlarm& alarm) {
  out += "{\"";
  append_integer(out, alarm.code);
  out += R"(":{"describe":)";
  append_quoted(out, description(alarm));
  out += R"(,"method":"Look at the robot and its surroundings.","reason":""}})";
}

template <class Append>
void append_level(std::string& out, const Moment& m, AlarmLevel level, Append append) {
  bool first = true;
  for (const ActiveAlarm& alarm : m.state.alarms) {
    if (alarm.level == level) {
      out += first ? "" : ",";
      append(alarm);
      first = false;
    }
  }
}

template <AlarmLevel level>
void flat_alarms(std::string& out, const Moment& m) {
  append_level(out, m, level, [&](const ActiveAlarm& alarm) { append_alarm(out, alarm, m.scenario.alarm_shape); });
}
template <AlarmLevel level>
void nested_alarms(std::string& out, const Moment& m) {
  append_level(out, m, level, [&](const ActiveAlarm& alarm) { append_nested_alarm(out, alarm); });
}
template <AlarmLevel level>
void solutions(std::string& out, const Moment& m) {
  append_level(out, m, level, [&](const ActiveAlarm& alarm) { append_solution(out, alarm); });
}

struct Slot {
  std::string_view name;
  SlotWriter write;
};

constexpr Slot kSlots[] = {
    {"DI", append_inputs},
    {"DO", append_outputs},
    {"create_on", [](std::string& out, const Moment& m) { append_create_on(out, m.readings.clock); }},
    {"current_station", [](std::string& out, const Moment& m) { out += m.state.current_station; }},
    {"errors", flat_alarms<AlarmLevel::error>},
    {"errors_nested", nested_alarms<AlarmLevel::error>},
    {"errors_solution", solutions<AlarmLevel::error>},
    {"fatals", flat_alarms<AlarmLevel::fatal>},
    {"fatals_nested", nested_alarms<AlarmLevel::fatal>},
    {"fatals_solution", solutions<AlarmLevel::fatal>},
    {"finished", finished},
    {"imu_nsec", imu_nsec},
    {"ip", [](std::string& out, const Moment& m) { append_escaped(out, m.scenario.ip); }},
    {"lasers", lasers},
    {"last_station", [](std::string& out, const Moment& m) { out += m.state.last_station; }},
    {"mac", [](std::string& out, const Moment& m) { out += m.identity.mac; }},
    {"map", [](std::string& out, const Moment& m) { append_escaped(out, m.scenario.map); }},
    {"map_md5", [](std::string& out, const Moment& m) { out += m.identity.map_md5; }},
    {"model_md5", [](std::string& out, const Moment& m) { out += m.identity.model_md5; }},
    {"motor_info", motor_info},
    {"nearest_obstacle", nearest_obstacle},
    {"notices", flat_alarms<AlarmLevel::notice>},
    {"notices_nested", nested_alarms<AlarmLevel::notice>},
    {"notices_solution", solutions<AlarmLevel::notice>},
    {"robot_region", robot_region},
    {"steer", steer},
    {"target_point", target_point},
    {"target_station", [](std::string& out, const Moment& m) { out += m.state.target_station; }},
    {"unfinished", unfinished},
    {"vehicle_id", [](std::string& out, const Moment& m) { append_escaped(out, m.scenario.name); }},
    {"warnings", flat_alarms<AlarmLevel::warning>},
    {"warnings_nested", nested_alarms<AlarmLevel::warning>},
    {"warnings_solution", solutions<AlarmLevel::warning>},
};

}  // namespace

Identity make_identity(const Scenario& scenario) {
  Identity identity;
  identity.mac = "02" + hex_of("mac " + scenario.name, 10);
  for (char& c : identity.mac) {
    c = c >= 'a' ? static_cast<char>(c - 'a' + 'A') : c;
  }
  identity.model_md5 = hex_of("model", 32);
  identity.map_md5 = hex_of("map " + scenario.map, 32);
  return identity;
}

SlotWriter slot_writer(std::string_view name) {
  for (const Slot& slot : kSlots) {
    if (slot.name == name) {
      return slot.write;
    }
  }
  assert(false && "no such slot");
  return nullptr;
}

}  // namespace tacho::sim
