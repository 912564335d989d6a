#include "analyzer/analyses/blockage_track.hpp"

#include <algorithm>
#include <cmath>

namespace tacho {
namespace {

constexpr Micros kReentry = 2'000'000;
constexpr double kMoving_mps = 0.05;
constexpr double kFarthest_m = 1e6;  // no site is larger; keeps cell numbers small

bool usable(const std::optional<math::Point>& p) {
  return p && std::abs(p->x) < kFarthest_m && std::abs(p->y) < kFarthest_m;  // false for NaN
}

}  // namespace

void SpeedClasses::add(double mps) {
  const auto cls = static_cast<std::size_t>(std::clamp(mps / kWidth, 0.0, static_cast<double>(counts_.size() - 1)));
  ++counts_[cls];
}

void SpeedClasses::add(const SpeedClasses& other) {
  for (std::size_t i = 0; i < counts_.size(); ++i) {
    counts_[i] += other.counts_[i];
  }
}

std::optional<double> SpeedClasses::median() const {
  std::uint64_t all = 0;
  for (const std::uint32_t n : counts_) {
    all += n;
  }
  std::uint64_t below = 0;
  for (std::size_t i = 0; i < counts_.size(); ++i) {
    below += counts_[i];
    if (all > 0 && 2 * below >= all) {
      return (static_cast<double>(i) + 0.5) * kWidth;
    }
  }
  return std::nullopt;
}

void ExposureGrid::add(const Stride& stride) {
  const Micros dt_us = stride.t_to_us - stride.t_from_us;
  const double dt_s = static_cast<double>(dt_us) * 1e-6;
  const double length_m = math::distance(stride.from, stride.to);
  math::traverse(stride.from, stride.to, cell_m_, [&](const math::Part& part) {
    const auto time = [&](double share) {
      return stride.t_from_us + static_cast<Micros>(share * static_cast<double>(dt_us));
    };
    const auto [at, fresh] = cells_.try_emplace(part.cell);
    CellUse& cell = at->second;
    if (at_ != part.cell && (fresh || time(part.from) - cell.last_us >= kReentry)) {
      cell.passes += 1.0;
    }
    at_ = part.cell;
    const double share = part.to - part.from;
    cell.metres += share * length_m;
    cell.seconds += share * dt_s;
    cell.blocked_s += share * dt_s * stride.blocked;
    cell.slowed_s += share * dt_s * stride.slowed;
    cell.last_us = time(part.to);
    if (stride.speed_mps) {
      cell.speeds.add(*stride.speed_mps);
    }
  });
}

/// More than the robot can have driven: the localisation jumped.
bool PoseTrack::leap(const PoseRow& row, double dt_s) const {
  double most = rules_.v_max_mps * dt_s;
  if (before_->speed_mps && row.speed_mps) {
    most = std::min(most, (*before_->speed_mps + *row.speed_mps) / 2.0 * dt_s + rules_.accel_mps2 * dt_s * dt_s / 4.0);
  }
  return math::distance(*before_->at, *row.at) > most + rules_.jump_m;
}

void PoseTrack::begin(const PoseRow& row) {
  if (use_ == nullptr || map_ != row.map) {
    map_ = row.map;
    use_ = &maps_[map_];
  }
  anchor_ = *row.at;
  before_ = row;
}

void PoseTrack::stride(const PoseRow& row) {
  Stride s;
  s.from = anchor_;
  s.to = math::distance(anchor_, *row.at) >= rules_.stride_min_m ? *row.at : anchor_;
  s.t_from_us = before_->t_us;
  s.t_to_us = row.t_us;
  s.blocked = (before_->blocked ? 0.5 : 0.0) + (row.blocked ? 0.5 : 0.0);
  s.slowed = (before_->slowed ? 0.5 : 0.0) + (row.slowed ? 0.5 : 0.0);
  const double dt_s = static_cast<double>(s.t_to_us - s.t_from_us) * 1e-6;
  const double length_m = math::distance(s.from, s.to);
  if (s.blocked == 0.0 && s.slowed == 0.0 && dt_s > 0.0) {
    const double mps =
        before_->speed_mps && row.speed_mps ? (*before_->speed_mps + *row.speed_mps) / 2.0 : length_m / dt_s;
    if (mps > kMoving_mps) {
      s.speed_mps = mps;
    }
  }
  use_->fine.add(s);
  use_->coarse.add(s);
  observed_s += dt_s;
  path_m += length_m;
  ++strides;
  anchor_ = s.to;
  before_ = row;
}

void PoseTrack::step(const PoseRow& row) {
  if (!usable(row.at)) {
    ++without_pose;
    before_.reset();
    return;
  }
  if (!before_) {
    begin(row);
    return;
  }
  const double dt_s = static_cast<double>(row.t_us - before_->t_us) * 1e-6;
  if (!row.near) {
    ++gaps;
    begin(row);
  } else if (row.map != map_) {
    ++map_changes;
    begin(row);
  } else if (leap(row, dt_s)) {
    ++jumps;
    begin(row);
  } else {
    stride(row);
  }
}

}  // namespace tacho
