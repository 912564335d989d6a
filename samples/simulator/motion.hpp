#pragma once
// Motion in closed form: pieces of constant acceleration along a constant curvature, or of constant angular
// acceleration on the spot. Times are whole microseconds; speeds are fitted to them, so that distances are exact.

#include <array>
#include <vector>

#include "schema/sample.hpp"

namespace tacho::sim {

struct Pose {
  double x_m = 0, y_m = 0, angle_rad = 0;
};

/// A length of floor that is driven at one speed limit.
struct Stretch {
  double length_m = 0;
  double curvature = 0;  ///< 1/m, positive = to the left
  double v_max_mps = 1;
  bool slowed = false;
  double wheel_gain = 1;  ///< wheel metres per true metre; not 1 where the wheels slip
};
/// Driven without a stop, from standstill to standstill.
using Run = std::vector<Stretch>;

struct Piece {
  Micros t0_us = 0;
  Micros duration_us = 0;
  Pose start;
  double v0_mps = 0;  ///< along the heading, negative = backwards; keeps its sign inside a piece
  double accel_mps2 = 0;
  double curvature = 0;
  double w0_radps = 0;  ///< turning on the spot
  double w_accel = 0;   ///< rad/s^2
  bool slowed = false;
  double wheel_gain = 1;
  [[nodiscard]] Micros end_us() const { return t0_us + duration_us; }
};

/// State inside a piece. Distances are since its start.
struct Kinematics {
  Pose pose;
  double v_mps = 0, w_radps = 0;
  double path_m = 0;       ///< never negative
  double heading_rad = 0;  ///< signed
  double pivot_rad = 0;    ///< turned on the spot, never negative
};
Kinematics kinematics(const Piece& piece, double tau_s);
Kinematics kinematics_at(const Piece& piece, Micros t_us);

/// The part of a piece before and after `t_us`.
Piece head(const Piece& piece, Micros t_us);
Piece tail(const Piece& piece, Micros t_us);

/// Drives `run` from standstill to standstill; `direction` -1 = backwards.
std::vector<Piece> plan_run(const Run& run, Pose start, Micros t_us, double accel_mps2, int direction = 1);
/// Turns on the spot by `angle_rad`.
std::vector<Piece> plan_turn(double angle_rad, Pose start, Micros t_us, double rate_radps, double accel_radps2);
/// Brakes from `speed_mps` with `brake_mps2` along `run`, which is longer than the braking distance.
std::vector<Piece> plan_brake(const Run& run, Pose start, Micros t_us, double speed_mps, double brake_mps2,
                              int direction = 1);

double length(const Run& run);
/// The first `distance_m` of `run`.
Run take(const Run& run, double distance_m);
/// What is left of `run` after `distance_m`.
Run drop(const Run& run, double distance_m);
double path(const std::vector<Piece>& pieces);

}  // namespace tacho::sim
