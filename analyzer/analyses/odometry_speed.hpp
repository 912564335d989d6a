#pragma once
// The measured speed against the counter: integration bound (METHODS A.2), A4 (what the counter counts), A2 (scale).
//
// Integration bound of one interval, |dv/dt| <= a: |int v - trapezoid| <= b = (a^2 dt^2 - dv^2) / (4 a). a is the 99.9
// percentile of |dv|/dt while moving, at least accel_floor; where |dv| > a dt, a is raised to |dv|/dt for that interval
// (then b = 0) and the interval counted. The same for the turning rate. Where a dt reaches the fastest turn (99.9
// percentile of |w|), polling does not resolve a: a change may be over long before the next poll; then b of the turning
// rate is at least |dw| dt / 2, the error of any monotone change. Hard bound B = sum b, statistical sigma_I^2 =
// sum b^2 / 3. While the robot stands (zero twist at both ends, counter unchanged) nothing is integrated.
//
// A4: counter growth = a int|v| + b int|w| [|v| < 0.02] over windows of at least 5 s that end while the robot does not
// turn (at most 10 s), by least squares; limits by moving-block bootstrap. b = 0: the centre's path. b = half the
// track: mean of the wheels' paths. Needs 30 rad of turning on the spot.
//
// A2: per window g = counter growth / int|v|, u_g = sqrt(q^2/6 + sigma_I^2) / I; the hard interval is
// [growth - q, growth + q] / [I +- B]. A window closes at 20 m as soon as u_g is below 1 %, at 500 m in any case. When
// the counter counts wheels, b int|w|[..] is taken off first. g of the record: median weighted with 1/u_g^2; its
// interval is the hull of the moving-block bootstrap over windows and g +- 1.96 u, u^2 = sum w^2 u_g^2 / (sum w)^2.

#include <optional>
#include <vector>

#include "analyzer/analyses/odometry_counter.hpp"
#include "analyzer/analyses/odometry_segments.hpp"
#include "analyzer/report/section.hpp"

namespace tacho::odometry {

struct Accelerations {
  double linear = 0;        ///< m/s^2
  double angular = 0;       ///< rad/s^2
  double hardest = 0;       ///< m/s^2, largest |dv|/dt of all
  double fastest_turn = 0;  ///< rad/s
  std::uint64_t moving_intervals = 0;
  std::uint64_t raised = 0;  ///< intervals above the linear bound
  /// b of the interval from a to b.
  [[nodiscard]] double metres(const Row& a, const Row& b, const Interval& interval) const;
  [[nodiscard]] double radians(const Row& a, const Row& b, const Interval& interval) const;
  /// Whether polling with this period shows how fast the robot gains turning speed.
  [[nodiscard]] bool resolves_turning(double dt_s) const { return angular * dt_s < 0.9 * fastest_turn; }
};
Accelerations measure_accelerations(const Track& track, const Config& config);

/// Turning on the spot inside an interval: trapezoid of |w| at the ends where |v| < pivot_mps.
double pivot_radians(const Row& a, const Row& b, const Interval& interval, const Config& config);

/// True when the counter grew more than the robot can drive: not usable for scales.
bool counter_jumped(const Interval& interval, const Config& config, double quantum_m);

struct CountsResult {
  Quantity a;  ///< counter metres per metre of speed
  Quantity b;  ///< counter metres per radian on the spot
  double pivot_rad = 0;
  std::string verdict;         ///< in words
  bool wheels = false;         ///< taken_off must be taken off
  double taken_off = 0;        ///< m/rad
  double taken_off_doubt = 0;  ///< its half-width
};
CountsResult find_what_it_counts(const Track& track, const Accelerations& accelerations, const Config& config,
                                 double quantum_m);

struct SpeedWindow {
  Micros from_us = 0;
  Micros to_us = 0;
  double integral_m = 0;
  double counted_m = 0;  ///< corrected for turning on the spot
  double sigma_m = 0;    ///< sqrt(q^2/6 pieces + sigma_I^2)
  double bound_m = 0;    ///< B
  double pivot_rad = 0;  ///< turning on the spot
  int pieces = 1;        ///< uninterrupted stretches in it
  [[nodiscard]] double g() const { return counted_m / integral_m; }
  [[nodiscard]] double u() const { return sigma_m / integral_m; }
  [[nodiscard]] bool excludes_one(double quantum_m) const;
};

struct SpeedResult {
  Quantity g;
  Quantity u;              ///< usual u_g of a window (median)
  Quantity excluding_one;  ///< share of windows whose hard interval excludes 1
  double driven_m = 0;     ///< int |v| over all windows
  std::vector<SpeedWindow> windows;
  std::string signature;  ///< float32 accumulation recognised, else empty
};
SpeedResult compare_speed(const Track& track, const Accelerations& accelerations, const CountsResult& counts,
                          const Config& config, double quantum_m);

}  // namespace tacho::odometry
