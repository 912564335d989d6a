// The physical model: its truth must agree with its own state, whoever asks and however often.

#include "samples/simulator/robot.hpp"

#include <algorithm>
#include <cmath>

#include "samples/simulator/site.hpp"
#include "tests/support/catch.hpp"

namespace sim = tacho::sim;
using sim::Robot;
using sim::RobotState;
using sim::Scenario;
using tacho::AlarmLevel;
using tacho::Micros;

namespace {

constexpr Micros kStart = 1'767'225'600'000'000;
constexpr Micros kSecond = 1'000'000;
constexpr Micros kHour = 3600 * kSecond;

Scenario troubled(std::uint64_t seed) {
  Scenario s = sim::busy_day(seed);
  s.slips_per_km = 1;
  s.jumps_per_hour = 2;
  s.odo_scale = 1.01;
  return s;
}

/// |v| integrated over steps fine enough that each of them lies inside one piece of constant acceleration, or is
/// refined.
double integrate(Robot& robot, Micros from, Micros to) {
  double sum = 0;
  double before = std::abs(robot.at(from).v_mps);
  for (Micros t = from; t < to;) {
    const Micros next = std::min(to, t + 1000);
    const double after = std::abs(robot.at(next).v_mps);
    sum += (before + after) / 2 * static_cast<double>(next - t) * 1e-6;
    before = after;
    t = next;
  }
  return sum;
}

}  // namespace

TEST_CASE("the driven path is the integral of the speed") {
  Robot robot(troubled(3), kStart);
  const double path = integrate(robot, kStart, kStart + 600 * kSecond);
  CHECK(path > 200);
  // The trapezoid rule errs by a dt^2 / 2 at most where a piece begins, a few thousand times.
  CHECK(robot.truth().path_m == Approx(path).margin(1e-3));
}

TEST_CASE("inside a piece of motion the path is the exact integral of the speed") {
  const sim::Stretch straight{7.3, 0.0, 1.1};
  const sim::Stretch arc{2.4, 0.7, 0.6};
  const sim::Run run{straight, arc, straight};
  const auto pieces = plan_run(run, {1, 2, 0.3}, kStart, 0.45);
  REQUIRE(pieces.size() >= 5);
  double sum = 0;
  double speed = 0;
  for (const sim::Piece& piece : pieces) {
    const double duration = static_cast<double>(piece.duration_us) * 1e-6;
    const auto end = kinematics_at(piece, piece.end_us());
    CHECK(piece.v0_mps == Approx(speed).margin(1e-5));
    CHECK(end.path_m == Approx((piece.v0_mps + end.v_mps) / 2 * duration).margin(1e-12));
    sum += end.path_m;
    speed = end.v_mps;
  }
  CHECK(sum == Approx(sim::length(run)).margin(1e-9));
  CHECK(sim::path(pieces) == Approx(sim::length(run)).margin(1e-9));
  CHECK(speed == Approx(0).margin(1e-5));
}

TEST_CASE("turning on the spot ends at the heading that was asked for") {
  for (const double angle : {-3.1, -0.2, 1e-4, 1.5}) {
    const auto pieces = sim::plan_turn(angle, {}, kStart, 0.6, 1.0);
    REQUIRE(!pieces.empty());
    CHECK(kinematics_at(pieces.back(), pieces.back().end_us()).pose.angle_rad == Approx(angle).margin(1e-9));
    CHECK(sim::path(pieces) == 0);
  }
}

TEST_CASE("a robot that brakes for an alarm drives the rest of its run afterwards") {
  const sim::Run run{{3.0, 0.0, 1.0}, {2.0, 0.5, 0.6}};
  const auto brake = sim::plan_brake(run, {}, kStart, 1.0, 1.5);
  CHECK(sim::path(brake) == Approx(1.0 / 3).margin(1e-5));
  CHECK(sim::length(sim::drop(run, sim::path(brake))) + sim::path(brake) == Approx(5.0).margin(1e-9));
  CHECK(sim::length(sim::take(run, 3.5)) == Approx(3.5).margin(1e-12));
}

TEST_CASE("every route ends at its station with the heading of its bay") {
  const sim::SpeedLimits limits;
  for (int from = 0; from < static_cast<int>(sim::kStations.size()); ++from) {
    for (int to = 0; to < static_cast<int>(sim::kStations.size()); ++to) {
      for (const bool counter_clockwise : {false, true}) {
        sim::Pose pose = sim::station_pose(from);
        for (const sim::Step& step : sim::route(from, to, counter_clockwise, limits)) {
          if (const auto* turn = std::get_if<sim::Turn>(&step)) {
            pose.angle_rad = turn->to_heading_rad;
            continue;
          }
          const auto& drive = std::get<sim::Drive>(step);
          const auto pieces = sim::plan_run(drive.run, pose, kStart, 0.5, drive.direction);
          pose = kinematics_at(pieces.back(), pieces.back().end_us()).pose;
        }
        const sim::Pose goal = sim::station_pose(to);
        INFO(from << " to " << to);
        CHECK(pose.x_m == Approx(goal.x_m).margin(1e-6));
        CHECK(pose.y_m == Approx(goal.y_m).margin(1e-6));
        if (sim::kStations[static_cast<std::size_t>(to)].bay_m > 0) {
          CHECK(std::remainder(pose.angle_rad - goal.angle_rad, 2 * M_PI) == Approx(0).margin(1e-9));
        }
      }
    }
  }
}

TEST_CASE("the state at a time does not depend on when the robot was asked before") {
  Robot often(troubled(5), kStart);
  Robot seldom(troubled(5), kStart);
  for (Micros t = kStart; t < kStart + 12 * kHour; t += 7'123'457) {
    often.at(t);
  }
  const Micros end = kStart + 12 * kHour;
  const RobotState& a = often.at(end);
  const RobotState& b = seldom.at(end);
  CHECK(a.x_m == b.x_m);
  CHECK(a.path_m == b.path_m);
  CHECK(a.soc == b.soc);
  CHECK(a.battery_temp_c == b.battery_temp_c);
  CHECK(a.pose_error_x_m == b.pose_error_x_m);
  CHECK(a.today_wheel_path_m == b.today_wheel_path_m);
  CHECK(truth_json("r", often.truth()) == truth_json("r", seldom.truth()));
}

TEST_CASE("the battery's books balance") {
  Scenario s = troubled(7);
  s.fade_per_efc = 0;
  Robot robot(s, kStart);
  robot.at(kStart);
  const RobotState state = robot.at(kStart + 48 * kHour);
  const auto truth = robot.truth();
  CHECK(truth.charge_sessions >= 4);
  CHECK((truth.charged_ah - truth.discharged_ah) / s.capacity_ah == Approx(state.soc - s.soc_start).margin(1e-9));
  CHECK(truth.equivalent_full_cycles_soc ==
        Approx((truth.charged_ah + truth.discharged_ah) / (2 * s.capacity_ah)).margin(1e-9));
  CHECK(truth.equivalent_full_cycles_soc > 2);
  CHECK(truth.equivalent_full_cycles_soc < 6);
}

TEST_CASE("the charge is the integral of the current") {
  Robot robot(troubled(7), kStart);
  double ah = 0;
  double before = robot.at(kStart).current_a;
  constexpr Micros kStep = 20'000;
  for (Micros t = kStart + kStep; t <= kStart + 8 * kHour; t += kStep) {
    const double now = robot.at(t).current_a;
    ah += (before + now) / 2 * static_cast<double>(kStep) * 1e-6 / 3600;
    before = now;
  }
  const auto truth = robot.truth();
  CHECK(truth.charge_sessions >= 1);
  CHECK(truth.charged_ah - truth.discharged_ah == Approx(ah).margin(0.01));
}

TEST_CASE("the capacity fades with the equivalent full cycles") {
  Scenario s;
  s.fade_per_efc = 0.01;
  Robot robot(s, kStart);
  robot.at(kStart + 10 * 24 * kHour);
  const auto truth = robot.truth();
  REQUIRE(truth.capacity_ah_per_day.size() == 11);
  CHECK(truth.capacity_ah_per_day.front() == 40.0);
  CHECK(std::is_sorted(truth.capacity_ah_per_day.rbegin(), truth.capacity_ah_per_day.rend()));
  const double faded = 1 - truth.capacity_ah_per_day.back() / 40.0;
  CHECK(faded == Approx(0.01 * truth.equivalent_full_cycles_soc).margin(0.01));
  CHECK(faded > 0.1);
}

TEST_CASE("a state of charge that is never refilled stops at the cut-off, not below zero") {
  Scenario s;
  s.always_idle = true;
  s.capacity_ah = 1;
  s.soc_start = 0.03;
  s.charge_below = 0.02;
  Robot robot(s, kStart);
  for (Micros t = kStart; t < kStart + 24 * kHour; t += 60 * kSecond) {
    REQUIRE(robot.at(t).soc > -0.3);
    REQUIRE(robot.at(t).soc < 1.0);
  }
}

TEST_CASE("blocked episodes in the truth are those in the states") {
  Robot robot(troubled(11), kStart);
  int runs = 0;
  bool before = false;
  double blocked_s = 0;
  for (Micros t = kStart; t <= kStart + 6 * kHour; t += 50'000) {
    const RobotState& state = robot.at(t);
    runs += state.blocked && !before ? 1 : 0;
    blocked_s += state.blocked ? 0.05 : 0;
    before = state.blocked;
    if (state.blocked) {
      REQUIRE(state.is_stop);
      REQUIRE(state.task_status == 2);
      const double away = std::hypot(state.block_x_m - state.x_m, state.block_y_m - state.y_m);
      REQUIRE(away == Approx(0.8).margin(0.2001));
    }
  }
  const auto truth = robot.truth();
  REQUIRE(truth.blocked.size() > 5);
  CHECK(static_cast<std::size_t>(runs) == truth.blocked.size());
  double true_s = 0;
  for (const auto& episode : truth.blocked) {
    true_s += static_cast<double>(episode.to_us - episode.from_us) * 1e-6;
  }
  CHECK(blocked_s == Approx(true_s).margin(0.05 * static_cast<double>(truth.blocked.size())));
}

TEST_CASE("hot spots block where they are and as often as they say") {
  Scenario s;
  s.seed = 4;
  s.hot_spots = {{20, 2, 1.0, 0.5, 5.0, 3}};
  Robot robot(s, kStart);
  robot.at(kStart + 24 * kHour);
  const auto truth = robot.truth();
  REQUIRE(truth.blocked.size() > 50);
  for (const auto& episode : truth.blocked) {
    CHECK(std::hypot(episode.x_m - 20, episode.y_m - 2) < 1.01);
    CHECK(episode.reason == 3);
  }
}

TEST_CASE("alarms in the truth are those in the states, and those that stop the robot do") {
  Scenario s;
  s.seed = 6;
  s.alarms = {{AlarmLevel::error, 52200, 4, 60, 10, true, "stops"},
              {AlarmLevel::warning, 54018, 6, 20, 0, false, "no"}};
  Robot robot(s, kStart);
  std::size_t raised = 0;
  bool before[2] = {};
  Micros stopping_since = 0;
  for (Micros t = kStart; t <= kStart + 6 * kHour; t += 20'000) {
    const RobotState& state = robot.at(t);
    bool now[2] = {};
    for (const auto& alarm : state.alarms) {
      now[alarm.code == 52200 ? 0 : 1] = true;
      REQUIRE(alarm.times >= 1);
      REQUIRE(alarm.stamp_s * kSecond <= t);
    }
    for (int i = 0; i < 2; ++i) {
      raised += now[i] && !before[i] ? 1 : 0;
      before[i] = now[i];
    }
    stopping_since = now[0] ? (stopping_since != 0 ? stopping_since : t) : 0;
    if (stopping_since != 0 && t - stopping_since > 2 * kSecond) {
      REQUIRE(state.is_stop);
    }
  }
  CHECK(raised > 20);
  // An alarm shorter than the sampling may be missed, nothing else.
  const auto truth = robot.truth();
  const auto shorter = std::count_if(truth.alarms.begin(), truth.alarms.end(),
                                     [](const auto& a) { return a.to_us - a.from_us < 40'000; });
  CHECK(raised <= truth.alarms.size());
  CHECK(raised + static_cast<std::size_t>(shorter) >= truth.alarms.size());
}

TEST_CASE("changing the alarms leaves floor, localisation and choices as they were") {
  Scenario quiet = troubled(9);
  quiet.alarms.clear();
  Scenario noisy = quiet;
  noisy.alarms = {{AlarmLevel::notice, 57002, 5, 30, 0, false, ""}};
  Robot a(quiet, kStart);
  Robot b(noisy, kStart);
  CHECK(a.at(kStart + 5 * kHour).path_m == b.at(kStart + 5 * kHour).path_m);
  CHECK(b.truth().alarms.size() > 5);
}

TEST_CASE("wheels that slip drive further than the robot, localisation faults come back to zero") {
  Robot robot(troubled(13), kStart);
  const RobotState& state = robot.at(kStart + 24 * kHour);
  const auto truth = robot.truth();
  REQUIRE(truth.slips.size() > 3);
  double slipped = 0;
  for (const auto& slip : truth.slips) {
    slipped += slip.metres;
  }
  CHECK(state.wheel_path_m - state.path_m == Approx(slipped).margin(0.41));
  CHECK(truth.counter_m == Approx(1.01 * state.wheel_path_m).margin(1e-9));
  double x = 0;
  for (const auto& jump : truth.jumps) {
    x += jump.dx_m;
  }
  CHECK(truth.jumps.size() > 20);
  CHECK(x == Approx(state.pose_error_x_m).margin(1e-9));
}

TEST_CASE("the day's counters start again at the robot's midnight, UTC-11") {
  Robot robot(Scenario{}, kStart);
  const RobotState before = robot.at(kStart + 11 * kHour - kSecond);
  CHECK(before.today_wheel_path_m == before.wheel_path_m);
  const double at_midnight = robot.at(kStart + 11 * kHour).wheel_path_m;
  const RobotState after = robot.at(kStart + 12 * kHour);
  CHECK(after.today_wheel_path_m == Approx(after.wheel_path_m - at_midnight).margin(1e-9));
  CHECK(after.today_s == Approx(3600));
}

TEST_CASE("an idle robot stays at its dock and charges there") {
  Scenario s;
  s.always_idle = true;
  Robot robot(s, kStart);
  double highest = 0;
  for (int hour = 0; hour < 72; ++hour) {
    const RobotState& state = robot.at(kStart + hour * kHour);
    REQUIRE(state.path_m == 0);
    REQUIRE(state.current_station == "CP9");
    highest = std::max(highest, state.current_a);
  }
  CHECK(robot.truth().charge_sessions >= 2);
  CHECK(highest > 5);
}
