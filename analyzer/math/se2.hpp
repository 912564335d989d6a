#pragma once
// SE(2): poses and twists in the plane, in double precision.
//
// Conventions: x forward, y left, angle counter-clockwise positive, radians. A Pose maps coordinates of its own frame
// into the parent frame. Exp of a twist held for dt, with phi = w dt (METHODS A.2):
//   dx = (A vx - C vy) dt,  dy = (C vx + A vy) dt,  dtheta = phi,
//   A = sin(phi)/phi, C = 2 sin^2(phi/2)/phi; below |phi| = 1e-4 their series, whose next terms are below 1e-18.
// Log is its inverse with the same A and C. Angles are never wrapped by compose or exp; wrap with wrap_pi.

#include <cmath>

namespace tacho {

inline constexpr double kPi = 3.14159265358979323846;
inline constexpr double kToDegrees = 180.0 / kPi;

/// The same direction in (-pi, pi].
inline double wrap_pi(double angle) {
  const double wrapped = std::remainder(angle, 2.0 * kPi);
  return wrapped <= -kPi ? kPi : wrapped;
}

struct Twist {
  double vx = 0.0;  ///< m/s
  double vy = 0.0;  ///< m/s
  double w = 0.0;   ///< rad/s
};

struct Pose {
  double x = 0.0;      ///< m
  double y = 0.0;      ///< m
  double angle = 0.0;  ///< rad
};

/// A and C of the header comment.
struct ArcTerms {
  double a = 1.0;
  double c = 0.0;
};
inline ArcTerms arc_terms(double phi) {
  if (std::abs(phi) < 1e-4) {
    return {1.0 - phi * phi / 6.0, phi / 2.0 - phi * phi * phi / 24.0};
  }
  const double half = std::sin(phi / 2.0);
  return {std::sin(phi) / phi, 2.0 * half * half / phi};
}

/// The pose reached from the origin after `dt` seconds of constant twist.
inline Pose exp_se2(const Twist& twist, double dt) {
  const double phi = twist.w * dt;
  const ArcTerms t = arc_terms(phi);
  return {(t.a * twist.vx - t.c * twist.vy) * dt, (t.c * twist.vx + t.a * twist.vy) * dt, phi};
}

/// The twist that reaches `pose` from the origin in one second. The arc taken is the one with |angle| as given: wrap
/// first.
inline Twist log_se2(const Pose& pose) {
  const ArcTerms t = arc_terms(pose.angle);
  const double det = t.a * t.a + t.c * t.c;
  return {(t.a * pose.x + t.c * pose.y) / det, (t.a * pose.y - t.c * pose.x) / det, pose.angle};
}

/// b, given in the frame of a, in the frame of a's parent.
inline Pose compose(const Pose& a, const Pose& b) {
  const double c = std::cos(a.angle);
  const double s = std::sin(a.angle);
  return {a.x + c * b.x - s * b.y, a.y + s * b.x + c * b.y, a.angle + b.angle};
}

inline Pose inverse(const Pose& p) {
  const double c = std::cos(p.angle);
  const double s = std::sin(p.angle);
  return {-c * p.x - s * p.y, s * p.x - c * p.y, -p.angle};
}

/// a^-1 b: b seen from a, angle wrapped.
inline Pose between(const Pose& a, const Pose& b) {
  const double c = std::cos(a.angle);
  const double s = std::sin(a.angle);
  const double dx = b.x - a.x;
  const double dy = b.y - a.y;
  return {c * dx + s * dy, -s * dx + c * dy, wrap_pi(b.angle - a.angle)};
}

/// The pose at `share` (0..1) of the constant-twist arc from a to b, turning the short way.
inline Pose interpolate(const Pose& a, const Pose& b, double share) {
  return compose(a, exp_se2(log_se2(between(a, b)), share));
}

}  // namespace tacho
