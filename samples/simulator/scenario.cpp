#include "samples/simulator/scenario.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <variant>

#include "schema/error.hpp"
#include "schema/text.hpp"

namespace tacho::sim {
namespace {

using Json = nlohmann::ordered_json;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// One key of a scenario file: where its value goes and what it may be.
template <class Object>
struct Key {
  std::string_view name;
  std::variant<double Object::*, int Object::*, bool Object::*, std::string Object::*, std::uint64_t Object::*,
               std::int64_t Object::*, WordOrder Object::*, AlarmLevel Object::*, std::optional<Port> Object::*>
      member;
  double min = -kInfinity;
  double max = kInfinity;
};

constexpr double kAboveZero = std::numeric_limits<double>::min();

// clang-format off
const std::vector<Key<Scenario>>& keys(const Scenario*) {
  static const std::vector<Key<Scenario>> rows{
      {"name", &Scenario::name},
      {"seed", &Scenario::seed},
      {"map", &Scenario::map},
      {"cruise_mps", &Scenario::cruise_mps, 0.05, 5},
      {"accel_mps2", &Scenario::accel_mps2, 0.05, 5},
      {"turn_radps", &Scenario::turn_radps, 0.05, 6},
      {"wait_s", &Scenario::wait_s, 0, 1e6},
      {"always_idle", &Scenario::always_idle},
      {"odo_scale", &Scenario::odo_scale, kAboveZero},
      {"twist_scale", &Scenario::twist_scale, kAboveZero},
      {"angular_scale", &Scenario::angular_scale, kAboveZero},
      {"pose_sigma_m", &Scenario::pose_sigma_m, 0},
      {"heading_sigma_rad", &Scenario::heading_sigma_rad, 0},
      {"odo_start_m", &Scenario::odo_start_m},
      {"slips_per_km", &Scenario::slips_per_km, 0},
      {"slip_m", &Scenario::slip_m, 0},
      {"jumps_per_hour", &Scenario::jumps_per_hour, 0},
      {"jump_m", &Scenario::jump_m},
      {"capacity_ah", &Scenario::capacity_ah, 1},
      {"nominal_voltage", &Scenario::nominal_voltage, kAboveZero},
      {"soc_start", &Scenario::soc_start, 0.02, 1},
      {"charge_below", &Scenario::charge_below, 0.02, 0.95},
      {"charge_until", &Scenario::charge_until, 0.05, 0.999},
      {"charge_current_a", &Scenario::charge_current_a, kAboveZero},
      {"fade_per_efc", &Scenario::fade_per_efc, 0, 1},
      {"current_noise_a", &Scenario::current_noise_a, 0},
      {"internal_resistance_ohm", &Scenario::internal_resistance_ohm, 0},
      {"resistance_growth_per_day", &Scenario::resistance_growth_per_day},
      {"soc_step", &Scenario::soc_step, kAboveZero, 1},
      {"cycle_share", &Scenario::cycle_share, 0},
      {"blocks_per_km", &Scenario::blocks_per_km, 0},
      {"slowed_per_km", &Scenario::slowed_per_km, 0},
      {"alarm_shape", &Scenario::alarm_shape, 0, 3},
      {"word_order", &Scenario::word_order},
      {"registers_rounded", &Scenario::registers_rounded},
      {"battery_fields", &Scenario::battery_fields},
      {"ignores_keys", &Scenario::ignores_keys},
      {"clock_offset_s", &Scenario::clock_offset_s, -1e9, 1e9},
      {"clock_drift_ppm", &Scenario::clock_drift_ppm, -1e5, 1e5},
      {"clock_step_s", &Scenario::clock_step_s, -1e9, 1e9},
      {"clock_step_at_s", &Scenario::clock_step_at_s, 0, 1e9},
      {"clock_frozen_from_s", &Scenario::clock_frozen_from_s, 0, 1e9},
      {"clock_frozen_s", &Scenario::clock_frozen_s, 0, 1e9},
      {"ip", &Scenario::ip},
      {"modbus_unit", &Scenario::modbus_unit, -1, 247},
      {"body_file", &Scenario::body_file},
      {"io_body_file", &Scenario::io_body_file},
  };
  return rows;
}
const std::vector<Key<AlarmSpec>>& keys(const AlarmSpec*) {
  static const std::vector<Key<AlarmSpec>> rows{
      {"level", &AlarmSpec::level},
      {"code", &AlarmSpec::code, 0, 65535},
      {"per_hour", &AlarmSpec::per_hour, 0},
      {"mean_duration_s", &AlarmSpec::mean_duration_s, 0},
      {"min_duration_s", &AlarmSpec::min_duration_s, 0},
      {"stops_robot", &AlarmSpec::stops_robot},
      {"desc", &AlarmSpec::desc},
      {"min_gap_s", &AlarmSpec::min_gap_s, 0},
  };
  return rows;
}
const std::vector<Key<HotSpot>>& keys(const HotSpot*) {
  static const std::vector<Key<HotSpot>> rows{
      {"x_m", &HotSpot::x_m},
      {"y_m", &HotSpot::y_m},
      {"radius_m", &HotSpot::radius_m, kAboveZero},
      {"probability", &HotSpot::probability, 0, 1},
      {"mean_duration_s", &HotSpot::mean_duration_s, 0},
      {"reason", &HotSpot::reason, 0, 10},
  };
  return rows;
}
const std::vector<Key<FaultWindow>>& keys(const FaultWindow*) {
  static const std::vector<Key<FaultWindow>> rows{
      {"fault", &FaultWindow::fault},
      {"port", &FaultWindow::port},
      {"from_s", &FaultWindow::from_s, 0},
      {"to_s", &FaultWindow::to_s, 0},
  };
  return rows;
}
// clang-format on

// Says where a problem is: file, and the path of keys to it.
struct Place {
  std::string file;
  std::string key;
  [[nodiscard]] Place at(const std::string& child) const { return {file, key.empty() ? child : key + "." + child}; }
  [[noreturn]] void fail(const std::string& cause, const std::string& remedy = {}) const {
    throw Error(key.empty() ? file : file + ": " + key, cause, remedy);
  }
};

void expect(bool ok, const Place& place, const Json& value, std::string_view wanted) {
  if (!ok) {
    place.fail("must be " + std::string(wanted) + ", not " + value.type_name() + " " + value.dump());
  }
}

template <class Names, class Value>
void read_name(const Place& place, const Json& value, Names names, Value& out) {
  expect(value.is_string(), place, value, "a name");
  std::vector<std::string> known;
  for (int i = 0; i < 4; ++i) {
    known.emplace_back(names(static_cast<Value>(i)));
    if (known.back() == value.get<std::string>()) {
      out = static_cast<Value>(i);
      return;
    }
  }
  place.fail("no such value: " + value.dump(),
             "one of " + known[0] + ", " + known[1] + ", " + known[2] + ", " + known[3]);
}

void read(const Place& place, const Json& value, double& out) {
  expect(value.is_number(), place, value, "a number");
  out = value.get<double>();
}
void read(const Place& place, const Json& value, bool& out) {
  expect(value.is_boolean(), place, value, "true or false");
  out = value.get<bool>();
}
void read(const Place& place, const Json& value, std::string& out) {
  expect(value.is_string(), place, value, "a text");
  out = value.get<std::string>();
}
void read(const Place& place, const Json& value, int& out) {
  expect(value.is_number_integer(), place, value, "a whole number");
  out = value.get<int>();
}
void read(const Place& place, const Json& value, std::int64_t& out) {
  expect(value.is_number_integer(), place, value, "a whole number");
  out = value.get<std::int64_t>();
}
void read(const Place& place, const Json& value, std::uint64_t& out) {
  expect(value.is_number_unsigned(), place, value, "a whole number from 0");
  out = value.get<std::uint64_t>();
}
void read(const Place& place, const Json& value, WordOrder& out) { read_name(place, value, word_order_name, out); }
void read(const Place& place, const Json& value, AlarmLevel& out) { read_name(place, value, alarm_level_name, out); }

void read(const Place& place, const Json& value, std::optional<Port>& out) {
  for (const Port port : kPorts) {
    if (value.is_string() && value.get<std::string>() == port_name(port)) {
      out = port;
      return;
    }
  }
  place.fail("no such port: " + value.dump(), "one of status, modbus");
}

template <class Object>
void read_object(const Place& place, const Json& json, Object& out);

template <class Object>
void read_list(const Place& place, const Json& json, std::vector<Object>& out) {
  expect(json.is_array(), place, json, "an array of objects");
  for (std::size_t i = 0; i < json.size(); ++i) {
    read_object(Place{place.file, fmt::format("{}[{}]", place.key, i)}, json[i], out.emplace_back());
  }
}

// True when `name` is one of the lists of a scenario.
bool read_lists(const Place& place, const std::string& name, const Json& value, Scenario& out) {
  if (name == "alarms") {
    read_list(place, value, out.alarms);
  } else if (name == "hot_spots") {
    read_list(place, value, out.hot_spots);
  } else if (name == "link_faults") {
    read_list(place, value, out.link_faults);
  } else {
    return false;
  }
  return true;
}
template <class Object>
bool read_lists(const Place&, const std::string&, const Json&, Object&) {
  return false;
}

template <class Object>
void read_key(const Place& place, const Key<Object>& key, const Json& value, Object& out) {
  std::visit([&](auto member) { read(place, value, out.*member); }, key.member);
  if (value.is_number() && !(value.get<double>() >= key.min && value.get<double>() <= key.max)) {
    std::string range = key.min == kAboveZero ? "above 0" : "at least " + Json(key.min).dump();
    range += key.max < kInfinity ? " and at most " + Json(key.max).dump() : "";
    place.fail("is " + value.dump(), "must be " + range);
  }
}

template <class Object>
void read_object(const Place& place, const Json& json, Object& out) {
  expect(json.is_object(), place, json, "an object");
  const auto& rows = keys(&out);
  for (const auto& [name, value] : json.items()) {
    const auto row = std::find_if(rows.begin(), rows.end(), [&n = name](const auto& r) { return r.name == n; });
    if (row != rows.end()) {
      read_key(place.at(name), *row, value, out);
      continue;
    }
    if (read_lists(place.at(name), name, value, out)) {
      continue;
    }
    std::vector<std::string> known{"alarms", "hot_spots", "link_faults"};
    for (const auto& r : rows) {
      known.emplace_back(r.name);
    }
    place.fail("unknown key '" + name + "'" + did_you_mean(name, known));
  }
}

void check(const Place& place, const Scenario& scenario) {
  if (scenario.charge_until <= scenario.charge_below) {
    place.at("charge_until").fail("is not above charge_below", "a robot could never leave its charger");
  }
  for (std::size_t i = 0; i < scenario.link_faults.size(); ++i) {
    const Place window = place.at(fmt::format("link_faults[{}]", i));
    check_fault_window(scenario.link_faults[i], window.file + ": " + window.key);
  }
  if (scenario.name.empty()) {
    place.at("name").fail("is empty", "give the robot a name");
  }
}

void resolve(std::string& path, const std::filesystem::path& folder) {
  if (!path.empty()) {
    path = (folder / path).lexically_normal().string();
  }
}

}  // namespace

std::vector<Scenario> load_scenarios(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  if (!in) {
    throw Error("cannot open scenario " + file.string(), std::strerror(errno), "");
  }
  Json json;
  try {
    json = Json::parse(in, nullptr, true, true);
  } catch (const Json::exception& e) {
    throw Error(file.string() + " is not JSON", e.what(), "");
  }
  std::vector<Scenario> scenarios;
  const bool many = json.is_array();
  for (std::size_t i = 0; i < (many ? json.size() : 1); ++i) {
    const Place place{file.string(), many ? fmt::format("[{}]", i) : ""};
    Scenario& scenario = scenarios.emplace_back();
    read_object(place, many ? json[i] : json, scenario);
    check(place, scenario);
    resolve(scenario.body_file, file.parent_path());
    resolve(scenario.io_body_file, file.parent_path());
  }
  if (scenarios.empty()) {
    throw Error(file.string(), "holds no scenario", "write one object, or an array of objects");
  }
  return scenarios;
}

Scenario busy_day(std::uint64_t seed) {
  Scenario s;
  s.name = "amr-" + std::to_string(seed);
  s.seed = seed;
  s.cycle_share = 0.9;
  s.blocks_per_km = 0.3;
  s.slowed_per_km = 1.0;
  s.hot_spots = {{24.0, 2.0, 1.5, 0.15, 14.0, 1}, {38.0, 10.0, 1.0, 0.08, 9.0, 6}};
  s.alarms = {
      {AlarmLevel::error, 52200, 0.3, 60.0, 5.0, true, "robot can not find path to target", 30.0},
      {AlarmLevel::warning, 54018, 1.0, 30.0, 3.0, false, "no reflector estimate", 30.0},
      {AlarmLevel::notice, 57002, 0.5, 120.0, 10.0, false, "battery will be empty soon", 30.0},
      {AlarmLevel::fatal, 50102, 0.02, 300.0, 60.0, true, "laser data lost", 60.0},
      {AlarmLevel::error, 54004, 0.05, 90.0, 10.0, true, "motor emergency stop", 60.0},
  };
  return s;
}

}  // namespace tacho::sim
