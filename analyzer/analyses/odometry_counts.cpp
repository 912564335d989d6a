// A4: what the odometer counts. Declared in odometry_speed.hpp.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "analyzer/analyses/odometry_speed.hpp"
#include "analyzer/math/bootstrap.hpp"
#include "analyzer/math/least_squares.hpp"

namespace tacho::odometry {
namespace {

constexpr double kShortest_s = 5.0;
constexpr double kLongest_s = 10.0;
constexpr double kTurning_radps = 0.05;
constexpr double kTellsApart_m = 0.1;  // half of a narrow robot's track

struct Windows {
  std::vector<double> counted;
  std::vector<double> driven;
  std::vector<double> turned;
  double turned_total = 0.0;
};

struct Sum {
  double seconds = 0, counted = 0, driven = 0, turned = 0;
};

Windows collect(const Track& track, const Config& config, double quantum_m) {
  Windows windows;
  Sum sum;
  const std::vector<Row>& rows = track.rows();
  for (std::size_t k = 1; k < rows.size(); ++k) {
    const Row& a = rows[k - 1];
    const Row& b = rows[k];
    const Interval i = interval_of(a, b, config);
    const unsigned needed = kOdo | kSpeed | kTurn;
    const bool usable =
        !b.all(kCut) && a.all(needed) && b.all(needed) && i.dt_s > 0.0 && !counter_jumped(i, config, quantum_m);
    if (usable && !i.standing && i.dt_s <= kLongest_s) {
      sum.seconds += i.dt_s;
      sum.counted += i.counted_m;
      sum.driven += i.metres;
      sum.turned += pivot_radians(a, b, i, config);
    } else if (!usable) {
      sum = {};
      continue;
    }
    const bool turning = std::abs(static_cast<double>(b.w)) > kTurning_radps;
    if ((sum.seconds >= kShortest_s && !turning) || sum.seconds >= kLongest_s) {
      windows.counted.push_back(sum.counted);
      windows.driven.push_back(sum.driven);
      windows.turned.push_back(sum.turned);
      windows.turned_total += sum.turned;
      sum = {};
    }
  }
  return windows;
}

void describe(CountsResult& r, const Config& config) {
  const double b = *r.b.value;
  const double half_track = config.track_m.value_or(0.0) / 2.0;
  const bool is_zero = *r.b.lo <= 0.0 && *r.b.hi >= 0.0;
  const bool is_half =
      half_track > 0.0 && (std::abs(b / half_track - 1.0) < 0.15 || (*r.b.lo <= half_track && *r.b.hi >= half_track));
  const double half_width = 0.5 * (*r.b.hi - *r.b.lo);
  if (half_width > kTellsApart_m) {
    r.verdict = fmt::format("unknown: at this polling rate b is known to {:.2g} m per radian only", half_width);
    return;
  }
  if ((is_zero && std::abs(b) < 0.05) || std::abs(b) < 0.02) {
    r.verdict = "path of the robot's centre";
  } else if (is_half) {
    r.wheels = true;
    r.taken_off = half_track;
    r.verdict = fmt::format("mean of the wheels' paths: b is half the track of {:.3g} m", *config.track_m);
  } else if (!config.track_m && *r.b.lo > 0.05 && b < 0.8) {
    r.wheels = true;
    r.verdict = fmt::format("mean of the wheels' paths, if the track is {:.2g} m", 2.0 * b);
  } else {
    r.wheels = *r.b.lo > 0.0;
    r.verdict = fmt::format("neither the centre's path nor the wheels': {:.3g} m per radian on the spot", b);
  }
  if (r.wheels && r.taken_off == 0.0) {
    r.taken_off = b;
    r.taken_off_doubt = 0.5 * (*r.b.hi - *r.b.lo);
  }
}

}  // namespace

CountsResult find_what_it_counts(const Track& track, const Accelerations& accelerations, const Config& config,
                                 double quantum_m) {
  CountsResult r;
  r.a.unit = "1";
  r.b.unit = "m/rad";
  const Windows windows = collect(track, config, quantum_m);
  const auto n = static_cast<Eigen::Index>(windows.counted.size());
  r.pivot_rad = windows.turned_total;
  r.a.n = r.b.n = n;
  if (windows.turned_total < config.pivot_min_rad) {
    r.a.reason = r.b.reason =
        fmt::format("{:.3g} rad turned on the spot, {:.3g} needed", windows.turned_total, config.pivot_min_rad);
    r.verdict = "unknown: " + r.b.reason;
    return r;
  }
  Eigen::MatrixXd effects(n, 2);
  effects.col(0) = Eigen::Map<const Eigen::VectorXd>(windows.driven.data(), n);
  effects.col(1) = Eigen::Map<const Eigen::VectorXd>(windows.turned.data(), n);
  const LinearFit fit = least_squares(effects, Eigen::Map<const Eigen::VectorXd>(windows.counted.data(), n));
  if (!fit.ok()) {
    r.a.reason = r.b.reason = fit.problem;
    r.verdict = "unknown: " + fit.problem;
    return r;
  }
  BootstrapOptions options;
  options.block = 6;
  options.draws = static_cast<int>(config.draws);
  const std::string too_few = too_few_to_draw(windows.counted.size(), options.block);
  if (!too_few.empty()) {
    r.a.value = fit.coefficients(0);
    r.b.value = fit.coefficients(1);
    r.a.reason = r.b.reason = too_few;
    r.verdict = "unknown: " + too_few;
    return r;
  }
  const PairLimits limits = bootstrap_two_slopes(windows.counted, windows.driven, windows.turned, options);
  const double at_stop = accelerations.linear * track.period_s() * track.period_s() / 6.0;
  const double per_window = at_stop / (effects.col(0).mean() + 1e-9);
  r.a.value = fit.coefficients(0);
  const Limits a = around(*r.a.value, limits.a);
  r.a.lo = a.lo - per_window;
  r.a.hi = a.hi + per_window;
  r.b.value = fit.coefficients(1);
  const Limits b = around(*r.b.value, limits.b);
  r.b.lo = b.lo - at_stop;
  r.b.hi = b.hi + at_stop;
  describe(r, config);
  return r;
}

}  // namespace tacho::odometry
