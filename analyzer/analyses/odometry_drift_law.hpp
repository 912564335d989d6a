#pragma once
// Parts of A5 that work on sums: the drift law and the aligned error of a stretch. Definitions: odometry_drift.hpp.

#include "analyzer/analyses/odometry_drift.hpp"

namespace tacho::odometry {

DriftLaw fit_drift_law(const DriftResult& drift, const StandstillResult& still);

/// ATE of one stretch, from running sums about its first pose.
class AlignedError {
 public:
  explicit AlignedError(const Row& first);
  void add(const Row& row, const Pose& reckoned);
  [[nodiscard]] SegmentError finish(double driven_m) const;

 private:
  Row first_;
  Micros last_us_;
  double n_ = 1.0;
  // Sums of located (p) and reckoned (r) positions and their products.
  double px_ = 0, py_ = 0, rx_ = 0, ry_ = 0;
  double pp_ = 0, rr_ = 0;
  double pxrx_ = 0, pxry_ = 0, pyrx_ = 0, pyry_ = 0;
};

}  // namespace tacho::odometry
