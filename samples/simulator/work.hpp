#pragma once
// A robot's day, planned leg by leg: drives a route to the next station, waits, charges when low, stops for obstacles
// and for alarms. Yields segments in which motion and battery are closed forms.

#include <deque>
#include <vector>

#include "samples/simulator/battery.hpp"
#include "samples/simulator/disturbances.hpp"
#include "samples/simulator/robot.hpp"
#include "samples/simulator/site.hpp"

namespace tacho::sim {

/// What does not change inside a segment, and the totals at its start.
struct Segment {
  Piece motion;
  BatteryPiece battery;
  double path_m = 0;
  double wheel_path_m = 0;
  double heading_sum_rad = 0;
  Micros still_since_us = 0;
  bool task_running = false, blocked = false, charging = false;
  int target = -1, last = -1;  ///< stations, -1 = none yet
  std::size_t episodes = 0;    ///< blocked episodes begun so far, this segment's included
};

/// Totals of the driven wheels and the battery's capacity at the starts of days.
struct DayMarks {
  std::vector<Micros> midnight_us;   ///< of the robot's zone
  std::vector<double> wheel_path_m;  ///< at those times
  std::vector<double> capacity_ah;   ///< at t0 + i days
};

class Work {
 public:
  Work(const Scenario& scenario, Micros t0_us);

  /// Appends at least one segment to the plan.
  void plan();
  [[nodiscard]] std::deque<Segment>& segments() { return segments_; }

  [[nodiscard]] const std::vector<TrueEpisode>& episodes() const { return episodes_; }
  [[nodiscard]] const std::vector<TrueSlip>& slips() const { return slips_; }
  [[nodiscard]] const std::vector<Micros>& charges() const { return charges_; }
  [[nodiscard]] const DayMarks& days() const { return days_; }

 private:
  const Scenario& scenario_;
  Battery battery_;
  Alarms alarms_;
  FloorTrouble floor_;
  Rng choices_;
  std::deque<Segment> segments_;
  Segment tip_;  // what the next segment starts from
  Micros t_us_;
  Pose pose_;
  BatteryState charge_;
  int station_;
  std::vector<TrueEpisode> episodes_;
  std::vector<TrueSlip> slips_;
  std::vector<Micros> charges_;
  DayMarks days_;
  Micros next_midnight_us_;
  Micros next_day_us_;

  void push(const Piece& motion);
  void push(const Piece& motion, const BatteryPiece& battery);
  void push_all(const std::vector<Piece>& pieces);
  std::vector<Piece> follow(const std::vector<Piece>& pieces);
  void stand(Micros duration_us);
  void wait_for_clearance();
  void turn_to(double heading_rad);
  void drive(const Drive& drive);
  void drive_unblocked(Run run, int direction);
  void stand_blocked(const Block& block);
  void charge();
  void drive_to(int station);
  void mark_days(const Segment& segment);
};

}  // namespace tacho::sim
