#pragma once
// A5: dead reckoning against localisation.
//
// D accumulates Exp(mean twist dt) along a stretch without cut, jump or row in odometry mode. For L in {1, 2, 5, 10,
// 20, 50, 100} m of counter distance: starts every L/10 from the first row on; start and end are interpolated on SE(2)
// to exactly their distance (at 1 Hz rows are wider apart than L/10). E = (T_i^-1 T_j)^-1 (D_i^-1 D_j), in the frame of
// j: e_par forward, e_perp left, e_theta counter-clockwise; positive = dead reckoning is ahead / left / turned further.
// n_eff = covered length / L. Limits of rms and means: moving-block bootstrap over sums of max(20 m, L), blocks of two.
//
// Drift law. Heading, all L: E e_theta^2 = 2 sigma_theta^2 + q L + b^2 L^2. Position, only pairs with chord/arc >=
// 0.95: E |e|^2 = 4 sigma_p^2 + beta^2 L + (alpha^2 + sigma_theta^2) L^2 + q L^3/3 + b^2 L^4/4. sigmas from A11;
// coefficients by non-negative weighted least squares, weights n_eff / y^2. Raw figure at 10 m: sqrt(y - 4 sigma_p^2 -
// 100 sigma_theta^2)/10.
//
// ATE of a segment: both tracks centred, turned by atan2(sum cross, sum dot), rms of what is left; refused when the
// second singular value of the correlation is below 1e-6 of the first (a straight line). Secondary: it grows with the
// segment.

#include <array>
#include <vector>

#include "analyzer/analyses/odometry_jumps.hpp"

namespace tacho::odometry {

inline constexpr std::array<double, 7> kDriftLengths{1, 2, 5, 10, 20, 50, 100};

struct DriftRow {
  double length_m = 0;
  std::int64_t n = 0;
  double n_eff = 0;
  Quantity rmse_pct;  ///< of |e| / L
  double median_pct = 0;
  double p95_pct = 0;
  Quantity along_pct;        ///< mean e_par / L
  Quantity turn_deg_per_m;   ///< mean e_theta / L
  Quantity turn_rms_deg;     ///< rms of e_theta
  Quantity integration_deg;  ///< rms of the statistical integration error of the heading at this polling rate
  double heading_ms = 0;     ///< mean e_theta^2, rad^2
  double position_ms = 0;    ///< mean |e|^2, m^2
  double straight_ms = 0;    ///< the same over straight pairs
  std::int64_t straight_n = 0;
  double straight_share = 0;
};

struct DriftLaw {
  Quantity heading_walk;  ///< sqrt q, rad/sqrt m
  Quantity heading_bias;  ///< |b|, rad/m
  Quantity walk;          ///< beta, m/sqrt m
  Quantity systematic;    ///< alpha, m/m
  Quantity at_10m;        ///< raw figure, %
};

struct SegmentError {
  std::uint32_t segment = 0;
  Micros from_us = 0;
  Micros to_us = 0;
  double driven_m = 0;
  Quantity ate_m;
};

struct DriftResult {
  std::string reason;  ///< why there are no rows; empty when there are
  std::vector<DriftRow> rows;
  Quantity turn_at_10m_deg;  ///< signed mean of e_theta over 10 m; n = n_eff
  DriftLaw law;
  std::vector<SegmentError> segments;  ///< of stretches of at least 10 m
};

/// A quantity in another unit.
Quantity scaled(Quantity q, double factor, const char* unit);

DriftResult measure_drift(const Track& track, const JumpResult& jumps, const Accelerations& accelerations,
                          const StandstillResult& still, const Config& config);

}  // namespace tacho::odometry
