#pragma once
// A3: the counter against the localised path.
//
// Strides: from one kept pose to the next that is at least d_min = max(0.20 m, 10 sigma_p) away, so that a standing
// robot does not drive. Path of a stride: l = d / rho - sigma_p^2 / d: arc from chord, minus what noise adds to a
// distance. rho = chord / arc of the stride's shape: the intervals inside it as circular arcs, each as long as the
// counter grew and turning as the poses turned. For a stride of one interval rho = sin(h/2)/(h/2), the formula of
// METHODS; a stride around a turn on the spot, where the heading changes without metres, is not taken for an arc. Left
// out, with their counter metres: strides that turn more than 1 rad, are more bent than rho = 0.85 (reversing), hold a
// jump, a cut, a counter jump, or a row in odometry mode (its pose is not independent of the counter). Strides share
// their end poses, so errors of kept poses cancel along a stretch.
//
// s_o = sum l / sum counter growth (path metres per counter metre). Limits: hull of the moving-block bootstrap (blocks
// of 20 m) and s_o +- 1.96 u, u^2 = chains (2 sigma_p^2 + q^2/6) / (sum growth)^2; then widened by the doubted share
// (25 %) of the arc and noise corrections. 25 %: arcs that begin or end inside a poll interval are corrected 20 % too
// little on average (phase uniform), arcs that fill it exactly.

#include <vector>

#include "analyzer/analyses/odometry_jumps.hpp"

namespace tacho::odometry {

struct PathResult {
  Quantity s_o;         ///< exposure: km of counter growth used
  double stride_m = 0;  ///< d_min used
  std::uint64_t strides = 0;
  std::uint64_t chains = 0;  ///< uninterrupted stretches of strides
  double path_m = 0;
  double counted_m = 0;
  double left_out_m = 0;        ///< counter metres of strides left out
  double arc_correction = 0;    ///< share of path_m
  double noise_correction = 0;  ///< share of path_m
  /// For a curve: end time of stretches of at least 100 m and their s_o.
  std::vector<Micros> curve_t_us;
  std::vector<double> curve;
};

PathResult compare_path(const Track& track, const JumpResult& jumps, const StandstillResult& still,
                        const CountsResult& counts, const Config& config, double quantum_m);

}  // namespace tacho::odometry
