#include "samples/simulator/motion.hpp"
#include "schema/time.hpp"

#include <algorithm>
#include <cmath>

namespace tacho::sim {
namespace {

constexpr double kShortest = 1e-9;  // metres or radians; less is rounding

Micros whole_micros(double seconds) { return std::max<Micros>(0, std::llround(seconds * 1e6)); }

struct Phase {
  double speed0 = 0;
  double accel = 0;
  Micros duration_us = 0;
};

// Covers `distance` from speed u0 to u1 with a trapezoid. The peak speed is solved again for the rounded durations.
std::array<Phase, 3> trapezoid(double distance, double u0, double u1, double limit, double accel) {
  double peak = std::min(limit, std::sqrt(accel * distance + (u0 * u0 + u1 * u1) / 2));
  peak = std::max({peak, u0, u1});
  const double ramp = (peak * peak - u0 * u0 + peak * peak - u1 * u1) / (2 * accel);
  const Micros up = whole_micros((peak - u0) / accel);
  const Micros flat = whole_micros((distance - ramp) / peak);
  const Micros down = whole_micros((peak - u1) / accel);
  const double weight = to_seconds(up) / 2 + to_seconds(flat) + to_seconds(down) / 2;
  if (weight <= 0) {
    return {};
  }
  peak = (distance - u0 * to_seconds(up) / 2 - u1 * to_seconds(down) / 2) / weight;
  return {Phase{u0, up > 0 ? (peak - u0) / to_seconds(up) : 0.0, up}, Phase{peak, 0.0, flat},
          Phase{peak, down > 0 ? (u1 - peak) / to_seconds(down) : 0.0, down}};
}

// Appends a piece that starts where the last one ended.
void chain(std::vector<Piece>& pieces, Piece piece, Pose start, Micros t_us) {
  if (piece.duration_us <= 0) {
    return;
  }
  piece.t0_us = pieces.empty() ? t_us : pieces.back().end_us();
  piece.start = pieces.empty() ? start : kinematics_at(pieces.back(), pieces.back().end_us()).pose;
  pieces.push_back(piece);
}

Piece along(const Stretch& stretch, const Phase& phase, int direction) {
  Piece piece;
  piece.duration_us = phase.duration_us;
  piece.v0_mps = direction * phase.speed0;
  piece.accel_mps2 = direction * phase.accel;
  piece.curvature = stretch.curvature;
  piece.slowed = stretch.slowed;
  piece.wheel_gain = stretch.wheel_gain;
  return piece;
}

// Highest speeds at the joints of the stretches that the acceleration allows; standstill at both ends.
std::vector<double> joint_speeds(const Run& run, double accel) {
  std::vector<double> speed(run.size() + 1, 0.0);
  for (std::size_t i = 1; i < run.size(); ++i) {
    const double reachable = std::sqrt(speed[i - 1] * speed[i - 1] + 2 * accel * run[i - 1].length_m);
    speed[i] = std::min({run[i - 1].v_max_mps, run[i].v_max_mps, reachable});
  }
  for (std::size_t i = run.size(); i-- > 0;) {
    speed[i] = std::min(speed[i], std::sqrt(speed[i + 1] * speed[i + 1] + 2 * accel * run[i].length_m));
  }
  return speed;
}

}  // namespace

Kinematics kinematics(const Piece& piece, double tau_s) {
  Kinematics k;
  const double s = (piece.v0_mps + piece.accel_mps2 * tau_s / 2) * tau_s;
  const double pivot = (piece.w0_radps + piece.w_accel * tau_s / 2) * tau_s;
  k.v_mps = piece.v0_mps + piece.accel_mps2 * tau_s;
  k.w_radps = piece.curvature * k.v_mps + piece.w0_radps + piece.w_accel * tau_s;
  k.path_m = std::abs(s);
  k.pivot_rad = std::abs(pivot);
  k.heading_rad = piece.curvature * s + pivot;
  const double a0 = piece.start.angle_rad;
  const double a1 = a0 + k.heading_rad;
  k.pose = {piece.start.x_m, piece.start.y_m, a1};
  if (piece.curvature != 0.0) {
    k.pose.x_m += (std::sin(a1) - std::sin(a0)) / piece.curvature;
    k.pose.y_m += (std::cos(a0) - std::cos(a1)) / piece.curvature;
  } else {
    k.pose.x_m += s * std::cos(a0);
    k.pose.y_m += s * std::sin(a0);
  }
  return k;
}

Kinematics kinematics_at(const Piece& piece, Micros t_us) { return kinematics(piece, to_seconds(t_us - piece.t0_us)); }

Piece head(const Piece& piece, Micros t_us) {
  Piece result = piece;
  result.duration_us = t_us - piece.t0_us;
  return result;
}

Piece tail(const Piece& piece, Micros t_us) {
  Piece result = piece;
  const double tau = to_seconds(t_us - piece.t0_us);
  result.start = kinematics(piece, tau).pose;
  result.t0_us = t_us;
  result.duration_us = piece.end_us() - t_us;
  result.v0_mps += piece.accel_mps2 * tau;
  result.w0_radps += piece.w_accel * tau;
  return result;
}

std::vector<Piece> plan_run(const Run& run, Pose start, Micros t_us, double accel_mps2, int direction) {
  std::vector<Piece> pieces;
  const std::vector<double> speed = joint_speeds(run, accel_mps2);
  for (std::size_t i = 0; i < run.size(); ++i) {
    for (const Phase& phase : trapezoid(run[i].length_m, speed[i], speed[i + 1], run[i].v_max_mps, accel_mps2)) {
      chain(pieces, along(run[i], phase, direction), start, t_us);
    }
  }
  return pieces;
}

std::vector<Piece> plan_turn(double angle_rad, Pose start, Micros t_us, double rate_radps, double accel_radps2) {
  std::vector<Piece> pieces;
  if (std::abs(angle_rad) < kShortest) {
    return pieces;
  }
  const double sign = angle_rad < 0 ? -1 : 1;
  for (const Phase& phase : trapezoid(std::abs(angle_rad), 0, 0, rate_radps, accel_radps2)) {
    Piece piece;
    piece.duration_us = phase.duration_us;
    piece.w0_radps = sign * phase.speed0;
    piece.w_accel = sign * phase.accel;
    chain(pieces, piece, start, t_us);
  }
  return pieces;
}

std::vector<Piece> plan_brake(const Run& run, Pose start, Micros t_us, double speed_mps, double brake_mps2,
                              int direction) {
  std::vector<Piece> pieces;
  double speed = speed_mps;
  for (const Stretch& stretch : run) {
    const double left = speed * speed - 2 * brake_mps2 * stretch.length_m;
    if (left <= 0) {
      const Micros duration = whole_micros(speed / brake_mps2);
      chain(pieces, along(stretch, {speed, duration > 0 ? -speed / to_seconds(duration) : 0.0, duration}, direction),
            start, t_us);
      break;
    }
    const Micros duration = std::max<Micros>(1, whole_micros(2 * stretch.length_m / (speed + std::sqrt(left))));
    const double next = 2 * stretch.length_m / to_seconds(duration) - speed;
    chain(pieces, along(stretch, {speed, (next - speed) / to_seconds(duration), duration}, direction), start, t_us);
    speed = next;
  }
  return pieces;
}

double length(const Run& run) {
  double sum = 0;
  for (const Stretch& stretch : run) {
    sum += stretch.length_m;
  }
  return sum;
}

Run take(const Run& run, double distance_m) {
  Run first;
  for (const Stretch& stretch : run) {
    const double cut = std::min(distance_m, stretch.length_m);
    distance_m -= cut;
    if (cut > kShortest) {
      first.push_back(stretch);
      first.back().length_m = cut;
    }
  }
  return first;
}

Run drop(const Run& run, double distance_m) {
  Run rest;
  for (const Stretch& stretch : run) {
    const double cut = std::min(distance_m, stretch.length_m);
    distance_m -= cut;
    if (stretch.length_m - cut > kShortest) {
      rest.push_back(stretch);
      rest.back().length_m -= cut;
    }
  }
  return rest;
}

double path(const std::vector<Piece>& pieces) {
  double sum = 0;
  for (const Piece& piece : pieces) {
    sum += kinematics_at(piece, piece.end_us()).path_m;
  }
  return sum;
}

}  // namespace tacho::sim
