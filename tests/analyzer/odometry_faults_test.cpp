#include <algorithm>
#include <cmath>

#include "analyzer/report/text.hpp"
#include "tests/analyzer/odometry_support.hpp"

using namespace tacho;
using namespace tacho::test;

namespace {

PaperRobot robot_of(double hours) {
  PaperRobot robot;
  robot.hours = hours;
  return robot;
}

/// Everything a Section says, as text.
std::string dump(const Section& s) {
  std::string out;
  const auto quantity_text = [](const Quantity& q) {
    const auto part = [](std::optional<double> v) { return v ? report::exact(*v) : std::string("-"); };
    return part(q.value) + " " + part(q.lo) + " " + part(q.hi) + " " + q.reason;
  };
  for (const std::string& note : s.notes) {
    out += note + "\n";
  }
  for (const Finding& f : s.findings) {
    out += f.id + " " + std::string(verdict_name(f.verdict)) + " " + quantity_text(f.value) + " " + f.advice + "\n";
  }
  const auto value_text = [&](const Value& value) -> std::string {
    if (const auto* q = std::get_if<Quantity>(&value)) {
      return quantity_text(*q);
    }
    if (const auto* d = std::get_if<double>(&value)) {
      return report::exact(*d);
    }
    if (const auto* n = std::get_if<std::int64_t>(&value)) {
      return std::to_string(*n);
    }
    if (const auto* t = std::get_if<Time>(&value)) {
      return std::to_string(t->us);
    }
    const auto* words = std::get_if<std::string>(&value);
    return words != nullptr ? *words : "-";
  };
  for (const DataTable& t : s.tables) {
    for (const auto& row : t.rows) {
      out += t.name;
      for (const Value& value : row) {
        out += "|" + value_text(value);
      }
      out += "\n";
    }
  }
  return out;
}

/// A log of one hour in which the pose is off by (0.5, 0.2, 4 deg) from 1800 s on; `extra` may explain it.
Section with_jump(const std::function<void(PaperAnswer&)>& extra) {
  PaperLog log = status_log(robot_of(1.0), [extra](PaperAnswer& a) {
    if (a.t_s >= 1800.0) {
      a.x += 0.5;
      a.y += 0.2;
    }
    if (extra) {
      extra(a);
    }
  });
  return run_odometry(log);
}

bool near_jump(const PaperAnswer& a) { return std::abs(a.t_s - 1800.0) < 1.5; }

}  // namespace

TEST_CASE("a localisation jump is found once, with its vector, its time and no cause") {
  const Section s = with_jump({});
  REQUIRE(table(s, "jumps").rows.size() == 1);
  CHECK(number(s, "jumps", "dx_m") == Approx(0.5).margin(0.2));
  CHECK(number(s, "jumps", "dy_m") == Approx(0.2).margin(0.2));
  CHECK(text(s, "jumps", "cause") == "unexplained");
  const Finding& f = finding(s, "LOC-02");
  CHECK(f.verdict == Verdict::warn);
  REQUIRE(f.evidence.size() == 1);
  CHECK(f.evidence[0].to_us == Approx(1'767'225'600e6 + 1800e6).margin(1.1e6));
  CHECK(holds(f.value, 1.0 / *f.value.exposure));
  // The jump is no path and no drift.
  CHECK(holds(quantity(s, "scales", "s_o"), 1.0));
}

TEST_CASE("a localisation jump gets the cause that the log shows") {
  CHECK(text(with_jump([](PaperAnswer& a) {
               if (a.t_s >= 1800.0) {
                 a.map = "hall 2";
               }
             }),
             "jumps", "cause") == "map");
  CHECK(text(with_jump([](PaperAnswer& a) {
               if (near_jump(a)) {
                 a.reloc = 2;
               }
               if (std::abs(a.t_s - 1800.0) < 30.0) {  // stands while it is relocalised
                 a.odo = 30000.0;
                 a.vx = a.w = 0.0;
               } else if (a.t_s > 1800.0) {
                 a.odo += 20000.0;
               }
               if (std::abs(a.t_s - 1800.0) < 30.0) {
                 a.x = a.t_s >= 1800.0 ? 3.5 : 3.0;
                 a.y = 0.0;
                 a.angle = 0.0;
               }
             }),
             "jumps", "cause", 1) == "localisation");
  CHECK(text(with_jump([](PaperAnswer& a) { a.loc_method = a.t_s >= 1800.0 ? 1 : 0; }), "jumps", "cause") == "method");
  CHECK(text(with_jump([](PaperAnswer& a) { a.confidence = near_jump(a) ? 0.55 : 0.95; }), "jumps", "cause") ==
        "confidence");
}

TEST_CASE("at 2 s the row next to a jump explains it, whatever the jitter") {
  for (const double jitter_s : {0.0, 0.1}) {
    for (const std::uint64_t seed : {1U, 2U, 3U}) {
      PaperRobot robot = robot_of(1.0);
      robot.seed = seed;
      const auto edit = [](PaperAnswer& a) {
        a.x += a.t_s >= 1800.0 ? 3.0 : 0.0;
        a.confidence = a.t_s >= 1802.0 && a.t_s < 1804.0 ? 0.55 : 0.95;  // one poll later
      };
      PaperLog log(robot, {{Source::status, 2.0, 0.0, edit, jitter_s}});
      const Section s = run_odometry(log);
      INFO(jitter_s << " " << seed);
      REQUIRE(table(s, "jumps").rows.size() == 1);
      CHECK(text(s, "jumps", "cause") == "confidence");
    }
  }
}

TEST_CASE("jumps at many places fail") {
  PaperLog log = status_log(robot_of(4.0), [](PaperAnswer& a) { a.x += 0.4 * std::floor(a.t_s / 600.0); });
  const Section s = run_odometry(log);
  CHECK(finding(s, "LOC-02").verdict == Verdict::fail);
  CHECK(table(s, "jumps").rows.size() == 23);
}

TEST_CASE("jumps fail also where polling is too slow to see most of them") {
  const auto edit = [](PaperAnswer& a) { a.x += 2.0 * std::floor(a.t_s / 600.0); };
  PaperLog log(robot_of(4.0), {{Source::status, 2.0, 0.0, edit}});
  const Finding f = finding(run_odometry(log), "LOC-02");
  CHECK(f.verdict == Verdict::fail);
  CHECK_FALSE(f.value.value.has_value());
  CHECK(f.value.reason.find("would have shown on 0 of") != std::string::npos);
  CHECK_FALSE(f.evidence.empty());
}

TEST_CASE("odometry mode is left out of every pose measure") {
  PaperLog log = status_log(robot_of(0.5), [](PaperAnswer& a) { a.loc_method = 3; });
  const Section s = run_odometry(log);
  CHECK(finding(s, "ODO-03").verdict == Verdict::unknown);
  CHECK(finding(s, "ODO-07").verdict == Verdict::unknown);
  CHECK(text(s, "tags", "tag") == "odometry_mode");
  CHECK(number(s, "tags", "hours") == Approx(0.5).epsilon(0.01));
}

TEST_CASE("a reboot and a fallen counter cut segments and are listed, and the counter's fall is a warning") {
  PaperLog log = status_log(robot_of(1.0), [](PaperAnswer& a) {
    a.uptime_s -= a.t_s > 1000.0 ? 1900.0 : 0.0;
    a.odo -= a.t_s > 2000.0 ? 21000.0 : 0.0;
  });
  const Section s = run_odometry(log);
  REQUIRE(table(s, "segments").rows.size() == 3);
  CHECK(text(s, "segments", "begins_with", 0) == "start");
  CHECK(text(s, "segments", "begins_with", 1) == "reboot");
  CHECK(text(s, "segments", "begins_with", 2) == "counter");
  const Finding& f = finding(s, "ODO-01");
  CHECK(f.verdict == Verdict::warn);
  CHECK(f.evidence.size() == 1);
  CHECK(number(s, "counter", "falls") == 1);
  CHECK(text(s, "counter_events", "what") == "fall");
  CHECK(holds(quantity(s, "scales", "s_o"), 1.0));
  CHECK(holds(quantity(s, "scales", "g"), 1.0));
}

TEST_CASE("a counter that jumps or sticks fails, and its metres spoil no scale") {
  PaperLog jumping = status_log(robot_of(1.0), [](PaperAnswer& a) { a.odo += a.t_s > 1000.0 ? 500.0 : 0.0; });
  Section s = run_odometry(jumping);
  CHECK(finding(s, "ODO-01").verdict == Verdict::fail);
  CHECK(text(s, "counter_events", "what") == "jump");
  CHECK(holds(quantity(s, "scales", "s_o"), 1.0));
  CHECK(holds(quantity(s, "scales", "g"), 1.0));

  double held = 0.0;
  PaperLog stuck = status_log(robot_of(1.0), [&held](PaperAnswer& a) {
    held = a.t_s < 1000.0 ? a.odo : held;
    a.odo = a.t_s < 1100.0 ? std::min(a.odo, held) : a.odo;
  });
  s = run_odometry(stuck);
  CHECK(finding(s, "ODO-01").verdict == Verdict::fail);
  CHECK(number(s, "counter", "stuck") == 1);
}

TEST_CASE("repeated answers change nothing but their own count") {
  PaperAnswer last;
  int n = 0;
  const PaperRobot robot = robot_of(0.5);
  PaperLog plain = status_log(robot, {}, 1.0);
  // Every answer of a poll at 2 Hz that falls between two seconds repeats the uptime of the one before.
  PaperLog doubled = status_log(
      robot,
      [&](PaperAnswer& a) {
        if (n++ % 2 == 1) {
          const double t = a.t_s;
          a = last;
          a.t_s = t;
        }
        last = a;
      },
      0.5);
  const Section once = run_odometry(plain);
  const Section twice = run_odometry(doubled);
  CHECK(number(twice, "counter", "repeated") == 1800);
  CHECK(number(twice, "counter", "rows") == number(once, "counter", "rows"));
  CHECK(number(twice, "counter", "counted_m") == Approx(number(once, "counter", "counted_m")).epsilon(1e-4));
}

TEST_CASE("the robot's midnight and its time zone come from today_odo") {
  double at_midnight = 0.0;
  PaperLog log = status_log(robot_of(14.0), [&at_midnight](PaperAnswer& a) {
    at_midnight = a.t_s < 11 * 3600.0 ? a.odo : at_midnight;
    a.today_odo = a.t_s < 11 * 3600.0 ? a.today_odo : a.odo - at_midnight;
  });
  const Section s = run_odometry(log);
  // At 11:00 UTC the robot thinks it is midnight: UTC-11, as real ones do.
  CHECK(number(s, "counter", "robot_zone_h") == -11.0);
  CHECK(number(s, "counter", "today_range_m") <= number(s, "counter", "today_allowed_m"));
}

TEST_CASE("cutting the same rows into slices differently changes nothing") {
  PaperRobot robot = robot_of(0.7);
  const auto run = [&](std::size_t slice_rows) {
    PaperLog log(robot,
                 {{Source::status, 1.0, 0.0,
                   [](PaperAnswer& a) {
                     a.x += a.t_s > 900.0 ? 0.6 : 0.0;
                     a.skip = a.t_s > 1200.0 && a.t_s < 1230.0;
                   }},
                  {Source::registers, 0.5, 0.2, {}}},
                 slice_rows);
    return dump(run_odometry(log));
  };
  const std::string whole = run(1'000'000);
  CHECK(whole.size() > 2000);
  CHECK(run(1) == whole);
  CHECK(run(7) == whole);
  CHECK(run(1000) == whole);
}

TEST_CASE("a gap cuts the track and no metre of it is integrated") {
  PaperLog log = status_log(robot_of(1.0), [](PaperAnswer& a) { a.skip = a.t_s > 1000.0 && a.t_s < 1300.0; });
  const Section s = run_odometry(log);
  REQUIRE(table(s, "segments").rows.size() == 2);
  CHECK(text(s, "segments", "begins_with", 1) == "gap");
  CHECK(finding(s, "ODO-01").verdict == Verdict::pass);
  CHECK(holds(quantity(s, "scales", "g"), 1.0));
  CHECK(number(s, "scales", "speed_m") < number(s, "counter", "counted_m"));
}

TEST_CASE("an error that goes on from poll to poll is slip, not a jump") {
  PaperLog log = status_log(
      robot_of(1.0), [](PaperAnswer& a) { a.x += 0.3 * std::clamp(a.t_s - 1800.0, 0.0, 2.7); }, 0.5);
  const Section s = run_odometry(log);
  CHECK(table(s, "jumps").rows.empty());
  CHECK(finding(s, "LOC-02").verdict == Verdict::pass);
  const auto said = [](const std::string& note) { return note.find(" 0 off together") == std::string::npos; };
  CHECK(std::any_of(s.notes.begin(), s.notes.end(), [&](const std::string& note) {
    return note.find("looked at") != std::string::npos && said(note);
  }));
}
