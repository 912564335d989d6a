#include "analyzer/analyses/odometry_path.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <complex>

#include "analyzer/math/bootstrap.hpp"

namespace tacho::odometry {
namespace {

constexpr double kUnit_m = 2.0;  // strides are summed to about this before the bootstrap
constexpr double kBlock_m = 20.0;
constexpr double kCurve_m = 100.0;
constexpr double kPivot_rad = 0.01;

/// The shape of a stride so far, drawn with the counter's metres.
struct Shape {
  std::complex<double> chord;
  double metres = 0.0;   ///< as drawn
  double counted = 0.0;  ///< counter growth
  double turned = 0.0;
  bool bad = false;

  void add(const Row& a, const Row& b, const Interval& i) {
    const double h = wrap_pi(static_cast<double>(b.angle) - static_cast<double>(a.angle));
    const double course = i.metres > 0.0 ? std::atan2(i.twist.vy, i.twist.vx) : 0.0;
    const double length = std::max(i.counted_m, 0.0);
    const double sinc = std::abs(h) < 1e-6 ? 1.0 : std::sin(0.5 * h) / (0.5 * h);
    chord += std::polar(length * sinc, static_cast<double>(a.angle) + 0.5 * h + course);
    metres += length;
    counted += i.counted_m;
    turned += h;
  }
  /// Chord / arc; without counter metres the formula of one arc.
  [[nodiscard]] double ratio() const {
    if (metres > 0.0) {
      return std::abs(chord) / metres;
    }
    return std::abs(turned) < 1e-6 ? 1.0 : std::sin(0.5 * turned) / (0.5 * turned);
  }
};

class Strider {
 public:
  Strider(const Config& config, double sigma_p) : config_(config), sigma2_(sigma_p * sigma_p) {
    result_.stride_m = std::max(config.stride_m, config.stride_sigmas * sigma_p);
  }

  void start(const Row& row) {
    flush_unit();
    in_chain_ = false;
    left_out();
    anchor_ = row;
    shape_ = Shape{};
  }

  /// `spoilt`: the counter's growth in this interval is not the centre's path.
  void step(const Row& a, const Row& b, const Interval& i, bool spoilt) {
    shape_.add(a, b, i);
    shape_.bad = shape_.bad || spoilt;
    const double d = std::hypot(b.x - anchor_.x, b.y - anchor_.y);
    if (d < result_.stride_m) {
      return;
    }
    const double ratio = shape_.ratio();
    if (shape_.bad || std::abs(shape_.turned) >= config_.stride_turn_rad || ratio < config_.stride_ratio_min) {
      start(b);
      return;
    }
    const double path = d / ratio - sigma2_ / d;
    result_.arc_correction += d / ratio - d;
    result_.noise_correction += sigma2_ / d;
    result_.path_m += path;
    result_.counted_m += shape_.counted;
    ++result_.strides;
    result_.chains += in_chain_ ? 0U : 1U;
    in_chain_ = true;
    unit_path_ += path;
    unit_counted_ += shape_.counted;
    if (unit_counted_ >= kUnit_m) {
      flush_unit();
    }
    add_to_curve(b.t_us, path);
    anchor_ = b;
    shape_ = Shape{};
  }

  PathResult finish(double quantum_m) {
    flush_unit();
    left_out();
    if (result_.strides == 0) {
      return std::move(result_);
    }
    PathResult& r = result_;
    const double value = r.path_m / r.counted_m;
    BootstrapOptions options;
    options.draws = static_cast<int>(config_.draws);
    const double unit = r.counted_m / static_cast<double>(paths_.size());
    options.block = static_cast<std::size_t>(std::max(1.0, std::ceil(kBlock_m / unit)));
    r.s_o.reason = too_few_to_draw(paths_.size(), options.block);
    const Limits boot = around(value, bootstrap_ratio(paths_, counts_, options));
    const double chain = 2.0 * sigma2_ + quantum_m * quantum_m / 6.0;
    const double half = 1.96 * std::sqrt(static_cast<double>(r.chains) * chain) / r.counted_m;
    const double doubt = config_.correction_doubt * (r.arc_correction + r.noise_correction) / r.counted_m;
    r.s_o.value = value;
    if (r.s_o.reason.empty()) {
      r.s_o.lo = std::min(boot.lo, value - half) - doubt;
      r.s_o.hi = std::max(boot.hi, value + half) + doubt;
    }
    r.arc_correction /= r.path_m;
    r.noise_correction /= r.path_m;
    return std::move(result_);
  }

 private:
  Config config_;
  double sigma2_;
  PathResult result_;
  Row anchor_;
  Shape shape_;
  bool in_chain_ = false;
  double unit_path_ = 0.0;
  double unit_counted_ = 0.0;
  double curve_path_ = 0.0;
  double curve_counted_ = 0.0;
  std::vector<double> paths_;
  std::vector<double> counts_;

  void left_out() { result_.left_out_m += std::max(shape_.counted, 0.0); }

  void flush_unit() {
    if (unit_counted_ > 0.0) {
      paths_.push_back(unit_path_);
      counts_.push_back(unit_counted_);
    }
    unit_path_ = unit_counted_ = 0.0;
  }

  void add_to_curve(Micros t_us, double path) {
    curve_path_ += path;
    curve_counted_ += shape_.counted;
    if (curve_counted_ >= kCurve_m) {
      result_.curve_t_us.push_back(t_us);
      result_.curve.push_back(curve_path_ / curve_counted_);
      curve_path_ = curve_counted_ = 0.0;
    }
  }
};

std::string why_not(const Track& track, const StandstillResult& still, const Config& config) {
  const std::string slow = too_slow(track.period_s(), config, "the path needs");
  if (!slow.empty()) {
    return slow;
  }
  if (track.rows_with(kPose) == 0) {
    return "the log has no localised pose";
  }
  if (track.rows_with(kOdo) == 0) {
    return "the log has no odo";
  }
  if (!still.sigma_p.value) {
    return "pose noise unknown: " + still.sigma_p.reason;
  }
  return "";
}

}  // namespace

PathResult compare_path(const Track& track, const JumpResult& jumps, const StandstillResult& still,
                        const CountsResult& counts, const Config& config, double quantum_m) {
  PathResult none;
  none.s_o.unit = "1";
  none.s_o.n = 0;
  none.s_o.reason = why_not(track, still, config);
  if (!none.s_o.reason.empty()) {
    return none;
  }
  Strider strider(config, *still.sigma_p.value);
  const std::vector<Row>& rows = track.rows();
  bool running = false;
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const Row& b = rows[k];
    const bool usable = b.all(kPose | kOdo) && !b.all(kOdometryMode);
    const bool joined = running && usable && !b.all(kCut) && !jumps.at(k);
    const Interval i = joined ? interval_of(rows[k - 1], b, config) : Interval{};
    if (joined && !counter_jumped(i, config, quantum_m)) {
      strider.step(rows[k - 1], b, i, counts.wheels && pivot_radians(rows[k - 1], b, i, config) > kPivot_rad);
    } else if (usable) {
      strider.start(b);
    }
    running = usable;
  }
  PathResult r = strider.finish(quantum_m);
  r.s_o.unit = "1";
  r.s_o.n = static_cast<std::int64_t>(r.strides);
  r.s_o.exposure = r.counted_m / 1000.0;
  if (r.strides == 0) {
    r.s_o.reason = "nothing driven: no stride";
  }
  return r;
}

}  // namespace tacho::odometry
