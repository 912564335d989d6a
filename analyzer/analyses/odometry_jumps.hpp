#pragma once
// A9: localisation jumps. For consecutive poses e = predicted^-1 * observed, predicted = pose * Exp(mean twist dt):
// a jump if |e_t| > max(0.10 m, 6 sigma_e + b_k) or |e_theta| > max(3 deg, 6 sqrt2 sigma_theta + b_theta), with
// sigma_e^2 = 2 sigma_p^2 + (I sigma_theta)^2. Noise and bound are added: a robot that attains the bound, e.g. by a
// peak of speed between two polls, still has its noise; with the larger of the two a day at 1 Hz gave false jumps.
//
// b_k, b_theta: the integration bounds, but at least |dv| dt / 2 and |dw| dt / 2 (any monotone change: a robot that
// brakes harder than ever before), and b_k with I b_theta / 2. Where polling does not resolve how fast the robot turns,
// a robot that turns at one of the polls may be off by half its fastest turn. Where there was time to stop and turn on
// the spot between two polls (v0 + v1 <= 1.1 dt times the hardest |dv|/dt seen), b_theta is what the fastest turn could
// do unseen, and b_k includes I |phi| / 2 (first driven, then turned).
//
// What is allowed grows with the square of the period: of steps of 0.5 m a robot at 1 m/s shows all at 1 s, a quarter
// at 2 s. "No jump" says something only where a step of jump_seen_m would have shown on most of the distance.
//
// Not a jump when the error goes on in a neighbouring interval (40 % of it, and more than half of what the neighbour
// may be off by itself): that is slip. Across a hole (gap, restart, lost localisation) only a robot whose counter did
// not move can be judged. Cause, in order: map, localisation, method, confidence, gap ("cannot tell"), unexplained.

#include "analyzer/analyses/odometry_speed.hpp"
#include "analyzer/analyses/odometry_standstill.hpp"

namespace tacho::odometry {

enum class JumpCause : std::uint8_t { map, localisation, method, confidence, gap, unexplained };
inline constexpr std::size_t kJumpCauseCount = 6;
std::string_view jump_cause_name(JumpCause cause);
std::string_view jump_cause_meaning(JumpCause cause);

struct Jump {
  std::size_t row = 0;  ///< index in Track::rows() of the first row after it
  Micros from_us = 0;
  Micros to_us = 0;
  Pose before;      ///< pose of the row before, map frame
  double dx_m = 0;  ///< observed - predicted, map frame
  double dy_m = 0;
  double dangle_rad = 0;
  double allowed_m = 0;
  double allowed_rad = 0;
  double confidence = -1;  ///< lowest within 2 s; -1 = none
  JumpCause cause = JumpCause::unexplained;
  bool resolved = false;  ///< a step of jump_seen_m would have shown here
};

struct JumpResult {
  std::vector<Jump> jumps;
  double km = 0;                ///< counter distance over which jumps were looked for
  double seen_km = 0;           ///< part of it on which a step of jump_seen_m would have shown
  std::uint64_t sustained = 0;  ///< intervals that were off together with a neighbour
  std::uint64_t intervals = 0;
  Quantity unexplained_per_km;  ///< over seen_km, Garwood limits; missing when that is less than half
  double least_per_km = 0;      ///< lower limit over all of km: jumps that did not show can only raise the rate
  double period_s = kNone;
  std::string reason;  ///< why nothing could be looked at; empty when it could
  [[nodiscard]] std::uint64_t count(JumpCause cause) const;
  /// True when a pose track is cut between rows row-1 and row.
  [[nodiscard]] bool at(std::size_t row) const;
};

JumpResult find_jumps(const Track& track, const Accelerations& accelerations, const StandstillResult& still,
                      const Config& config);

}  // namespace tacho::odometry
