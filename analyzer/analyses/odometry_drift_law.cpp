#include "analyzer/analyses/odometry_drift_law.hpp"

#include <algorithm>
#include <cmath>

#include "analyzer/math/least_squares.hpp"

namespace tacho::odometry {
namespace {

/// One equation per L: y = columns * coefficients, weight n_eff / y^2.
struct Equations {
  Eigen::MatrixXd a;
  Eigen::VectorXd y;
  Eigen::VectorXd weight;
  Eigen::Index n = 0;

  Equations(std::size_t rows, Eigen::Index columns)
      : a(static_cast<Eigen::Index>(rows), columns),
        y(static_cast<Eigen::Index>(rows)),
        weight(static_cast<Eigen::Index>(rows)) {}
  void add(std::initializer_list<double> columns, double measured, double known, double n_eff) {
    Eigen::Index c = 0;
    for (const double value : columns) {
      a(n, c++) = value;
    }
    y(n) = measured - known;
    weight(n) = n_eff / (measured * measured);
    ++n;
  }
  [[nodiscard]] Eigen::VectorXd solve() const {
    return non_negative_least_squares(a.topRows(n), y.head(n), weight.head(n));
  }
};

Quantity root(double square, const char* unit, Eigen::Index n) { return {std::sqrt(square), unit, {}, {}, n, {}, ""}; }

Quantity raw_at_10m(const DriftResult& drift, double sigma_p, double sigma_theta) {
  Quantity q;
  q.unit = "%";
  for (const DriftRow& row : drift.rows) {
    if (row.length_m != 10.0 || row.n == 0) {
      continue;
    }
    const double noise = 4.0 * sigma_p * sigma_p + 100.0 * sigma_theta * sigma_theta;
    const auto figure = [&](double pct) {
      const double rms_m = pct / 100.0 * row.length_m;
      return 100.0 * std::sqrt(std::max(0.0, rms_m * rms_m - noise)) / row.length_m;
    };
    q = row.rmse_pct;
    for (std::optional<double>* part : {&q.value, &q.lo, &q.hi}) {
      *part = *part ? std::optional(figure(**part)) : std::nullopt;
    }
  }
  if (!q.value) {
    q.reason = "no stretch of 10 m";
  }
  return q;
}

}  // namespace

DriftLaw fit_drift_law(const DriftResult& drift, const StandstillResult& still) {
  DriftLaw law;
  std::string reason = drift.reason;
  if (reason.empty() && (!still.sigma_p.value || !still.sigma_theta.value)) {
    reason = "pose noise unknown: " + still.sigma_p.reason;
  }
  const auto usable = [](const DriftRow& row) { return row.n_eff >= 3.0 && row.heading_ms > 0.0; };
  const auto straight = [&](const DriftRow& row) {
    return usable(row) && row.straight_ms > 0.0 && row.n_eff * row.straight_share >= 3.0;
  };
  const auto& rows = drift.rows;
  if (reason.empty() &&
      (std::count_if(rows.begin(), rows.end(), usable) < 3 || std::count_if(rows.begin(), rows.end(), straight) < 3)) {
    reason = "fewer than three lengths with three independent stretches each";
  }
  if (!reason.empty()) {
    law.heading_walk = {{}, "rad/sqrt(m)", {}, {}, 0, {}, reason};
    law.heading_bias = {{}, "rad/m", {}, {}, 0, {}, reason};
    law.walk = {{}, "m/sqrt(m)", {}, {}, 0, {}, reason};
    law.systematic = {{}, "1", {}, {}, 0, {}, reason};
    law.at_10m = {{}, "%", {}, {}, 0, {}, reason};
    return law;
  }
  const double sp2 = *still.sigma_p.value * *still.sigma_p.value;
  const double st2 = *still.sigma_theta.value * *still.sigma_theta.value;
  Equations heading(rows.size(), 2);
  for (const DriftRow& row : rows) {
    if (usable(row)) {
      heading.add({row.length_m, row.length_m * row.length_m}, row.heading_ms, 2.0 * st2, row.n_eff);
    }
  }
  const Eigen::VectorXd h = heading.solve();
  Equations position(rows.size(), 2);
  for (const DriftRow& row : rows) {
    if (straight(row)) {
      const double l = row.length_m;
      const double known = 4.0 * sp2 + st2 * l * l + h(0) * l * l * l / 3.0 + h(1) * l * l * l * l / 4.0;
      position.add({l, l * l}, row.straight_ms, known, row.n_eff * row.straight_share);
    }
  }
  const Eigen::VectorXd p = position.solve();
  law.heading_walk = root(h(0), "rad/sqrt(m)", heading.n);
  law.heading_bias = root(h(1), "rad/m", heading.n);
  law.walk = root(p(0), "m/sqrt(m)", position.n);
  law.systematic = root(p(1), "1", position.n);
  law.at_10m = raw_at_10m(drift, *still.sigma_p.value, *still.sigma_theta.value);
  return law;
}

AlignedError::AlignedError(const Row& first) : first_(first), last_us_(first.t_us) {}

void AlignedError::add(const Row& row, const Pose& reckoned) {
  const double x = row.x - first_.x;
  const double y = row.y - first_.y;
  n_ += 1.0;
  px_ += x;
  py_ += y;
  rx_ += reckoned.x;
  ry_ += reckoned.y;
  pp_ += x * x + y * y;
  rr_ += reckoned.x * reckoned.x + reckoned.y * reckoned.y;
  pxrx_ += x * reckoned.x;
  pxry_ += x * reckoned.y;
  pyrx_ += y * reckoned.x;
  pyry_ += y * reckoned.y;
  last_us_ = row.t_us;
}

SegmentError AlignedError::finish(double driven_m) const {
  SegmentError e{first_.segment, first_.t_us, last_us_, driven_m, {}};
  // Centred second moments; rotation angle atan2(cross, dot); residual = pp + rr - 2 hypot(dot, cross).
  const double xx = pxrx_ - px_ * rx_ / n_;
  const double xy = pxry_ - px_ * ry_ / n_;
  const double yx = pyrx_ - py_ * rx_ / n_;
  const double yy = pyry_ - py_ * ry_ / n_;
  const double pp = pp_ - (px_ * px_ + py_ * py_) / n_;
  const double rr = rr_ - (rx_ * rx_ + ry_ * ry_) / n_;
  const double dot = xx + yy;
  const double cross = yx - xy;
  const double sum = std::hypot(dot, cross);
  const double difference = std::hypot(xx - yy, xy + yx);
  const double first = 0.5 * (sum + difference);
  const double second = 0.5 * std::abs(sum - difference);
  e.ate_m.unit = "m";
  e.ate_m.n = static_cast<std::int64_t>(n_);
  if (second < 1e-6 * first || first == 0.0) {
    e.ate_m.reason = "degenerate: the stretch is a straight line";
  } else {
    e.ate_m.value = std::sqrt(std::max(0.0, pp + rr - 2.0 * sum) / n_);
  }
  return e;
}

}  // namespace tacho::odometry
