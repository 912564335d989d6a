#pragma once
// What the battery is doing: charge moved (throughput with its error), the sign of the current, its noise, the state
// machine charge / rest / discharge, and where the robot's `charging` flag contradicts the current.
//
// Which sign means charging is only known at the end of the record (it is the sign s that makes sum of s I dSoC
// positive), so everything here is kept for both signs: "positive" and "negative" are those of the robot's numbers.

#include <array>
#include <cstdint>
#include <vector>

#include "analyzer/analyses/battery_rows.hpp"
#include "analyzer/math/sum.hpp"

namespace tacho::battery {

/// Something for each sign of the current.
template <class T>
struct BySign {
  T positive{};
  T negative{};
  [[nodiscard]] const T& at(int sign) const { return sign > 0 ? positive : negative; }
};

/// Charge and energy that flowed with one sign, and for how long.
struct Moved {
  double ah = 0.0;
  double wh = 0.0;
  double seconds = 0.0;
};

/// What one row adds.
struct FlowStep {
  BySign<Moved> moved;
  double seconds = 0.0;  ///< 0: nothing to integrate (first row, gap, no current)
  double mean_a = 0.0;
};

/// B1: trapezoids of the current, cut at its zero crossings; never across a gap. The same sum from every second sample
/// tells how much the poll interval costs.
class Throughput {
 public:
  FlowStep step(const Row& row, std::int32_t day);

  struct Total {
    Sum ah;
    Sum wh;
    Sum seconds;
    Sum thinned_ah;     ///< from every second sample
    Sum thinned_diff2;  ///< sum over days of (full - thinned)^2
  };
  /// Closes the day's difference; totals are complete after it.
  void finish();
  [[nodiscard]] const Total& total(int sign) const { return sign > 0 ? totals_.positive : totals_.negative; }
  /// One standard deviation of total(sign).ah: sigma^2 = (o T / 3600)^2 + (|S - S2| / sqrt 3)^2. The second term is not
  /// taken smaller than the days' differences added in quadrature, since |S - S2| may vanish by chance.
  [[nodiscard]] double sigma_ah(int sign, double offset_a) const;
  [[nodiscard]] bool energy_known() const { return energy_known_; }
  [[nodiscard]] double seconds() const { return seconds_.value(); }

 private:
  struct Point {
    Micros t_us = 0;
    double a = 0.0;
  };
  BySign<Total> totals_;
  BySign<double> day_diff_;
  std::int32_t day_ = 0;
  Point last_, anchor_;
  double last_v_ = kNone;
  bool has_last_ = false;
  bool has_anchor_ = false;
  bool odd_ = false;  // one sample since the anchor
  bool energy_known_ = false;
  Sum seconds_;
  BySign<double> single_;  // trapezoids since the anchor

  void end_run();
  void close_thinned(double positive_ah, double negative_ah);
  void close_day();
};

/// Areas above and below zero under the line from a to b, over `seconds`, in (unit of a) s.
BySign<double> signed_area(double a, double b, double seconds);

/// Sign of charging: that of sum I dSoC over steps with |I| > 1 A.
class CurrentSign {
 public:
  void step(const Row& row);
  /// +1 or -1; +1 (discharge negative, as on the robots seen) when the record does not tell.
  [[nodiscard]] int sign() const { return sum_.value() < 0 ? -1 : 1; }
  /// Share of |I dSoC| that agrees with sign(), 0.5..1; 0 when there was no change of SoC under current.
  [[nodiscard]] double agreement() const;

 private:
  Sum sum_;
  Sum absolute_;
  Micros t_us_ = 0;
  double soc_ = kNone;
  double current_a_ = kNone;
};

/// Noise of the current, from steps between two rows at standstill with the same `charging` flag.
class CurrentNoise {
 public:
  void step(const Row& row);
  /// Standard deviation so far (median of |steps|); NaN with fewer than 64 steps.
  [[nodiscard]] double sigma_a() const { return sigma_a_; }

 private:
  static constexpr std::size_t kBins = 121;  // ten per decade from 1e-6 A up, the first for less
  std::array<std::uint32_t, kBins> bins_{};
  std::uint64_t count_ = 0;
  double sigma_a_ = kNone;
  Micros t_us_ = 0;
  double current_a_ = kNone;
  Flag charging_ = Flag::unknown;
  bool standing_ = false;
};

enum class Use : std::uint8_t { rest, positive, negative };
inline constexpr std::size_t kUses = 3;

/// Charge / rest / discharge with a minimum dwell: shorter excursions belong to the state around them.
class UseClock {
 public:
  explicit UseClock(double dwell_s) : dwell_s_(dwell_s) {}
  void step(const Row& row, double threshold_a);
  [[nodiscard]] double seconds(Use use) const { return seconds_[static_cast<std::size_t>(use)]; }
  void finish();

 private:
  double dwell_s_;
  std::array<double, kUses> seconds_{};
  Use state_ = Use::rest;
  Use candidate_ = Use::rest;
  double candidate_s_ = 0.0;
  Micros t_us_ = 0;
  bool running_ = false;
};

/// A stretch of time that a finding points to.
struct Stretch {
  Micros from_us = 0;
  Micros to_us = 0;
  bool flag_on = false;
};

/// `charging` on while the battery is discharged, or off while it is charged, for longer than contradiction_s. `sign`
/// is the sign of charging.
class Contradictions {
 public:
  Contradictions(int sign, double least_s) : sign_(sign), least_s_(least_s) {}
  void step(const Row& row, double threshold_a);
  void finish() { close(); }
  [[nodiscard]] const std::vector<Stretch>& examples() const { return examples_; }  ///< the first 100
  [[nodiscard]] std::uint64_t count() const { return count_; }
  [[nodiscard]] double seconds() const { return seconds_; }
  [[nodiscard]] double compared_s() const { return compared_s_; }  ///< time with both flag and current

 private:
  int sign_;
  double least_s_;
  std::vector<Stretch> examples_;
  std::uint64_t count_ = 0;
  double seconds_ = 0.0;
  double compared_s_ = 0.0;
  Stretch open_;
  bool is_open_ = false;
  Micros t_us_ = 0;
  void close();
};

}  // namespace tacho::battery
