// Profile S, as schema/README.md has it key by key, is what the simulator really does.

#include <array>
#include <charconv>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "samples/simulator/answers.hpp"
#include "samples/simulator/robot.hpp"
#include "tests/support/golden.hpp"

namespace sim = tacho::sim;
using Json = nlohmann::ordered_json;
using tacho::Micros;

namespace {

constexpr Micros kStart = 1'767'225'600'000'000;
constexpr Micros kSecond = 1'000'000;

template <class Real>
std::string shortest(Real value) {
  std::array<char, 40> text{};
  return {text.data(), std::to_chars(text.data(), text.data() + text.size(), value).ptr};
}

/// How often a value differs from that of the answer a second before.
struct Changes {
  int pairs = 0;
  int changed = 0;
  [[nodiscard]] std::string words() const {
    const double share = pairs == 0 ? 0 : static_cast<double>(changed) / pairs;
    return changed == 0 ? "-" : share < 0.1 ? "seldom" : share < 0.9 ? "often" : "always";
  }
};

struct Value {
  bool number = false;
  bool text = false;
  bool list = false;
  bool flag = false;
  bool single = true;  ///< each number is the shortest text of a float
  std::size_t decimals = 0;
  std::size_t digits = 0;
  Changes moving;
  Changes parked;

  void look(const Json& value) {
    flag = flag || value.is_boolean();
    text = text || value.is_string();
    list = list || value.is_structured();
    if (value.is_number()) {
      number = true;
      const auto real = value.get<double>();
      const std::string printed = shortest(real);
      const std::string mantissa = printed.substr(0, printed.find('e'));
      const std::size_t point = mantissa.find('.');
      decimals = std::max(decimals, point == std::string::npos ? 0 : mantissa.size() - point - 1);
      const std::size_t first = std::min(mantissa.find_first_of("123456789"), mantissa.size());
      digits = std::max(digits, mantissa.size() - first - (point != std::string::npos && point > first ? 1 : 0));
      single = single && shortest(static_cast<float>(real)) == printed;
    }
  }
  [[nodiscard]] bool is_double() const { return number && decimals > 0 && digits >= 15; }
  [[nodiscard]] bool is_float() const { return number && decimals > 4 && digits >= 7 && single; }
  [[nodiscard]] std::string kind() const {
    return list           ? "list"
           : text         ? "text"
           : flag         ? "flag"
           : is_double()  ? "double, all digits"
           : is_float()   ? "float, all digits"
           : decimals > 0 ? std::to_string(decimals) + " decimals"
                          : "integer";
  }
};

using Values = std::map<std::string, Value>;

/// Leaves by path; elements of arrays are numbered, but for arrays that come and go as a whole.
void leaves(const Json& value, const std::string& path, std::map<std::string, Json>& out) {
  static const std::set<std::string> kWhole{"DI",       "DO",           "errors",        "fatals",         "notices",
                                            "warnings", "target_point", "finished_path", "unfinished_path"};
  if (value.is_object() && !value.empty()) {
    for (const auto& [key, member] : value.items()) {
      leaves(member, path.empty() ? key : path + "." + key, out);
    }
  } else if (value.is_array() && !value.empty() && kWhole.count(path) == 0) {
    for (std::size_t i = 0; i < value.size(); ++i) {
      leaves(value[i], path + "[" + std::to_string(i) + "]", out);
    }
  } else {
    out[path] = value;
  }
}

/// Two hours of a busy day, two answers a second apart every ten seconds.
Values observed() {
  const sim::Scenario scenario = sim::busy_day(1);
  sim::Robot robot(scenario, kStart);
  sim::AnswerMaker maker(scenario);
  Values values;
  for (int step = 0; step < 720; ++step) {
    const Micros t = kStart + step * 10 * kSecond;
    std::map<std::string, Json> before;
    const bool stood = robot.at(t).is_stop;
    leaves(Json::parse(maker.status(robot.at(t))), "", before);
    const sim::RobotState& state = robot.at(t + kSecond);
    const bool stands = state.is_stop;
    std::map<std::string, Json> after;
    leaves(Json::parse(maker.status(state)), "", after);
    for (const auto& [path, value] : after) {
      Value& known = values[path];
      known.look(value);
      const auto old = before.find(path);
      if (stood == stands && old != before.end()) {
        Changes& changes = stands ? known.parked : known.moving;
        ++changes.pairs;
        changes.changed += old->second == value ? 0 : 1;
      }
    }
  }
  return values;
}

std::string profile_text(const Values& values) {
  std::size_t doubles = 0;
  std::size_t floats = 0;
  std::size_t still = 0;
  std::map<std::string, std::vector<std::string>> rows;  // by what is said about them
  for (const auto& [path, value] : values) {
    if (value.moving.changed == 0 && value.parked.changed == 0) {
      ++still;
      continue;
    }
    doubles += value.is_double() ? 1U : 0U;
    floats += value.is_float() ? 1U : 0U;
    rows["| " + value.kind() + " | " + value.moving.words() + " | " + value.parked.words() + " |"].push_back(path);
  }
  std::string text = "Of the values of a status answer " + std::to_string(doubles) + " doubles and " +
                     std::to_string(floats) + " floats with all their digits change, " + std::to_string(still) +
                     " values of any kind never do:\n\n| keys | printed as | moving | parked |\n|---|---|---|---|\n";
  for (const auto& [said, paths] : rows) {
    std::string keys;
    for (const std::string& path : paths) {
      keys += (keys.empty() ? "`" : ", `") + path + "`";
    }
    text += "| " + keys + " " + said + "\n";
  }
  return text;
}

}  // namespace

TEST_CASE("profile S in schema/README.md is what a simulated robot's answers do, key by key") {
  const std::string begin = "<!-- what changes: written by tests/samples/profile_test.cpp -->\n";
  const std::string end = "<!-- end -->\n";
  std::string readme = tacho::test::read_file(std::filesystem::path(TACHO_SOURCE_DIR) / "schema/README.md");
  const std::size_t from = readme.find(begin);
  const std::size_t to = readme.find(end);
  REQUIRE(from != std::string::npos);
  REQUIRE(to != std::string::npos);
  readme.replace(from + begin.size(), to - from - begin.size(), profile_text(observed()));
  tacho::test::check_golden("schema/README.md", readme);
}

TEST_CASE("the full-precision numbers that change are those of the real answer") {
  const std::set<std::string> doubles_of_the_real_answer{"acc_x",
                                                         "acc_y",
                                                         "acc_z",
                                                         "motor_steer_angles[0].value",
                                                         "nearest_obstacles[0].x",
                                                         "nearest_obstacles[0].y",
                                                         "pitch",
                                                         "qw",
                                                         "qx",
                                                         "qy",
                                                         "qz",
                                                         "robot_region.point[0].x",
                                                         "robot_region.point[0].y",
                                                         "robot_region.point[1].x",
                                                         "robot_region.point[1].y",
                                                         "robot_region.point[2].x",
                                                         "robot_region.point[2].y",
                                                         "robot_region.point[3].x",
                                                         "robot_region.point[3].y",
                                                         "roll",
                                                         "rot_x",
                                                         "rot_y",
                                                         "rot_z",
                                                         "yaw"};
  std::set<std::string> doubles;
  std::size_t floats = 0;
  for (const auto& [path, value] : observed()) {
    if (value.moving.changed > 0 && value.is_double()) {
      doubles.insert(path);
    }
    floats += value.moving.changed > 0 && value.is_float() ? 1U : 0U;
  }
  CHECK(doubles == doubles_of_the_real_answer);
  CHECK(floats == 6);
}
