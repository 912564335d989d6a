// Scenario files: what they set, and how they complain.

#include "samples/simulator/scenario.hpp"

#include "samples/simulator/robot.hpp"
#include "samples/simulator/robot_clock.hpp"

#include <filesystem>
#include <fstream>

#include "schema/error.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/temp_dir.hpp"

namespace sim = tacho::sim;
using Catch::Matchers::Contains;

namespace {

std::vector<sim::Scenario> load(const std::string& text) {
  const tacho::test::TempDir dir;
  std::ofstream(dir / "s.json") << text;
  return sim::load_scenarios(dir / "s.json");
}

std::string complaint(const std::string& text) {
  try {
    load(text);
  } catch (const tacho::Error& e) {
    return e.what();
  }
  return "no complaint";
}

}  // namespace

TEST_CASE("a scenario sets what it names and leaves the rest") {
  const auto all = load(R"({"name": "a", "seed": 7, "odo_scale": 1.02, "always_idle": true, "word_order": "abcd",
    "alarms": [{"level": "error", "code": 52200, "per_hour": 2, "desc": "x"}], "hot_spots": [{"x_m": 3, "reason": 0}]})");
  REQUIRE(all.size() == 1);
  const sim::Scenario& s = all[0];
  CHECK(s.name == "a");
  CHECK(s.seed == 7);
  CHECK(s.odo_scale == 1.02);
  CHECK(s.always_idle);
  CHECK(s.word_order == tacho::WordOrder::abcd);
  CHECK(s.capacity_ah == sim::Scenario{}.capacity_ah);
  REQUIRE(s.alarms.size() == 1);
  CHECK(s.alarms[0].level == tacho::AlarmLevel::error);
  CHECK(s.alarms[0].code == 52200);
  REQUIRE(s.hot_spots.size() == 1);
  CHECK(s.hot_spots[0].reason == 0);
}

TEST_CASE("an array holds several robots; comments are allowed") {
  const auto all = load("// two\n[{\"name\": \"a\"}, {\"name\": \"b\"}]");
  REQUIRE(all.size() == 2);
  CHECK(all[1].name == "b");
}

TEST_CASE("body files are relative to the scenario") {
  const auto all = load(R"({"body_file": "bodies/real.json", "io_body_file": "/abs/io.json"})");
  CHECK(std::filesystem::path(all[0].body_file).is_absolute());
  CHECK_THAT(all[0].body_file, Contains("bodies/real.json"));
  CHECK(all[0].io_body_file == "/abs/io.json");
}

TEST_CASE("a misspelt key is named, with the one that was meant") {
  CHECK_THAT(complaint(R"({"odo_scal": 1})"),
             Contains("s.json") && Contains("unknown key 'odo_scal'") && Contains("did you mean 'odo_scale'"));
  CHECK_THAT(complaint(R"({"alarms": [{}, {"per_our": 1}]})"),
             Contains("alarms[1]: unknown key 'per_our'") && Contains("did you mean 'per_hour'"));
  CHECK_THAT(complaint(R"({"hotspots": []})"), Contains("did you mean 'hot_spots'"));
}

TEST_CASE("a wrong type is named with its value") {
  CHECK_THAT(complaint(R"({"cruise_mps": "fast"})"),
             Contains("cruise_mps") && Contains("must be a number") && Contains("\"fast\""));
  CHECK_THAT(complaint(R"({"seed": -1})"), Contains("seed") && Contains("whole number from 0"));
  CHECK_THAT(complaint(R"({"always_idle": 1})"), Contains("true or false"));
  CHECK_THAT(complaint(R"({"alarms": {}})"), Contains("array of objects"));
  CHECK_THAT(complaint(R"({"alarms": [3]})"), Contains("alarms[0]") && Contains("an object"));
  CHECK_THAT(complaint(R"({"name": null})"), Contains("name") && Contains("a text"));
}

TEST_CASE("a value out of range or no name of a list is refused") {
  CHECK_THAT(complaint(R"({"capacity_ah": 0})"), Contains("capacity_ah") && Contains("at least 1"));
  CHECK_THAT(complaint(R"({"alarm_shape": 4})"), Contains("at most 3"));
  CHECK_THAT(complaint(R"({"odo_scale": 0})"), Contains("above 0"));
  CHECK_THAT(complaint(R"({"word_order": "acbd"})"), Contains("cdab, abcd, badc, dcba"));
  CHECK_THAT(complaint(R"({"alarms": [{"level": "bad"}]})"), Contains("fatal, error, warning, notice"));
  CHECK_THAT(complaint(R"({"charge_until": 0.3})"), Contains("charge_until") && Contains("charge_below"));
}

TEST_CASE("a file that is missing, empty or no JSON is named") {
  CHECK_THROWS_WITH(sim::load_scenarios("/no/such/file.json"), Contains("/no/such/file.json"));
  CHECK_THAT(complaint(""), Contains("is not JSON"));
  CHECK_THAT(complaint("[]"), Contains("holds no scenario"));
}

TEST_CASE("faults of the ports are read, and mistakes in them are named with their place") {
  const auto faults =
      load(R"({"link_faults": [{"fault": "late"}, {"fault": "silence", "port": "modbus", "from_s": 10, "to_s": 20}]})")
          .at(0)
          .link_faults;
  REQUIRE(faults.size() == 2);
  CHECK_FALSE(faults[0].port);
  CHECK(faults[1].port == sim::Port::modbus);
  CHECK(faults[1].from_s == 10);
  CHECK(faults[1].to_s == 20);
  CHECK_THAT(complaint(R"({"link_faults": [{"fault": "silense"}]})"),
             Contains("link_faults[0]") && Contains("silence"));
  CHECK_THAT(complaint(R"({"link_faults": [{"fault": "late", "port": "tcp"}]})"), Contains("modbus"));
  CHECK_THAT(complaint(R"({"link_faults": [{"fault": "no_json", "port": "modbus"}]})"), Contains("no_json"));
}

TEST_CASE("the robot's clock steps, drifts and stands still when its scenario says so") {
  constexpr tacho::Micros kSecond = 1'000'000;
  sim::Scenario s;
  CHECK(sim::clock_fault_us(s, 100 * kSecond) == 0);
  s.clock_step_s = -3600;
  s.clock_step_at_s = 10;
  CHECK(sim::clock_fault_us(s, 10 * kSecond - 1) == 0);
  CHECK(sim::clock_fault_us(s, 10 * kSecond) == -3600 * kSecond);
  s = {};
  s.clock_drift_ppm = 50;
  CHECK(sim::clock_fault_us(s, 1000 * kSecond) == 50'000);
  s = {};
  s.clock_frozen_from_s = 5;
  s.clock_frozen_s = 20;
  CHECK(sim::clock_fault_us(s, 5 * kSecond) == 0);
  CHECK(sim::clock_fault_us(s, 15 * kSecond) == -10 * kSecond);  // it shows what it showed at 5 s
  CHECK(sim::clock_fault_us(s, 100 * kSecond) == -20 * kSecond);
  const tacho::Micros t0 = 1'767'225'600'000'000;
  sim::Robot robot(s, t0);
  CHECK(robot.at(t0 + 15 * kSecond).clock_fault_us == -10 * kSecond);
}

TEST_CASE("every scenario that is shipped can be loaded") {
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(TACHO_SOURCE_DIR "/samples/scenarios")) {
    if (entry.path().extension() == ".json") {
      INFO(entry.path().string());
      CHECK_NOTHROW(sim::load_scenarios(entry.path()));
      ++files;
    }
  }
  CHECK(files >= 6);
}
