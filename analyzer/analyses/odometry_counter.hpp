#pragma once
// A1: is the counter (odo) sane? Looks at every row of one source, also across gaps.
//
// Quantum q: the largest of {10^-k, 2^-k} of which 99.9 % of the values the counter took are whole multiples (needs 20
// different values). Falls: epoch breaks. Jumps: growth > v_max dt + q. Stuck: integral |v| > 1 m without growth.
// odo - today_odo is constant within the robot's day: its range must be <= q_odo + q_today (+ one float32 step each
// when they come from registers). today_odo falls at the robot's midnight, which gives the robot's time zone.

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "analyzer/analyses/odometry_segments.hpp"

namespace tacho::odometry {

/// Distance from |value| to the next float32.
double float32_step(double value);

/// Finds the quantum of a stream of values.
class QuantumFinder {
 public:
  void add(double value);
  /// Different values in a row seen.
  [[nodiscard]] std::uint64_t changes() const { return changes_; }
  /// Empty with fewer than 20 changes; 0 when no candidate fits (finer than 1e-6).
  [[nodiscard]] std::optional<double> quantum() const;
  /// "decimal number", "float32", "binary fraction", "continuous".
  [[nodiscard]] std::string kind() const;
  [[nodiscard]] double largest() const { return largest_; }

 private:
  static constexpr std::size_t kCandidates = 27;
  static const std::array<double, kCandidates>& candidates();
  std::array<std::uint64_t, kCandidates> fits_{};
  std::uint64_t changes_ = 0;
  double last_ = kNone;
  double largest_ = 0.0;
  double smallest_ = std::numeric_limits<double>::infinity();
};

struct CounterEvent {
  enum class What : std::uint8_t { fall, jump, stuck } what = What::fall;
  Micros from_us = 0;
  Micros to_us = 0;
  double before_m = 0;
  double after_m = 0;
  double uptime_s = kNone;
  double allowed_m = 0;  ///< jump: v_max dt + q; stuck: metres the speed says
};
std::string_view counter_event_name(CounterEvent::What what);

/// The robot's day between two falls of today_odo.
struct RobotDay {
  Micros from_us = 0;
  Micros to_us = 0;
  double lowest = 0;  ///< of odo - today_odo
  double highest = 0;
  bool started_by_fall = false;
  Micros fell_after_us = 0;  ///< the fall was between this row and from_us
};

struct CounterResult {
  bool seen = false;
  std::optional<double> quantum_m;  ///< for bounds; a register counter without enough values: its float32 step
  std::string kind;
  std::uint64_t changes = 0;
  double counted_m = 0;  ///< sum of growth
  std::vector<CounterEvent> events;
  std::vector<RobotDay> days;  ///< empty when today_odo is not supplied
  double today_allowed_m = 0;
  double today_range_m = 0;  ///< largest range over the days
  [[nodiscard]] std::uint64_t count(CounterEvent::What what) const;
  /// Hours to add to UTC for the robot's clock, from the falls of today_odo; empty without one seen within 15 min.
  [[nodiscard]] std::optional<double> zone_h() const;
  /// The quantum for error bounds, 0 when unknown.
  [[nodiscard]] double q() const { return quantum_m.value_or(0.0); }
};

class CounterFold {
 public:
  CounterFold(const Config& config, bool float32) : config_(config), float32_(float32) {}
  /// Rows in order, without duplicates.
  void add(const RawRow& raw, const Prepared& prepared);
  [[nodiscard]] CounterResult finish();

 private:
  Config config_;
  bool float32_;
  QuantumFinder odo_quantum_;
  QuantumFinder today_quantum_;
  CounterResult result_;
  RawRow last_;
  Row last_row_;
  bool any_ = false;
  double idle_metres_ = 0;  ///< driven by speed since the counter last moved
  CounterEvent idle_;
  double last_today_ = kNone;
  Micros last_today_us_ = 0;

  void step(const RawRow& raw, const Prepared& prepared);
  void add_today(const RawRow& raw);
  void end_idle();
};

}  // namespace tacho::odometry
