#pragma once
// A11: what the pose and the counter do while the robot stands (zero twist, >= 10 s).
//
// sigma_p, sigma_theta = 1.4826 MAD(successive differences) / sqrt 2, x and y pooled: immune to creep. A pose repeated
// exactly is no new estimate and gives no difference (localisation slower than polling, or frozen while parked). Limits
// +-1.96 * 1.43 sigma / sqrt n: a MAD has 1.17 sigma / sqrt n, and differences that share a pose are correlated.
// Creep = mean of the last third - mean of the first third. The counter must not move by more than its quantum.

#include <vector>

#include "analyzer/analyses/odometry_segments.hpp"
#include "analyzer/report/section.hpp"

namespace tacho::odometry {

struct StillRun {
  Micros from_us = 0;
  Micros to_us = 0;
  double creep_m = 0;
  double creep_rad = 0;
  double counted_m = 0;
};

struct StandstillResult {
  std::uint64_t runs = 0;
  double seconds = 0;
  std::uint64_t frozen_runs = 0;    ///< the pose was repeated all the time
  Quantity sigma_p;                 ///< m; without a value: reason
  Quantity sigma_theta;             ///< rad
  Quantity creep_m;                 ///< median over runs
  std::uint64_t counting_runs = 0;  ///< runs in which the counter moved by more than its quantum
  std::vector<StillRun> worst;      ///< those, at most 100
};

class StandstillFold {
 public:
  explicit StandstillFold(const Config& config) : config_(config) {}
  /// Every row in order, without duplicates.
  void add(const Prepared& prepared);
  [[nodiscard]] StandstillResult finish(double quantum_m);

 private:
  Config config_;
  std::vector<Row> run_;
  std::vector<float> metres_;  ///< differences of x and of y
  std::vector<float> radians_;
  std::uint64_t thinning_ = 1;  ///< every so many-th difference is kept
  std::uint64_t offered_ = 0;
  std::vector<StillRun> runs_;
  std::uint64_t frozen_ = 0;

  void end_run();
  void keep(double dx, double dy, double dtheta);
};

}  // namespace tacho::odometry
