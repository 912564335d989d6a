#pragma once
// What happens to a robot from outside: alarms at random times, obstacles and slippery floor on a run, localisation
// faults. Each has its own random numbers, so that changing one leaves the others where they were.

#include <optional>
#include <vector>

#include "samples/simulator/motion.hpp"
#include "samples/simulator/rng.hpp"
#include "samples/simulator/robot.hpp"

namespace tacho::sim {

struct Interval {
  Micros from_us = 0;
  Micros to_us = 0;
};

/// Poisson arrivals of one alarm: exponential waiting from the end of the last one, exponential duration.
class AlarmTimeline {
 public:
  AlarmTimeline(const AlarmSpec& spec, std::uint64_t seed, std::uint64_t stream, Micros t0_us);
  /// The first interval that ends after `t_us`; empty when the alarm never comes (per_hour = 0).
  [[nodiscard]] std::optional<Interval> next(Micros t_us);
  /// Repetitions inside an interval that began at `from_us`, counted at `t_us`. A third of the intervals repeat.
  [[nodiscard]] std::int64_t times(Micros from_us, Micros t_us) const;
  [[nodiscard]] const AlarmSpec& spec() const { return spec_; }
  /// Intervals generated so far.
  [[nodiscard]] const std::vector<Interval>& intervals() const { return intervals_; }

 private:
  AlarmSpec spec_;
  std::uint64_t key_;
  Rng rng_;
  Micros frontier_us_;
  std::vector<Interval> intervals_;
  std::size_t cursor_ = 0;
};

/// All alarms of a robot.
class Alarms {
 public:
  Alarms(const Scenario& scenario, Micros t0_us);
  /// The first interval of an alarm that stops the robot which ends after `t_us`.
  [[nodiscard]] std::optional<Interval> next_stop(Micros t_us);
  /// Active at `t_us`; times may not decrease.
  void active(Micros t_us, double clock_offset_s, std::vector<ActiveAlarm>& out);
  /// Intervals that begin before `t1_us`, clipped to it, by begin.
  [[nodiscard]] std::vector<TrueAlarm> truth(Micros t1_us) const;

 private:
  std::vector<AlarmTimeline> reported_;
  std::vector<AlarmTimeline> stopping_;  // the same timelines again: planning looks ahead of reporting
};

/// A stop in front of an obstacle, planned before a run is driven.
struct Block {
  double at_m = 0;  ///< along the run
  double duration_s = 0;
  double obstacle_m = 0.8;  ///< ahead of the robot
  int reason = 1;
};

class FloorTrouble {
 public:
  explicit FloorTrouble(const Scenario& scenario);
  /// Stops on a run that starts at `start`, in order, not closer than 0.3 m to each other or to the ends.
  std::vector<Block> blocks(const Run& run, Pose start);
  /// The same run with slowed and slippery stretches.
  Run roughen(Run run);

 private:
  const Scenario& scenario_;
  Rng blocks_;
  Rng slowed_;
  Rng slips_;
};

/// The localisation's error, a step function of time.
class Localisation {
 public:
  Localisation(const Scenario& scenario, Micros t0_us);
  struct Offset {
    double x_m = 0, y_m = 0;
  };
  Offset offset(Micros t_us);  ///< times may not decrease
  [[nodiscard]] std::vector<TrueJump> truth(Micros t1_us) const;

 private:
  const Scenario& scenario_;
  Rng rng_;
  Offset now_;
  std::vector<TrueJump> jumps_;  // generated so far; the last one is in the future
  std::size_t passed_ = 0;
  void generate(Micros t_us);
};

}  // namespace tacho::sim
