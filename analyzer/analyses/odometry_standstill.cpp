#include "analyzer/analyses/odometry_standstill.hpp"

#include <algorithm>
#include <cmath>

#include "analyzer/math/robust.hpp"

namespace tacho::odometry {
namespace {

constexpr std::size_t kMostDifferences = 400'000;
constexpr std::size_t kFewestDifferences = 50;
constexpr Micros kLongestRun_us = 3'600'000'000;

void halve(std::vector<float>& values, std::size_t group) {
  std::size_t out = 0;
  for (std::size_t i = 0; i + group <= values.size(); i += 2 * group) {
    for (std::size_t j = 0; j < group; ++j) {
      values[out++] = values[i + j];
    }
  }
  values.resize(out);
}

Quantity sigma_of(const std::vector<float>& differences, const char* unit, std::uint64_t frozen) {
  Quantity q;
  q.unit = unit;
  q.n = static_cast<std::int64_t>(differences.size());
  if (differences.size() < kFewestDifferences) {
    q.reason = frozen > 0 ? "the pose is frozen while the robot stands"
                          : "fewer than 50 fresh poses in standstills of at least 10 s";
    return q;
  }
  const double mad = median_absolute_deviation(std::vector<double>(differences.begin(), differences.end()));
  const double sigma = kMadToSigma * mad / std::sqrt(2.0);
  const double half = 1.96 * 1.43 * sigma / std::sqrt(static_cast<double>(differences.size()));
  q.value = sigma;
  q.lo = std::max(0.0, sigma - half);
  q.hi = sigma + half;
  return q;
}

StillRun summary(const std::vector<Row>& rows) {
  const std::size_t third = rows.size() / 3;
  Pose first;
  Pose last;
  const double base = static_cast<double>(rows.front().angle);
  for (std::size_t i = 0; i < third; ++i) {
    const auto add = [&](Pose& sum, const Row& row) {
      sum.x += row.x - rows.front().x;
      sum.y += row.y - rows.front().y;
      sum.angle += wrap_pi(static_cast<double>(row.angle) - base);
    };
    add(first, rows[i]);
    add(last, rows[rows.size() - third + i]);
  }
  const double n = static_cast<double>(third);
  StillRun run;
  run.from_us = rows.front().t_us;
  run.to_us = rows.back().t_us;
  run.creep_m = std::hypot(last.x - first.x, last.y - first.y) / n;
  run.creep_rad = (last.angle - first.angle) / n;
  run.counted_m = rows.front().all(kOdo) && rows.back().all(kOdo) ? rows.back().odo - rows.front().odo : 0.0;
  return run;
}

}  // namespace

void StandstillFold::keep(double dx, double dy, double dtheta) {
  if (offered_++ % thinning_ != 0) {
    return;
  }
  metres_.push_back(static_cast<float>(dx));
  metres_.push_back(static_cast<float>(dy));
  radians_.push_back(static_cast<float>(dtheta));
  if (radians_.size() >= kMostDifferences) {
    halve(metres_, 2);
    halve(radians_, 1);
    thinning_ *= 2;
  }
}

void StandstillFold::end_run() {
  const bool enough =
      run_.size() >= 6 && static_cast<double>(run_.back().t_us - run_.front().t_us) * 1e-6 >= config_.still_run_s;
  if (enough) {
    std::size_t fresh = 0;
    for (std::size_t i = 1; i < run_.size(); ++i) {
      const double dx = run_[i].x - run_[i - 1].x;
      const double dy = run_[i].y - run_[i - 1].y;
      const double dtheta = wrap_pi(static_cast<double>(run_[i].angle) - static_cast<double>(run_[i - 1].angle));
      if (dx != 0.0 || dy != 0.0 || dtheta != 0.0) {
        keep(dx, dy, dtheta);
        ++fresh;
      }
    }
    frozen_ += fresh == 0 ? 1U : 0U;
    runs_.push_back(summary(run_));
  }
  run_.clear();
}

void StandstillFold::add(const Prepared& prepared) {
  const Row& row = prepared.row;
  const bool still = row.all(kPose | kSpeed | kTurn) && !row.all(kOdometryMode) && row.speed() < config_.still_mps &&
                     std::abs(static_cast<double>(row.w)) < config_.still_radps;
  if (!still || !prepared.joined || (!run_.empty() && row.t_us - run_.front().t_us > kLongestRun_us)) {
    end_run();
  }
  if (still) {
    run_.push_back(row);
  }
}

StandstillResult StandstillFold::finish(double quantum_m) {
  end_run();
  StandstillResult r;
  r.runs = runs_.size();
  r.frozen_runs = frozen_;
  r.sigma_p = sigma_of(metres_, "m", frozen_);
  r.sigma_theta = sigma_of(radians_, "rad", frozen_);
  std::vector<double> creeps;
  for (const StillRun& run : runs_) {
    r.seconds += static_cast<double>(run.to_us - run.from_us) * 1e-6;
    creeps.push_back(run.creep_m);
    if (std::abs(run.counted_m) > quantum_m * 1.001 + 1e-9) {
      ++r.counting_runs;
      if (r.worst.size() < 100) {
        r.worst.push_back(run);
      }
    }
  }
  r.creep_m.unit = "m";
  r.creep_m.n = static_cast<std::int64_t>(creeps.size());
  if (creeps.empty()) {
    r.creep_m.reason = "no standstill of at least 10 s";
  } else {
    r.creep_m.value = median(creeps);
    r.creep_m.reason = creeps.size() == 1 ? "no interval: one standstill only" : "";
    if (creeps.size() > 1) {
      r.creep_m.lo = quantile(creeps, 0.025);
      r.creep_m.hi = quantile(creeps, 0.975);
    }
  }
  return r;
}

}  // namespace tacho::odometry
