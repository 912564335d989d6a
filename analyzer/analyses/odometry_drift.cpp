#include "analyzer/analyses/odometry_drift.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <deque>

#include "analyzer/analyses/odometry_drift_law.hpp"
#include "analyzer/math/bootstrap.hpp"
#include "analyzer/math/robust.hpp"

namespace tacho::odometry {
namespace {

/// A row on a stretch: counter distance, localised and dead-reckoned pose, variance of the integrated heading.
struct Node {
  double s = 0;
  Pose located;
  Pose reckoned;
  double variance = 0;
};

/// The node at distance s between two.
Node node_at(const Node& a, const Node& b, double s) {
  const double share = (s - a.s) / (b.s - a.s);
  return {s, interpolate(a.located, b.located, share), interpolate(a.reckoned, b.reckoned, share),
          a.variance + share * (b.variance - a.variance)};
}

/// Sums over pairs that start within one unit of counter distance.
struct Unit {
  double n = 0, e2 = 0, along = 0, turn = 0, turn2 = 0;
};

/// Everything about one L.
class Length {
 public:
  explicit Length(double length) : length_(length), unit_m_(std::max(20.0, length)) {}

  void begin_stretch() {
    next_ = 0;
    end_ = 0;
    next_s_ = 0.0;
  }
  /// Takes all pairs whose end is known; `first` is the index of nodes.front() in the stretch.
  void advance(const std::deque<Node>& nodes, std::size_t first, double chord_min) {
    const auto at = [&](std::size_t i) -> const Node& { return nodes[i - first]; };
    while (next_s_ + length_ <= nodes.back().s) {
      while (at(next_ + 1).s <= next_s_) {
        ++next_;
      }
      end_ = std::max(end_, next_);
      while (at(end_ + 1).s < next_s_ + length_) {
        ++end_;
      }
      add_pair(node_at(at(next_), at(next_ + 1), next_s_), node_at(at(end_), at(end_ + 1), next_s_ + length_),
               chord_min);
      next_s_ += length_ / 10.0;
    }
  }
  void end_stretch(double s) {
    if (s >= length_) {
      covered_ += s;
    }
    flush();
  }
  /// Nodes before this one are not needed any more.
  [[nodiscard]] std::size_t oldest() const { return next_; }

  [[nodiscard]] DriftRow row(const Config& config) {
    DriftRow r;
    r.length_m = length_;
    r.n = static_cast<std::int64_t>(ratios_.size());
    r.n_eff = covered_ / length_;
    if (ratios_.empty()) {
      const std::string reason = fmt::format("no stretch of {:.0f} m", length_);
      r.rmse_pct = {{}, "%", {}, {}, 0, {}, reason};
      r.along_pct = r.rmse_pct;
      r.turn_deg_per_m = {{}, "deg/m", {}, {}, 0, {}, reason};
      r.turn_rms_deg = r.integration_deg = {{}, "deg", {}, {}, 0, {}, reason};
      return r;
    }
    const double n = static_cast<double>(r.n);
    fill_means(r, n, config);
    std::vector<double> ratios(ratios_.begin(), ratios_.end());
    r.median_pct = 100.0 * median(ratios);
    r.p95_pct = 100.0 * quantile(std::move(ratios), 0.95);
    r.heading_ms = total_.turn2 / n;
    r.position_ms = total_.e2 / n;
    r.straight_n = straight_n_;
    r.straight_share = static_cast<double>(straight_n_) / n;
    r.straight_ms = straight_n_ > 0 ? straight_e2_ / static_cast<double>(straight_n_) : 0.0;
    r.integration_deg = {kToDegrees * std::sqrt(integration_ / n), "deg", {}, {}, r.n, {}, ""};
    return r;
  }

 private:
  double length_;
  double unit_m_;
  std::size_t next_ = 0;  ///< last node at or before the start of the next pair
  std::size_t end_ = 0;
  double next_s_ = 0.0;
  double unit_from_ = 0.0;
  Unit unit_;
  Unit total_;
  double covered_ = 0.0;
  double straight_e2_ = 0.0;
  std::int64_t straight_n_ = 0;
  double integration_ = 0.0;
  std::vector<Unit> units_;
  std::vector<float> ratios_;  ///< |e| / L

  void flush() {
    if (unit_.n > 0) {
      units_.push_back(unit_);
    }
    unit_ = Unit{};
  }

  void add_pair(const Node& start, const Node& end, double chord_min) {
    const Pose located = between(start.located, end.located);
    const Pose reckoned = between(start.reckoned, end.reckoned);
    const Pose e = between(located, reckoned);
    const double e2 = e.x * e.x + e.y * e.y;
    if (unit_.n == 0) {
      unit_from_ = start.s;
    }
    for (Unit* u : {&unit_, &total_}) {
      u->n += 1.0;
      u->e2 += e2;
      u->along += e.x;
      u->turn += e.angle;
      u->turn2 += e.angle * e.angle;
    }
    ratios_.push_back(static_cast<float>(std::sqrt(e2) / length_));
    integration_ += end.variance - start.variance;
    if (std::hypot(located.x, located.y) >= chord_min * length_) {
      straight_e2_ += e2;
      ++straight_n_;
    }
    if (start.s - unit_from_ >= unit_m_) {
      flush();
    }
  }

  void fill_means(DriftRow& r, double n, const Config& config) const {
    BootstrapOptions options;
    options.block = 2;
    options.draws = static_cast<int>(config.draws);
    std::vector<double> counts;
    std::vector<double> sums;
    const std::string too_few = too_few_to_draw(units_.size(), options.block);
    const auto limits = [&](double Unit::*member) {
      sums.clear();
      counts.clear();
      for (const Unit& u : units_) {
        counts.push_back(u.n);
        sums.push_back(u.*member);
      }
      return bootstrap_ratio(sums, counts, options);
    };
    const auto quantity = [&](double mean, const Limits& drawn, double scale, const char* unit) {
      if (!too_few.empty()) {
        return Quantity{scale * mean, unit, {}, {}, r.n, {}, too_few};
      }
      const Limits l = around(mean, drawn);
      return Quantity{scale * mean, unit, scale * l.lo, scale * l.hi, r.n, {}, ""};
    };
    const auto rooted = [](Limits l) { return Limits{std::sqrt(l.lo), std::sqrt(l.hi)}; };
    const double per_length = 1.0 / length_;
    r.rmse_pct = quantity(std::sqrt(total_.e2 / n), rooted(limits(&Unit::e2)), 100.0 * per_length, "%");
    r.along_pct = quantity(total_.along / n, limits(&Unit::along), 100.0 * per_length, "%");
    r.turn_deg_per_m = quantity(total_.turn / n, limits(&Unit::turn), kToDegrees * per_length, "deg/m");
    r.turn_rms_deg = quantity(std::sqrt(total_.turn2 / n), rooted(limits(&Unit::turn2)), kToDegrees, "deg");
  }
};

/// One stretch after the other through all lengths.
class Reckoner {
 public:
  explicit Reckoner(const Config& config) : config_(config) {
    for (const double length : kDriftLengths) {
      lengths_.emplace_back(length);
    }
  }

  void start(const Row& row) {
    end();
    nodes_.push_back({0.0, row.pose(), Pose{}, 0.0});
    error_.emplace(row);
    for (Length& length : lengths_) {
      length.begin_stretch();
    }
  }
  void step(const Row& b, const Interval& i, double bound_rad) {
    const Node& last = nodes_.back();
    Node node;
    node.s = last.s + std::max(i.counted_m, 0.0);
    node.located = b.pose();
    node.reckoned = compose(last.reckoned, exp_se2(i.twist, i.dt_s));
    node.variance = last.variance + bound_rad * bound_rad / 3.0;
    nodes_.push_back(node);
    error_->add(b, node.reckoned);
    if (node.s == nodes_[nodes_.size() - 2].s) {
      return;
    }
    std::size_t oldest = first_ + nodes_.size() - 1;
    for (Length& length : lengths_) {
      length.advance(nodes_, first_, config_.chord_min);
      oldest = std::min(oldest, length.oldest());
    }
    for (; first_ < oldest; ++first_) {
      nodes_.pop_front();
    }
  }
  void end() {
    if (!nodes_.empty()) {
      for (Length& length : lengths_) {
        length.end_stretch(nodes_.back().s);
      }
      if (nodes_.back().s >= 10.0) {
        errors_.push_back(error_->finish(nodes_.back().s));
      }
    }
    nodes_.clear();
    first_ = 0;
  }
  [[nodiscard]] bool running() const { return !nodes_.empty(); }
  std::vector<Length>& lengths() { return lengths_; }
  std::vector<SegmentError> take_errors() { return std::move(errors_); }

 private:
  Config config_;
  std::vector<Length> lengths_;
  std::deque<Node> nodes_;
  std::size_t first_ = 0;  ///< index of nodes_.front() in the stretch
  std::optional<AlignedError> error_;
  std::vector<SegmentError> errors_;
};

std::string why_not(const Track& track, const Config& config) {
  const std::string slow = too_slow(track.period_s(), config, "drift needs");
  if (!slow.empty()) {
    return slow;
  }
  for (const auto& [tag, name] :
       {std::pair{kPose, "localised pose"}, std::pair{kOdo, "odo"}, std::pair{kSpeed, "vx"}, std::pair{kTurn, "w"}}) {
    if (track.rows_with(tag) == 0) {
      return fmt::format("the log has no {}", name);
    }
  }
  return "";
}

}  // namespace

Quantity scaled(Quantity q, double factor, const char* unit) {
  for (std::optional<double>* part : {&q.value, &q.lo, &q.hi}) {
    if (*part) {
      **part *= factor;
    }
  }
  q.unit = unit;
  return q;
}

DriftResult measure_drift(const Track& track, const JumpResult& jumps, const Accelerations& accelerations,
                          const StandstillResult& still, const Config& config) {
  DriftResult r;
  r.reason = why_not(track, config);
  r.turn_at_10m_deg.unit = "deg";
  Reckoner reckoner(config);
  const std::vector<Row>& rows = track.rows();
  for (std::size_t k = 0; r.reason.empty() && k < rows.size(); ++k) {
    const Row& b = rows[k];
    if (!b.all(kPose | kOdo | kSpeed | kTurn) || b.all(kOdometryMode)) {
      reckoner.end();
    } else if (!reckoner.running() || b.all(kCut) || jumps.at(k)) {
      reckoner.start(b);
    } else {
      const Interval i = interval_of(rows[k - 1], b, config);
      reckoner.step(b, i, accelerations.radians(rows[k - 1], b, i));
    }
  }
  reckoner.end();
  r.segments = reckoner.take_errors();
  for (Length& length : reckoner.lengths()) {
    r.rows.push_back(length.row(config));
    const DriftRow& row = r.rows.back();
    if (row.length_m == 10.0 && row.turn_deg_per_m.value) {
      const Quantity& q = row.turn_deg_per_m;
      r.turn_at_10m_deg = scaled(q, 10.0, "deg");
      r.turn_at_10m_deg.n = static_cast<std::int64_t>(row.n_eff);
    }
  }
  if (r.reason.empty() && r.rows.front().n == 0) {
    r.reason = "nothing driven: no stretch of 1 m";
  }
  if (!r.turn_at_10m_deg.value) {
    r.turn_at_10m_deg.reason = r.reason.empty() ? "no stretch of 10 m" : r.reason;
  }
  r.law = fit_drift_law(r, still);
  return r;
}

}  // namespace tacho::odometry
