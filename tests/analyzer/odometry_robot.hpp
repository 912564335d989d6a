#pragma once
// A robot on paper for tests of the odometry analysis: straights, turns on the spot, arcs and waits in closed form, so
// that its pose, speed and counter are exact at any time. A PaperLog polls it and adds what real answers add.

#include <cmath>
#include <functional>
#include <vector>

#include "analyzer/math/bootstrap.hpp"
#include "analyzer/math/se2.hpp"
#include "schema/batch_builder.hpp"
#include "schema/row_source.hpp"

namespace tacho::test {

struct PaperRobot {
  double cruise_mps = 1.0, accel_mps2 = 0.5;
  double turn_radps = 0.6, turn_accel_radps2 = 1.0;
  double hours = 24.0;
  double arc_radius_m = 0.0;  ///< > 0: corners are driven as arcs instead of on the spot
  double odo_scale = 1.0;     ///< counter metres per metre
  double speed_scale = 1.0;   ///< measured per true speed
  double turn_scale = 1.0;
  double wheel_track_m = 0.0;  ///< > 0: the counter is the mean of the wheels' paths
  double sigma_m = 0.004, sigma_rad = 0.002;
  double odo_start_m = 21773.948;
  std::uint64_t seed = 1;
};

struct PaperState {
  Pose pose;
  double v = 0, w = 0, path_m = 0, counter_m = 0;
};

class PaperDrive {
 public:
  explicit PaperDrive(const PaperRobot& robot) : robot_(robot) {
    SplitMix random(robot.seed);
    double t = 0.0;
    PaperState state;
    while (t < robot.hours * 3600.0) {
      add(Kind::straight, 3.0 + 25.0 * random.uniform(), t, state);
      constexpr std::array kTurns{0.5, -0.5, 0.25, -0.25, 1.0, 0.12};
      const double angle = kPi * kTurns[random.below(kTurns.size())];
      add(robot.arc_radius_m > 0.0 ? Kind::arc : Kind::pivot, angle, t, state);
      if (random.uniform() < 0.3) {
        add(Kind::wait, 5.0 + 25.0 * random.uniform(), t, state);
      }
    }
  }

  /// Times must not decrease from call to call.
  PaperState at(double t) {
    while (leg_ + 1 < legs_.size() && t >= legs_[leg_ + 1].from_s) {
      ++leg_;
    }
    return state_in(legs_[leg_], std::max(0.0, t - legs_[leg_].from_s));
  }
  void rewind() { leg_ = 0; }

 private:
  enum class Kind { straight, pivot, arc, wait };
  struct Leg {
    Kind kind = Kind::wait;
    double amount = 0;  ///< m, rad or s
    double from_s = 0;
    PaperState start;
  };
  struct Progress {
    double done = 0, rate = 0;
  };
  PaperRobot robot_;
  std::vector<Leg> legs_;
  std::size_t leg_ = 0;

  /// Trapezoidal profile over `amount` >= 0 with top rate and acceleration.
  static double duration(double amount, double top, double accel) {
    return amount >= top * top / accel ? amount / top + top / accel : 2.0 * std::sqrt(amount / accel);
  }
  static Progress along(double amount, double top, double accel, double t) {
    const double total = duration(amount, top, accel);
    const double peak = std::min(top, std::sqrt(amount * accel));
    const double ramp = peak / accel;
    t = std::min(t, total);
    if (t < ramp) {
      return {0.5 * accel * t * t, accel * t};
    }
    if (t <= total - ramp) {
      return {0.5 * accel * ramp * ramp + peak * (t - ramp), peak};
    }
    const double left = total - t;
    return {amount - 0.5 * accel * left * left, accel * left};
  }

  void add(Kind kind, double amount, double& t, PaperState& state) {
    const Leg leg{kind, amount, t, state};
    double seconds = leg.amount;
    if (leg.kind == Kind::straight) {
      seconds = duration(leg.amount, robot_.cruise_mps, robot_.accel_mps2);
    } else if (leg.kind == Kind::pivot) {
      seconds = duration(std::abs(leg.amount), robot_.turn_radps, robot_.turn_accel_radps2);
    } else if (leg.kind == Kind::arc) {
      seconds = duration(std::abs(leg.amount) * robot_.arc_radius_m, robot_.cruise_mps, robot_.accel_mps2);
    }
    legs_.push_back(leg);
    t += seconds;
    state = state_in(leg, seconds);
    state.v = state.w = 0.0;
  }

  [[nodiscard]] PaperState state_in(const Leg& leg, double t) const {
    PaperState s = leg.start;
    if (leg.kind == Kind::wait) {
      return s;
    }
    const double sign = leg.amount < 0.0 ? -1.0 : 1.0;
    if (leg.kind == Kind::pivot) {
      const Progress p = along(std::abs(leg.amount), robot_.turn_radps, robot_.turn_accel_radps2, t);
      s.pose.angle += sign * p.done;
      s.w = sign * p.rate;
      s.counter_m += robot_.odo_scale * 0.5 * robot_.wheel_track_m * p.done;
      return s;
    }
    const double metres = leg.kind == Kind::arc ? std::abs(leg.amount) * robot_.arc_radius_m : leg.amount;
    const Progress p = along(metres, robot_.cruise_mps, robot_.accel_mps2, t);
    const double curvature = leg.kind == Kind::arc ? sign / robot_.arc_radius_m : 0.0;
    s.pose = compose(s.pose, exp_se2({p.done, 0.0, curvature * p.done}, 1.0));
    s.v = p.rate;
    s.w = curvature * p.rate;
    s.path_m += p.done;
    s.counter_m += robot_.odo_scale * p.done;
    return s;
  }
};

/// What one answer says; a test may change it before it is recorded. NaN: the field is absent.
struct PaperAnswer {
  double t_s = 0, uptime_s = 0;
  double x = 0, y = 0, angle = 0, vx = 0, vy = 0, w = 0, odo = 0, today_odo = 0, confidence = 0.95;
  int reloc = 1, loc_method = 0, station = 0;
  double soc = 0.8, total_time_s = 0;
  std::string map = "hall";
  std::vector<std::int64_t> alarms;
  bool odd_alarm = false;  ///< one more that cannot be read (status only)
  bool skip = false;       ///< no answer
};

class PaperLog final : public RowSource {
 public:
  struct Stream {
    Source source = Source::status;
    double period_s = 1.0;
    double offset_s = 0.0;
    std::function<void(PaperAnswer&)> edit;
    double jitter_s = 0.002;  ///< polls are up to this late, uniformly
  };

  PaperLog(const PaperRobot& robot, std::vector<Stream> streams, std::size_t slice_rows = 3600)
      : robot_(robot), streams_(std::move(streams)), slice_rows_(slice_rows) {}

  [[nodiscard]] std::vector<Robot> robots() const override {
    Robot r;
    r.id = 1;
    r.name = "paper";
    return {r};
  }
  [[nodiscard]] std::vector<Session> sessions() const override { return {}; }
  [[nodiscard]] std::vector<tacho::Stream> streams() const override { return {}; }
  [[nodiscard]] std::vector<UnknownKey> unknown_keys() const override { return {}; }
  [[nodiscard]] std::vector<ReadProblem> problems() const override { return {}; }
  [[nodiscard]] std::vector<Coverage> coverage() const override {
    std::vector<Coverage> all;
    for (const Stream& stream : streams_) {
      Coverage c;
      c.robot = 1;
      c.source = stream.source;
      c.stored = static_cast<std::uint64_t>(std::ceil(robot_.hours * 3600.0 / stream.period_s));
      c.period_us = static_cast<Micros>(stream.period_s * 1e6);
      c.seen.set();
      all.push_back(c);
    }
    return all;
  }
  void read(RobotId, Window, const Selection& selection, const std::function<void(const Slice&)>& yield) override;
  void read_raw(RobotId, Source, Window, const std::function<void(const Answer&)>&) override {}

 private:
  PaperRobot robot_;
  std::vector<Stream> streams_;
  std::size_t slice_rows_;
};

}  // namespace tacho::test
