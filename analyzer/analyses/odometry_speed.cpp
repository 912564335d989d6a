#include "analyzer/analyses/odometry_speed.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "analyzer/math/bootstrap.hpp"
#include "analyzer/math/robust.hpp"

namespace tacho::odometry {
namespace {

/// (a^2 dt^2 - dv^2) / 4a with a raised to |dv|/dt where needed.
double trapezoid_bound(double a, double dv, double dt) {
  const double raised = std::max(a, std::abs(dv) / dt);
  return raised > 0.0 ? (raised * raised * dt * dt - dv * dv) / (4.0 * raised) : 0.0;
}

BootstrapOptions bootstrap_options(const Config& config, std::size_t block) {
  BootstrapOptions options;
  options.block = block;
  options.draws = static_cast<int>(config.draws);
  return options;
}

/// Builds windows of A2 from intervals.
class WindowBuilder {
 public:
  WindowBuilder(const Config& config, double quantum_m, double per_pivot_radian)
      : config_(config), q2_(quantum_m * quantum_m / 6.0), per_radian_(per_pivot_radian) {}

  void add(const Row& a, const Row& b, const Interval& interval, double bound_m) {
    if (!open_) {
      window_ = {a.t_us, b.t_us, 0.0, 0.0, 0.0, 0.0, 0.0, 1};
      variance_ = q2_;
      open_ = true;
    } else if (broken_) {
      ++window_.pieces;
      variance_ += q2_;
    }
    broken_ = false;
    window_.to_us = b.t_us;
    window_.integral_m += interval.metres;
    window_.counted_m += interval.counted_m;
    if (!interval.standing) {
      const double pivot = pivot_radians(a, b, interval, config_);
      window_.pivot_rad += pivot;
      window_.counted_m -= per_radian_ * pivot;
      variance_ += bound_m * bound_m / 3.0;
      window_.bound_m += bound_m;
    }
    const double u = std::sqrt(variance_) / window_.integral_m;
    if (window_.integral_m >= config_.window_m &&
        (u <= config_.speed_u_max || window_.integral_m >= config_.window_max_m)) {
      close();
    }
  }
  void interrupt() { broken_ = true; }
  std::vector<SpeedWindow> take() {
    if (open_ && window_.integral_m >= config_.window_m) {
      close();
    }
    return std::move(windows_);
  }

 private:
  Config config_;
  double q2_;
  double per_radian_;
  bool open_ = false;
  bool broken_ = false;
  SpeedWindow window_;
  double variance_ = 0.0;
  std::vector<SpeedWindow> windows_;

  void close() {
    window_.sigma_m = std::sqrt(variance_);
    windows_.push_back(window_);
    open_ = false;
  }
};

constexpr unsigned kNeeded = kOdo | kSpeed;

}  // namespace

double Accelerations::metres(const Row& a, const Row& b, const Interval& interval) const {
  return interval.standing ? 0.0 : trapezoid_bound(linear, b.speed() - a.speed(), interval.dt_s);
}

double Accelerations::radians(const Row& a, const Row& b, const Interval& interval) const {
  if (interval.standing) {
    return 0.0;
  }
  const double dw = static_cast<double>(b.w) - static_cast<double>(a.w);
  const double bound = trapezoid_bound(angular, dw, interval.dt_s);
  return resolves_turning(interval.dt_s) ? bound : std::max(bound, 0.5 * std::abs(dw) * interval.dt_s);
}

Accelerations measure_accelerations(const Track& track, const Config& config) {
  std::vector<double> linear;
  std::vector<double> angular;
  std::vector<double> turns;
  const std::vector<Row>& rows = track.rows();
  for (std::size_t k = 1; k < rows.size(); ++k) {
    const Interval i = interval_of(rows[k - 1], rows[k], config);
    if (rows[k].all(kCut) || !rows[k].all(kSpeed) || i.standing || i.dt_s <= 0.0) {
      continue;
    }
    linear.push_back(std::abs(rows[k].speed() - rows[k - 1].speed()) / i.dt_s);
    turns.push_back(std::abs(static_cast<double>(rows[k].w)));
    angular.push_back(std::abs(static_cast<double>(rows[k].w) - static_cast<double>(rows[k - 1].w)) / i.dt_s);
  }
  Accelerations result;
  result.moving_intervals = linear.size();
  result.linear = config.accel_floor_mps2;
  result.angular = config.turn_accel_floor_radps2;
  if (!linear.empty()) {
    result.linear = std::max(result.linear, quantile(linear, 0.999));
    result.angular = std::max(result.angular, quantile(angular, 0.999));
    result.hardest = *std::max_element(linear.begin(), linear.end());
    result.fastest_turn = quantile(turns, 0.999);
  }
  result.raised = static_cast<std::uint64_t>(
      std::count_if(linear.begin(), linear.end(), [&](double a) { return a > result.linear; }));
  return result;
}

double pivot_radians(const Row& a, const Row& b, const Interval& interval, const Config& config) {
  if (interval.standing) {
    return 0.0;
  }
  const auto part = [&](const Row& row) {
    return row.speed() < config.pivot_mps ? std::abs(static_cast<double>(row.w)) : 0.0;
  };
  return 0.5 * (part(a) + part(b)) * interval.dt_s;
}

bool counter_jumped(const Interval& interval, const Config& config, double quantum_m) {
  return interval.counted_m > config.v_max_mps * interval.dt_s + quantum_m;
}

bool SpeedWindow::excludes_one(double quantum_m) const {
  const double q = quantum_m * pieces;
  const double lowest = (counted_m - q) / (integral_m + bound_m);
  const double highest = bound_m < integral_m ? (counted_m + q) / (integral_m - bound_m) : HUGE_VAL;
  return lowest > 1.0 || highest < 1.0;
}

namespace {

void summarise(SpeedResult& r, const Config& config, double quantum_m, double per_radian_doubt) {
  std::vector<double> g;
  std::vector<double> weight;
  std::vector<double> u;
  double spread = 0.0;
  double total = 0.0;
  double excluding = 0.0;
  double pivots = 0.0;
  for (const SpeedWindow& w : r.windows) {
    g.push_back(w.g());
    u.push_back(w.u());
    weight.push_back(1.0 / (w.u() * w.u() + 1e-12));
    spread += weight.back() * weight.back() * w.u() * w.u();
    total += weight.back();
    pivots += w.pivot_rad;
    excluding += w.excludes_one(quantum_m) ? 1.0 : 0.0;
  }
  const auto n = static_cast<std::int64_t>(g.size());
  const double value = weighted_median(g, weight);
  const BootstrapOptions options = bootstrap_options(config, 2);
  const Limits boot = around(value, bootstrap_weighted_median(g, weight, options));
  const double half = 1.96 * std::sqrt(spread) / total;
  const double doubt = per_radian_doubt * pivots / r.driven_m;
  r.g = {value,
         "1",
         std::min(boot.lo, value - half) - doubt,
         std::max(boot.hi, value + half) + doubt,
         n,
         r.driven_m / 1000.0,
         too_few_to_draw(g.size(), options.block)};
  if (!r.g.reason.empty()) {
    r.g.lo = r.g.hi = std::nullopt;
  }
  r.u = {median(u), "1", {}, {}, n, {}, ""};
  r.excluding_one = {excluding / static_cast<double>(n), "1", {}, {}, n, {}, ""};
  if (value < 0.05 || std::abs(value - 1.5625) < 0.03) {
    r.signature = value < 0.05 ? "the counter stands while the robot drives: steps too small for a float32 sum"
                               : "the counter runs 1.56 times too fast: 10 mm steps rounded up in a float32 sum";
  }
}

}  // namespace

SpeedResult compare_speed(const Track& track, const Accelerations& accelerations, const CountsResult& counts,
                          const Config& config, double quantum_m) {
  WindowBuilder builder(config, quantum_m, counts.taken_off);
  const std::vector<Row>& rows = track.rows();
  bool speed = false;
  for (std::size_t k = 1; k < rows.size(); ++k) {
    const Row& a = rows[k - 1];
    const Row& b = rows[k];
    const Interval i = interval_of(a, b, config);
    speed = speed || b.all(kNeeded);
    if (b.all(kCut) || !a.all(kNeeded) || !b.all(kNeeded) || counter_jumped(i, config, quantum_m)) {
      builder.interrupt();
      continue;
    }
    builder.add(a, b, i, accelerations.metres(a, b, i));
  }
  SpeedResult r;
  r.windows = builder.take();
  for (const SpeedWindow& w : r.windows) {
    r.driven_m += w.integral_m;
  }
  if (!r.windows.empty()) {
    summarise(r, config, quantum_m, counts.taken_off_doubt);
    if (*r.u.value > config.speed_u_max) {
      const std::string why =
          fmt::format("period {:.3g} s: the speed between two polls is known to {:.2g} % only, {:.2g} % needed",
                      track.period_s(), 100.0 * *r.u.value, 100.0 * config.speed_u_max);
      r.g = {{}, "1", {}, {}, r.g.n, r.g.exposure, why};
      r.signature.clear();
    }
    return r;
  }
  const std::string reason = speed ? "nothing driven: no window of 20 m" : "the log has no odo or no vx";
  r.g = {{}, "1", {}, {}, 0, 0.0, reason};
  r.u = {{}, "1", {}, {}, 0, {}, reason};
  r.excluding_one = r.u;
  return r;
}

}  // namespace tacho::odometry
