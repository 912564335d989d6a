#include <random>

#include "analyzer/analyses/blockage_episodes.hpp"
#include "analyzer/analyses/blockage_track.hpp"
#include "tests/support/catch.hpp"

using namespace tacho;
using math::Point;

namespace {

constexpr Micros kSecond = 1'000'000;

PoseRow pose(double t_s, double x, double y, bool blocked = false) {
  PoseRow row;
  row.t_us = static_cast<Micros>(t_s * 1e6);
  row.near = true;
  row.at = Point{x, y};
  row.map = "hall";
  row.blocked = blocked;
  return row;
}

struct Totals {
  double passes = 0, metres = 0, seconds = 0, blocked_s = 0;
};

Totals totals(const ExposureGrid& grid) {
  Totals t;
  for (const auto& [at, cell] : grid.cells()) {
    t.passes += cell.passes;
    t.metres += cell.metres;
    t.seconds += cell.seconds;
    t.blocked_s += cell.blocked_s;
  }
  return t;
}

const CellUse& cell(const PoseTrack& track, double x, double y) {
  return track.maps().at("hall").fine.cells().at(math::cell_of({x, y}, 0.25));
}

/// Polls of a flag at whole seconds, round trip 10 ms.
class Flags {
 public:
  EpisodeMachine machine{EpisodeRules{}};
  void on(double t_s, std::optional<std::int64_t> reason = 1, Point at = {5, 5}, bool gap = false) {
    Sighting s;
    s.reason = reason;
    s.at = at;
    s.map = "hall";
    step(t_s, gap, &s);
  }
  void off(double t_s, bool gap = false) { step(t_s, gap, nullptr); }
  const std::vector<Episode>& done() {
    machine.finish();
    return machine.episodes();
  }

 private:
  void step(double t_s, bool gap, const Sighting* s) {
    const auto t = static_cast<Micros>(t_s * 1e6);
    machine.step(t, t + 10'000, gap, s);
  }
};

}  // namespace

TEST_CASE("metres and seconds of all cells add up to the path and the time, on both grids") {
  std::mt19937_64 random(21);
  std::normal_distribution<double> turn(0.0, 0.4);
  PoseTrack track(TrackRules{});
  double x = 3, y = -2, heading = 0;
  double path = 0;
  double time = 0;
  double blocked = 0;
  bool was_blocked = false;
  for (int k = 0; k < 20'000; ++k) {
    const bool is_blocked = k % 50 < 10;
    const double step = is_blocked ? 0.0 : 0.1 + 0.02 * (k % 40);
    x += step * std::cos(heading);
    y += step * std::sin(heading);
    heading += turn(random);
    track.step(pose(k, x, y, is_blocked));
    if (k > 0) {
      path += step;
      time += 1.0;
      blocked += ((was_blocked ? 1 : 0) + (is_blocked ? 1 : 0)) / 2.0;
    }
    was_blocked = is_blocked;
  }
  CHECK(track.jumps == 0);
  CHECK(std::abs(track.path_m - path) < 1e-9 * path);
  CHECK(std::abs(track.observed_s - time) < 1e-9 * time);
  for (const ExposureGrid* grid : {&track.maps().at("hall").fine, &track.maps().at("hall").coarse}) {
    const Totals t = totals(*grid);
    CHECK(std::abs(t.metres - path) < 1e-9 * path);
    CHECK(std::abs(t.seconds - time) < 1e-9 * time);
    CHECK(std::abs(t.blocked_s - blocked) < 1e-9 * blocked);
  }
}

TEST_CASE("a pass is an entry, and coming back within two seconds is the same pass") {
  PoseTrack track(TrackRules{});
  track.step(pose(0, 0.1, 0.1));
  track.step(pose(1, 0.3, 0.1));
  track.step(pose(2, 0.1, 0.1));  // away from the first cell for about a second
  CHECK(cell(track, 0.1, 0.1).passes == 1);
  CHECK(cell(track, 0.3, 0.1).passes == 1);
  track.step(pose(3, 0.6, 0.1));
  track.step(pose(8, 0.1, 0.1));  // long away
  CHECK(cell(track, 0.1, 0.1).passes == 2);
}

TEST_CASE("a standing robot does not drive its localisation noise") {
  std::mt19937_64 random(4);
  std::normal_distribution<double> noise(0.0, 0.005);
  PoseTrack track(TrackRules{});
  for (int k = 0; k < 3'600; ++k) {
    track.step(pose(k, 1.1 + noise(random), 2.1 + noise(random)));
  }
  CHECK(track.path_m < 0.2);
  CHECK(track.observed_s == Approx(3'599.0));
  CHECK(cell(track, 1.1, 2.1).seconds > 3'500.0);
}

TEST_CASE("gaps, jumps, a change of map and rows without pose give no exposure") {
  PoseTrack track(TrackRules{});
  track.step(pose(0, 0, 0));
  track.step(pose(1, 1, 0));
  PoseRow after_gap = pose(60, 2, 0);
  after_gap.near = false;
  track.step(after_gap);
  track.step(pose(61, 3, 0));
  track.step(pose(62, 30, 0));  // 27 m in a second
  track.step(pose(63, 31, 0));
  PoseRow other = pose(64, 31, 0);
  other.map = "yard";
  track.step(other);
  PoseRow none = pose(65, 0, 0);
  none.at.reset();
  none.map = "yard";
  track.step(none);
  PoseRow back = pose(66, 32, 0);
  back.map = "yard";
  track.step(back);
  PoseRow wild = pose(67, std::nan(""), 0);
  wild.map = "yard";
  track.step(wild);
  CHECK(track.gaps == 1);
  CHECK(track.jumps == 1);
  CHECK(track.map_changes == 1);
  CHECK(track.without_pose == 2);
  CHECK(track.strides == 3);
  CHECK(track.path_m == Approx(3.0));
  CHECK(track.observed_s == Approx(3.0));
}

TEST_CASE("a robot that says it stands cannot have moved half a metre") {
  PoseTrack track(TrackRules{});
  PoseRow a = pose(0, 0, 0);
  PoseRow b = pose(1, 0.5, 0);
  a.speed_mps = b.speed_mps = 0.0;
  track.step(a);
  track.step(b);
  CHECK(track.jumps == 1);
}

TEST_CASE("speed classes give the median to half a class") {
  SpeedClasses classes;
  CHECK_FALSE(classes.median().has_value());
  for (const double v : {0.2, 0.4, 0.61, 0.8, 99.0}) {
    classes.add(v);
  }
  CHECK(classes.median().value() == Approx(0.61).margin(0.025));
}

TEST_CASE("onset and end of an episode lie between the polls around them") {
  Flags flags;
  flags.off(0);
  flags.on(1);
  flags.on(2);
  flags.off(3);
  REQUIRE(flags.done().size() == 1);
  const Episode& e = flags.machine.episodes().front();
  CHECK(e.onset_lo_us == 0);
  CHECK(e.onset_hi_us == kSecond + 10'000);
  CHECK(e.end_lo_us == 2 * kSecond);
  CHECK(e.end_hi_us == 3 * kSecond + 10'000);
}

TEST_CASE("a short interruption by the same reason does not end an episode, another reason or a long one does") {
  Flags same;
  same.off(0);
  same.on(1, 1);
  same.off(2);
  same.on(3, 1);
  same.off(4);
  REQUIRE(same.done().size() == 1);
  CHECK(same.machine.episodes().front().joined == 1);
  CHECK(same.machine.episodes().front().end_lo_us == 3 * kSecond);

  Flags other;
  other.off(0);
  other.on(1, 1);
  other.off(2);
  other.on(3, 6);
  other.off(4);
  CHECK(other.done().size() == 2);

  Flags late;
  late.off(0);
  late.on(1, 1);
  late.off(2);
  late.off(3);
  late.off(4);
  late.on(5, 1);
  late.off(6);
  CHECK(late.done().size() == 2);
}

TEST_CASE("a reason that comes one poll late belongs to its episode, one that never comes is not given") {
  Flags flags;
  flags.off(0);
  flags.on(1, std::nullopt);
  flags.on(2, 6);
  flags.off(3);
  flags.off(10);
  flags.on(11, std::nullopt);
  flags.off(12);
  REQUIRE(flags.done().size() == 2);
  CHECK(flags.machine.episodes()[0].reason == 6);
  CHECK_FALSE(flags.machine.episodes()[1].reason.has_value());
}

TEST_CASE("blocked on both sides of a gap is one episode only at the same place") {
  Flags same;
  same.off(0);
  same.on(1);
  same.on(60, 1, {5.02, 5.0}, true);
  same.off(61);
  REQUIRE(same.done().size() == 1);
  const Episode& whole = same.machine.episodes().front();
  CHECK(whole.over_gap);
  CHECK(whole.duration_mid_s() == Approx(0.99));  // what was seen of it
  CHECK(whole.duration_hi_s() == Approx(61.01));

  Flags elsewhere;
  elsewhere.off(0);
  elsewhere.on(1);
  elsewhere.on(60, 1, {9, 5}, true);
  elsewhere.off(61);
  REQUIRE(elsewhere.done().size() == 2);
  CHECK(elsewhere.machine.episodes()[0].end_in_gap);
  CHECK(elsewhere.machine.episodes()[1].onset_in_gap);
}

TEST_CASE("blocked in the first or the last poll has no bound there") {
  Flags flags;
  flags.on(0);
  flags.off(1);
  flags.off(10);
  flags.on(11);
  REQUIRE(flags.done().size() == 2);
  CHECK_FALSE(flags.machine.episodes()[0].onset_lo_us.has_value());
  CHECK_FALSE(flags.machine.episodes()[1].end_hi_us.has_value());
  CHECK_FALSE(flags.machine.episodes()[1].duration_hi_s().has_value());
}

TEST_CASE("the frame of obstacle points is found from the data or stays unknown") {
  std::vector<Episode> world;
  std::vector<Episode> robot;
  for (int k = 0; k < 24; ++k) {
    const double heading = 0.3 * k;
    const double ahead = 0.8 + 0.01 * (k % 5);
    Episode e;
    e.at = Point{10.0 + 3.0 * k, 5.0 - 2.0 * (k % 7)};
    e.heading_rad = heading;
    e.obstacle = Point{e.at->x + ahead * std::cos(heading), e.at->y + ahead * std::sin(heading)};
    world.push_back(e);
    e.obstacle = Point{ahead, 0.0};
    robot.push_back(e);
  }
  CHECK(obstacle_frame(world).frame == ObstacleFrame::world);
  CHECK(obstacle_frame(robot).frame == ObstacleFrame::robot);
  for (std::size_t k = 0; k < world.size(); ++k) {  // both say the same place
    const Point a = obstacle_in_map(world[k], ObstacleFrame::world).value();
    const Point b = obstacle_in_map(robot[k], ObstacleFrame::robot).value();
    CHECK(a.x == Approx(b.x));
    CHECK(a.y == Approx(b.y));
  }
  world.resize(19);
  CHECK(obstacle_frame(world).frame == ObstacleFrame::unknown);
  CHECK_FALSE(obstacle_in_map(world[0], ObstacleFrame::unknown).has_value());
  CHECK(obstacle_frame({}).frame == ObstacleFrame::unknown);
}

TEST_CASE("one obstacle left standing is many episodes but one incident") {
  std::vector<Episode> episodes;
  for (int k = 0; k < 10; ++k) {
    Episode e;
    e.at = Point{5.0 + 0.1 * k, 5.0};
    e.onset_hi_us = e.end_lo_us = 120 * kSecond * k;
    episodes.push_back(e);
  }
  CHECK(count_incidents(episodes) == 1);
  episodes.back().at = Point{50, 5};
  CHECK(count_incidents(episodes) == 2);
  CHECK(count_incidents({}) == 0);
}
