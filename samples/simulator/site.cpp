#include "samples/simulator/site.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>

namespace tacho::sim {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kRadius = 1.5;
constexpr double kArc = kRadius * kPi / 2;

// One corridor or rounded corner, counter-clockwise. `corner`: the robot turns on the spot where it ends.
struct Element {
  Pose start;
  double length_m;
  double curvature;
  bool corner;
};
const std::array<Element, 6> kLoop{{{{2, 2, 0}, 34.5, 0, false},
                                    {{36.5, 2, 0}, kArc, 1 / kRadius, false},
                                    {{38, 3.5, kPi / 2}, 14.5, 0, true},
                                    {{38, 18, kPi}, 34.5, 0, false},
                                    {{3.5, 18, kPi}, kArc, 1 / kRadius, false},
                                    {{2, 16.5, -kPi / 2}, 14.5, 0, true}}};

struct Place {
  std::size_t element;
  double offset_m;
};

Place place(double loop_m) {
  std::size_t i = 0;
  while (i + 1 < kLoop.size() && loop_m >= kLoop[i].length_m) {
    loop_m -= kLoop[i].length_m;
    ++i;
  }
  return {i, loop_m};
}

Stretch stretch(const Element& element, double length_m, bool counter_clockwise, const SpeedLimits& limits) {
  const bool arc = element.curvature != 0;
  return {length_m, counter_clockwise ? element.curvature : -element.curvature,
          arc ? limits.arc_mps : limits.corridor_mps};
}

// Collects corridors into runs that end where the robot has to turn.
class RouteBuilder {
 public:
  explicit RouteBuilder(const SpeedLimits& limits) : limits_(limits) {}
  void element(const Element& e, double length_m, bool counter_clockwise) {
    if (length_m > 0) {
      run_.push_back(stretch(e, length_m, counter_clockwise, limits_));
    }
  }
  void bay(double depth_m, int direction) {
    flush();
    steps_.emplace_back(Drive{{{depth_m, 0, limits_.bay_mps}}, direction});
  }
  void turn(double heading) {
    flush();
    steps_.emplace_back(Turn{heading});
  }
  std::vector<Step> take() {
    flush();
    return std::move(steps_);
  }

 private:
  SpeedLimits limits_;
  Run run_;
  std::vector<Step> steps_;
  void flush() {
    if (!run_.empty()) {
      steps_.emplace_back(Drive{std::move(run_), 1});
      run_.clear();
    }
  }
};

double bay_heading(const Station& station) {
  return kLoop[place(station.loop_m).element].start.angle_rad + station.side * kPi / 2;
}

void forwards(RouteBuilder& builder, Place at, Place goal) {
  bool wrapped = goal.element > at.element || (goal.element == at.element && goal.offset_m >= at.offset_m);
  while (!(at.element == goal.element && wrapped)) {
    builder.element(kLoop[at.element], kLoop[at.element].length_m - at.offset_m, true);
    const bool corner = kLoop[at.element].corner;
    at = {(at.element + 1) % kLoop.size(), 0};
    wrapped = wrapped || at.element == 0;
    if (corner) {
      builder.turn(kLoop[at.element].start.angle_rad);
    }
  }
  builder.element(kLoop[at.element], goal.offset_m - at.offset_m, true);
}

void backwards(RouteBuilder& builder, Place at, Place goal) {
  bool wrapped = goal.element < at.element || (goal.element == at.element && goal.offset_m <= at.offset_m);
  while (!(at.element == goal.element && wrapped)) {
    builder.element(kLoop[at.element], at.offset_m, false);
    const std::size_t before = (at.element + kLoop.size() - 1) % kLoop.size();
    wrapped = wrapped || at.element == 0;
    at = {before, kLoop[before].length_m};
    if (kLoop[before].corner) {
      builder.turn(kLoop[before].start.angle_rad + kPi);
    }
  }
  builder.element(kLoop[at.element], at.offset_m - goal.offset_m, false);
}

}  // namespace

Pose station_pose(int station) {
  const Station& s = kStations[static_cast<std::size_t>(station)];
  const Place p = place(s.loop_m);
  Pose pose = kLoop[p.element].start;  // stations are on straight corridors
  pose.x_m += p.offset_m * std::cos(pose.angle_rad);
  pose.y_m += p.offset_m * std::sin(pose.angle_rad);
  if (s.bay_m > 0) {
    pose.angle_rad = bay_heading(s);
    pose.x_m += s.bay_m * std::cos(pose.angle_rad);
    pose.y_m += s.bay_m * std::sin(pose.angle_rad);
  }
  return pose;
}

int station_near(double x_m, double y_m, double radius_m) {
  static const auto poses = [] {
    std::array<Pose, kStations.size()> all;
    for (std::size_t i = 0; i < all.size(); ++i) {
      all[i] = station_pose(static_cast<int>(i));
    }
    return all;
  }();
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (std::hypot(poses[i].x_m - x_m, poses[i].y_m - y_m) < radius_m) {
      return static_cast<int>(i);
    }
  }
  return -1;
}

int station_number(int station) {
  const std::string_view id = kStations[static_cast<std::size_t>(station)].id;
  int number = 0;
  std::from_chars(id.data() + id.find_first_of("0123456789"), id.data() + id.size(), number);
  return number;
}

std::vector<Step> route(int from, int to, bool counter_clockwise, const SpeedLimits& limits) {
  const Station& a = kStations[static_cast<std::size_t>(from)];
  const Station& b = kStations[static_cast<std::size_t>(to)];
  const Place at = place(a.loop_m);
  RouteBuilder builder(limits);
  if (a.bay_m > 0) {
    builder.bay(a.bay_m, -1);
  }
  builder.turn(kLoop[at.element].start.angle_rad + (counter_clockwise ? 0 : kPi));
  if (counter_clockwise) {
    forwards(builder, at, place(b.loop_m));
  } else {
    backwards(builder, at, place(b.loop_m));
  }
  if (b.bay_m > 0) {
    builder.turn(bay_heading(b));
    builder.bay(b.bay_m, 1);
  }
  return builder.take();
}

}  // namespace tacho::sim
