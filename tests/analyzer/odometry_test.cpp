#include "tests/analyzer/odometry_support.hpp"

using namespace tacho;
using namespace tacho::test;

TEST_CASE("one day at 1 Hz gives the odometer's scale to 0.2 % or better, with the truth inside") {
  PaperRobot robot;
  robot.odo_scale = 1.004;
  PaperLog log = status_log(robot);
  const Section s = run_odometry(log);
  const Quantity s_o = quantity(s, "scales", "s_o");
  const Quantity g = quantity(s, "scales", "g");
  CHECK(half_width(s_o) <= 0.002);
  CHECK(half_width(g) <= 0.002);
  CHECK(holds(s_o, 1.0 / 1.004));
  CHECK(holds(g, 1.004));
  CHECK(finding(s, "ODO-01").verdict == Verdict::pass);
  CHECK(finding(s, "ODO-02").verdict == Verdict::pass);
  CHECK(finding(s, "ODO-03").verdict == Verdict::pass);
  CHECK(finding(s, "ODO-07").verdict == Verdict::pass);
  CHECK(finding(s, "LOC-02").verdict == Verdict::pass);
  CHECK(finding(s, "DATA-08").verdict == Verdict::unknown);
  CHECK(text(s, "scales", "counts") == "path of the robot's centre");
  CHECK(text(s, "counter", "kind") == "decimal number");
  CHECK(number(s, "counter", "quantum_m") == 1e-3);
}

TEST_CASE("the 95 % intervals hold the truth in at least 90 % of runs") {
  int path = 0;
  int speed = 0;
  int heading = 0;
  constexpr int kRuns = 24;
  for (int seed = 1; seed <= kRuns; ++seed) {
    PaperRobot robot;
    robot.hours = 1.5;
    robot.seed = static_cast<std::uint64_t>(seed);
    robot.sigma_m = seed % 2 == 0 ? 0.004 : 0.010;
    robot.arc_radius_m = seed % 3 == 0 ? 1.2 : 0.0;
    robot.odo_scale = 0.99 + 0.001 * seed;
    PaperLog log = status_log(robot);
    const Section s = run_odometry(log);
    path += holds(quantity(s, "scales", "s_o"), 1.0 / robot.odo_scale) ? 1 : 0;
    speed += holds(quantity(s, "scales", "g"), robot.odo_scale) ? 1 : 0;
    heading += holds(finding(s, "ODO-07").value, 0.0) ? 1 : 0;
  }
  CHECK(path >= 22);
  CHECK(speed >= 22);
  CHECK(heading >= 22);
}

TEST_CASE("a scale error of 1.5 % is a warning, of 4 % a failure, with the stretches as evidence") {
  PaperRobot robot;
  robot.hours = 6.0;
  robot.odo_scale = 1.015;
  PaperLog log = status_log(robot);
  Section s = run_odometry(log);
  CHECK(finding(s, "ODO-02").verdict == Verdict::warn);
  CHECK(finding(s, "ODO-03").verdict == Verdict::warn);
  CHECK_FALSE(finding(s, "ODO-03").evidence.empty());
  CHECK(finding(s, "ODO-03").threshold_source == "default");

  robot.odo_scale = 1.04;
  PaperLog worse = status_log(robot);
  s = run_odometry(worse);
  CHECK(finding(s, "ODO-02").verdict == Verdict::fail);
  CHECK(finding(s, "ODO-03").verdict == Verdict::fail);
  CHECK(finding(s, "ODO-03").advice.find("0.96") != std::string::npos);

  Settings lenient;
  lenient.set("odometry.scale_pass", 0.06, "site.toml:3");
  s = run_odometry(worse, lenient);
  CHECK(finding(s, "ODO-03").verdict == Verdict::pass);
  CHECK(finding(s, "ODO-03").threshold_source.find("site.toml:3") != std::string::npos);
}

TEST_CASE("an odometer that counts the wheels' paths is recognised, and the scales do not suffer") {
  PaperRobot robot;
  robot.hours = 2.0;
  robot.wheel_track_m = 0.5;
  PaperLog log = status_log(robot, {}, 0.2);
  const Section s = run_odometry(log);
  CHECK(holds(quantity(s, "scales", "b_m_per_rad"), 0.25));
  CHECK(text(s, "scales", "counts").find("wheels") != std::string::npos);
  CHECK(holds(quantity(s, "scales", "s_o"), 1.0));
  CHECK(finding(s, "ODO-02").verdict == Verdict::pass);

  Settings settings;
  settings.set("odometry.track_m", 0.5, "site.toml:1");
  const Section known = run_odometry(log, settings);
  CHECK(text(known, "scales", "counts").find("half the track of 0.5 m") != std::string::npos);
  CHECK(half_width(quantity(known, "scales", "g")) < half_width(quantity(s, "scales", "g")));
}

TEST_CASE("what the counter counts is unknown without turning on the spot") {
  PaperRobot robot;
  robot.hours = 1.0;
  robot.arc_radius_m = 2.0;
  PaperLog log = status_log(robot);
  const Section s = run_odometry(log);
  CHECK_FALSE(quantity(s, "scales", "b_m_per_rad").value.has_value());
  CHECK(text(s, "scales", "counts").find("unknown") == 0);
}

TEST_CASE("a wrong turning rate drifts the heading and fails") {
  PaperRobot robot;
  robot.hours = 4.0;
  PaperLog log = status_log(
      robot, [](PaperAnswer& a) { a.w += a.vx > 0.5 ? 0.017 : 0.0; }, 0.5);
  const Section s = run_odometry(log);
  const Finding& f = finding(s, "ODO-07");
  CHECK(f.verdict == Verdict::fail);
  CHECK(*f.value.value > 5.0);
  CHECK_FALSE(f.evidence.empty());
  CHECK(*quantity(s, "noise", "heading_bias").value > 0.005);
}

TEST_CASE("the drift table holds for a faultless robot only noise and integration") {
  PaperRobot robot;
  robot.hours = 1.0;
  PaperLog log = status_log(robot, {}, 0.1);
  const Section s = run_odometry(log);
  const double sigma = *quantity(s, "noise", "sigma_p_mm").value * 1e-3;
  CHECK(sigma == Approx(0.004).epsilon(0.05));
  CHECK(*quantity(s, "noise", "sigma_theta_mrad").value == Approx(2.0).epsilon(0.05));
  for (std::size_t row = 0; row < 4; ++row) {
    CHECK(std::abs(*quantity(s, "drift", "along_pct", row).value) < 0.2);
    CHECK(std::abs(*quantity(s, "drift", "turn_deg_per_m", row).value) < 0.05);
  }
}

TEST_CASE("a polling period of 10 s decides nothing and says so") {
  PaperRobot robot;
  robot.hours = 24.0;
  PaperLog log = status_log(robot, {}, 10.0);
  const Section s = run_odometry(log);
  for (const char* id : {"ODO-02", "ODO-03", "ODO-07", "LOC-02"}) {
    const Finding& f = finding(s, id);
    INFO(id);
    CHECK(f.verdict == Verdict::unknown);
    CHECK_FALSE(f.value.value.has_value());
    CHECK(f.value.reason.find("period 10 s") != std::string::npos);
  }
  CHECK(finding(s, "ODO-01").verdict == Verdict::pass);
}

TEST_CASE("polls that are 2 s apart by plan decide the same whatever their jitter") {
  for (const double jitter_s : {0.0, 0.002, 0.1, 0.5}) {
    for (const std::uint64_t seed : {1U, 2U}) {
      PaperRobot robot;
      robot.hours = 4.0;
      robot.seed = seed;
      PaperLog log(robot, {{Source::status, 2.0, 0.0, {}, jitter_s}});
      const Section s = run_odometry(log);
      INFO("jitter " << jitter_s << " s, seed " << seed);
      CHECK(finding(s, "ODO-03").verdict == Verdict::pass);
      CHECK(finding(s, "ODO-07").verdict == Verdict::pass);
      CHECK(finding(s, "LOC-02").verdict == Verdict::unknown);
      CHECK(finding(s, "LOC-02").value.reason.find("s: a step of 0.5 m would have shown on") != std::string::npos);
    }
  }
}

TEST_CASE("polls slower than 2 s by more than jitter decide nothing about path, drift and jumps") {
  PaperRobot robot;
  robot.hours = 2.0;
  PaperLog log(robot, {{Source::status, 2.2, 0.0, {}, 0.1}});
  const Section s = run_odometry(log);
  for (const char* id : {"ODO-03", "ODO-07", "LOC-02"}) {
    INFO(id);
    CHECK(finding(s, id).verdict == Verdict::unknown);
    CHECK(finding(s, id).value.reason.find("period 2.2 s") == 0);
  }
}

TEST_CASE("no jump is a PASS only where half a metre would have shown on most of the distance") {
  PaperRobot robot;
  robot.hours = 1.0;
  PaperLog at_1s = status_log(robot);
  PaperLog at_2s = status_log(robot, {}, 2.0);
  const Section fast = run_odometry(at_1s);
  const Section slow = run_odometry(at_2s);
  CHECK(finding(fast, "LOC-02").verdict == Verdict::pass);
  CHECK(*finding(fast, "LOC-02").value.exposure == Approx(number(fast, "counter", "counted_m") / 1000.0).epsilon(0.01));
  const Finding& f = finding(slow, "LOC-02");
  CHECK(f.verdict == Verdict::unknown);
  CHECK(f.value.reason.find("period 2 s: a step of 0.5 m would have shown on 0 of") == 0);
  CHECK(f.advice.find("1 Hz") != std::string::npos);

  Settings coarse;
  coarse.set("odometry.jump_seen_m", 2.0, "site.toml:7");
  const Section metres = run_odometry(at_2s, coarse);
  CHECK(finding(metres, "LOC-02").verdict == Verdict::pass);
  CHECK(finding(metres, "LOC-02").threshold_source.find("site.toml:7") != std::string::npos);
}

TEST_CASE("logs that cannot answer are unknown with the reason") {
  PaperRobot robot;
  robot.hours = 0.5;
  std::string stood;  // findings that say so
  const auto reasons = [&](const std::function<void(PaperAnswer&)>& edit, double hours = 0.5) {
    robot.hours = hours;
    PaperLog log = status_log(robot, edit);
    const Section s = run_odometry(log);
    std::string all;
    for (const Finding& f : s.findings) {
      if (f.verdict == Verdict::unknown) {
        CHECK_FALSE(f.value.reason.empty());
        all += f.id + ": " + f.value.reason + "\n";
        const bool stands = f.value.reason.find("stood the whole time") != std::string::npos;
        CHECK(stands == (f.advice == "record the robot while it drives"));
        stood += stands ? f.id + " " : "";
      }
    }
    return all;
  };
  SECTION("no odo") {
    const std::string all = reasons([](PaperAnswer& a) { a.odo = a.today_odo = std::nan(""); });
    CHECK(all.find("ODO-01: the log has no odo") != std::string::npos);
    CHECK(all.find("ODO-02: the log has no odo") != std::string::npos);
    CHECK(all.find("ODO-03: the log has no odo") != std::string::npos);
  }
  SECTION("no pose") {
    const std::string all = reasons([](PaperAnswer& a) { a.x = std::nan(""); });
    CHECK(all.find("ODO-03: the log has no localised pose") != std::string::npos);
    CHECK(all.find("ODO-07: the log has no localised pose") != std::string::npos);
    CHECK(all.find("ODO-02") == std::string::npos);
  }
  SECTION("never localised") {
    CHECK(reasons([](PaperAnswer& a) { a.reloc = 3; }).find("no localised pose") != std::string::npos);
  }
  SECTION("nothing driven, the pose frozen") {
    const std::string all = reasons([](PaperAnswer& a) {
      a.x = a.y = a.angle = a.vx = a.w = 0.0;
      a.odo = 5.0;
    });
    CHECK(all.find("ODO-02: nothing driven") != std::string::npos);
    CHECK(all.find("ODO-03: pose noise unknown: the pose is frozen") != std::string::npos);
    CHECK(stood == "ODO-02 ODO-03 ODO-07 LOC-02 ");
  }
  SECTION("nothing driven, a noisy pose: a standing robot does not drive") {
    const std::string all = reasons([](PaperAnswer& a) {
      a.x = std::fmod(a.x * 1e4, 97.0) * 1e-4;
      a.y = a.angle = a.vx = a.w = 0.0;
      a.odo = 5.0;
    });
    CHECK(all.find("ODO-03: nothing driven") != std::string::npos);
    CHECK(stood == "ODO-02 ODO-03 ODO-07 LOC-02 ");
  }
  SECTION("one snapshot") {
    const std::string all = reasons({}, 0.5 / 3600.0);
    CHECK(all.find("ODO-01: one row only") != std::string::npos);
    CHECK(all.find("fewer than two rows") != std::string::npos);
  }
  SECTION("a few metres") {
    const std::string all = reasons({}, 60.0 / 3600.0);
    CHECK(all.find("ODO-02") != std::string::npos);
    CHECK(all.find("ODO-03") != std::string::npos);
    CHECK(stood.empty());
  }
}

TEST_CASE("an empty log is unknown throughout") {
  PaperRobot robot;
  robot.hours = 0.1;
  PaperLog log(robot, {});
  const Section s = run_odometry(log);
  REQUIRE(s.findings.size() == 6);
  for (const Finding& f : s.findings) {
    CHECK(f.verdict == Verdict::unknown);
    CHECK_FALSE(f.value.reason.empty());
  }
  CHECK_FALSE(s.notes.empty());
}

TEST_CASE(
    "drift of one short stretch has values without an interval, and heading drift stays unknown with the reason") {
  PaperRobot robot;
  robot.hours = 0.02;
  PaperLog log = status_log(robot);
  Settings settings;
  settings.set("odometry.drift_n_min", 1.0, "site.toml:1");
  const Section s = run_odometry(log, settings);
  const Quantity rmse = quantity(s, "drift", "rmse_pct", 1);
  REQUIRE(rmse.value);
  CHECK_FALSE(rmse.lo);
  CHECK_FALSE(rmse.hi);
  CHECK(rmse.reason.starts_with("no interval: "));
  const Finding& f = finding(s, "ODO-07");
  CHECK(f.verdict == Verdict::unknown);
  CHECK_FALSE(f.value.lo);
  CHECK_FALSE(f.value.reason.empty());
}

TEST_CASE("every interval of a table holds its value, however short the record") {
  for (const double hours : {0.01, 0.02, 0.04, 0.08, 0.3, 1.0}) {
    PaperRobot robot;
    robot.hours = hours;
    PaperLog log = status_log(robot);
    const Section s = run_odometry(log);
    for (const DataTable& t : s.tables) {
      for (const auto& row : t.rows) {
        for (const Value& value : row) {
          const auto* q = std::get_if<Quantity>(&value);
          if (q != nullptr && q->value && q->lo && q->hi) {
            INFO(t.name << " of " << hours << " h: " << *q->lo << " " << *q->value << " " << *q->hi);
            CHECK(*q->lo <= *q->value);
            CHECK(*q->value <= *q->hi);
          }
        }
      }
    }
  }
}
