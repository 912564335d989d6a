#include <cmath>

#include "tests/analyzer/odometry_support.hpp"

using namespace tacho;
using namespace tacho::test;

namespace {

using Edit = std::function<void(PaperAnswer&)>;

Section both(double hours, const Edit& registers, const Edit& status = {}, double period_s = 0.2) {
  PaperRobot robot;
  robot.hours = hours;
  robot.odo_start_m = 134766.944;
  PaperLog log(robot, {{Source::status, 0.5, 0.0, status}, {Source::registers, period_s, 0.03, registers}});
  return run_odometry(log);
}

/// Row of the json_modbus table for a quantity.
std::size_t row_of(const Section& s, std::string_view name) {
  const DataTable& t = table(s, "json_modbus");
  for (std::size_t row = 0; row < t.rows.size(); ++row) {
    if (std::get<std::string>(cell(t, "quantity", row)) == name) {
      return row;
    }
  }
  FAIL("not compared: " << name);
  return 0;
}

double outside(const Section& s, std::string_view name) { return number(s, "json_modbus", "outside", row_of(s, name)); }

}  // namespace

TEST_CASE("two sources that say the same agree in every quantity") {
  const Section s = both(2.0, {});
  for (const char* name : {"odo", "today_odo", "x", "y", "angle", "vx", "vy", "w", "battery_level", "total_time",
                           "localisation", "alarms"}) {
    INFO(name);
    CHECK(outside(s, name) == 0);
  }
  const Finding& f = finding(s, "DATA-08");
  CHECK(f.verdict == Verdict::pass);
  CHECK(*f.value.n > 100'000);
  CHECK(text(s, "counter", "kind", 0) == "decimal number");
  CHECK(text(s, "counter", "kind", 1) == "float32");
  CHECK(number(s, "counter", "quantum_m", 1) == 0.015625);
}

TEST_CASE("a short log that agrees is not yet proof") {
  const Finding f = finding(both(0.05, {}), "DATA-08");
  CHECK(f.verdict == Verdict::unknown);
  CHECK(f.value.reason.find("too few comparisons") != std::string::npos);
}

TEST_CASE("registers in the wrong word order are named as such") {
  const Section s = both(0.3, [](PaperAnswer& a) {
    a.odo = 4.6e-41;
    a.x *= 1e20;
    a.vx = 3e-39;
  });
  const Finding& f = finding(s, "DATA-08");
  CHECK(f.verdict == Verdict::fail);
  CHECK(f.advice.find("word order") != std::string::npos);
}

TEST_CASE("one quantity that is off is named, and where") {
  const Section s = both(1.0, [](PaperAnswer& a) { a.y += 0.3; });
  CHECK(outside(s, "y") > 1000);
  CHECK(outside(s, "x") == 0);
  const Finding& f = finding(s, "DATA-08");
  CHECK(f.verdict == Verdict::fail);
  REQUIRE(f.evidence.size() == 1);
  CHECK(f.evidence[0].note.find("y: ") == 0);
}

TEST_CASE("a lagging register cache shows as its lag") {
  std::vector<double> old;
  const Section s = both(
      1.0,
      [&old](PaperAnswer& a) {
        old.push_back(a.odo);
        a.odo = old.size() > 2 ? old[old.size() - 3] : a.odo;  // two polls of 0.2 s ago
      },
      {}, 0.2);
  bool said = false;
  for (const std::string& note : s.notes) {
    const std::size_t at = note.find("the registers are ");
    if (at != std::string::npos) {
      said = true;
      CHECK(std::stod(note.substr(at + 18)) == Approx(400.0).margin(25.0));
    }
  }
  CHECK(said);
}

TEST_CASE("stations: only a register that contradicts JSON is a mismatch") {
  const auto at_station = [](int json, int reg) {
    return both(
        0.2, [reg](PaperAnswer& a) { a.station = reg; }, [json](PaperAnswer& a) { a.station = json; });
  };
  CHECK(outside(at_station(12, 12), "station") == 0);
  CHECK(outside(at_station(12, 13), "station") > 100);
  const Section outer = at_station(0, 13);  // 0.30 m and 0.50 m differ: says nothing
  const DataTable& t = table(outer, "json_modbus");
  for (std::size_t row = 0; row < t.rows.size(); ++row) {
    CHECK(std::get<std::string>(cell(t, "quantity", row)) != "station");
  }
}

TEST_CASE("an alarm code that only the registers have is a mismatch, one poll of delay is not") {
  const auto alarmed = [](double from_json, double from_registers) {
    const auto since = [](double from) {
      return [from](PaperAnswer& a) {
        if (a.t_s >= from && a.t_s < 200.0) {
          a.alarms.push_back(52201);
        }
      };
    };
    return both(0.1, since(from_registers), since(from_json));
  };
  CHECK(outside(alarmed(100.0, 100.0), "alarms") == 0);
  CHECK(outside(alarmed(100.0, 99.6), "alarms") == 0);
  CHECK(outside(alarmed(100.0, 50.0), "alarms") > 50);
}

TEST_CASE("a code that the registers show while JSON holds an alarm that cannot be read is no mismatch") {
  const auto from_50 = [](PaperAnswer& a) {
    if (a.t_s >= 50.0 && a.t_s < 200.0) {
      a.alarms.push_back(52201);
    }
  };
  const auto unreadable = [](PaperAnswer& a) { a.odd_alarm = a.t_s >= 45.0 && a.t_s < 205.0; };
  CHECK(outside(both(0.1, from_50, unreadable), "alarms") == 0);
  CHECK(outside(both(0.1, from_50, {}), "alarms") > 50);
}

TEST_CASE("a robot that only has registers gets its counter and its speed checked, from registers") {
  PaperRobot robot;
  robot.hours = 3.0;
  robot.odo_scale = 1.02;
  PaperLog log(robot, {{Source::registers, 0.5, 0.0, {}}});
  const Section s = run_odometry(log);
  CHECK(text(s, "counter", "source") == "registers");
  CHECK(text(s, "counter", "kind") == "float32");
  CHECK(holds(quantity(s, "scales", "g"), 1.02));
  CHECK(finding(s, "ODO-01").verdict == Verdict::pass);
  CHECK(finding(s, "ODO-02").verdict == Verdict::warn);
  CHECK(s.notes.front().find("from registers") != std::string::npos);
  CHECK(finding(s, "DATA-08").value.reason.find("one source only") != std::string::npos);
}

TEST_CASE("a counter summed in float32 is recognised by its scale") {
  PaperRobot robot;
  robot.hours = 2.0;
  double true_last = 134766.944;
  double rest = 0.0;
  float sum = 134766.944F;
  robot.odo_start_m = true_last;
  PaperLog log(robot, {{Source::registers, 0.5, 0.0, [&](PaperAnswer& a) {
                          for (rest += a.odo - true_last; rest >= 0.010; rest -= 0.010) {
                            sum += 0.010F;
                          }
                          true_last = a.odo;
                          a.odo = static_cast<double>(sum);
                        }}});
  const Section s = run_odometry(log);
  CHECK(*quantity(s, "scales", "g").value == Approx(1.5625).epsilon(0.01));
  bool said = false;
  for (const std::string& note : s.notes) {
    said = said || note.find("float32 sum") != std::string::npos;
  }
  CHECK(said);
}
