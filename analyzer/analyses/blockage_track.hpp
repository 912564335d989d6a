#pragma once
// Where a robot drove and stood: exposure per grid cell by exact traversal of the strides between poses.
//
// Laws (tested to 1e-9): the metres of all cells add up to the path length, the seconds to the observed time, both for
// each grid. A stride over a gap, a pose jump or a change of map gives no exposure. A pose that lies nearer to the last
// one used than `stride_min_m` moves nothing (a standing robot must not "drive" its localisation noise): its time goes
// to the cell where the robot stands.

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>

#include "analyzer/math/traversal.hpp"
#include "schema/sample.hpp"

namespace tacho {

/// Speeds in classes of 0.05 m/s, for medians that can be merged.
class SpeedClasses {
 public:
  void add(double mps);
  void add(const SpeedClasses& other);
  [[nodiscard]] std::optional<double> median() const;

 private:
  static constexpr double kWidth = 0.05;
  std::array<std::uint32_t, 64> counts_{};
};

struct CellUse {
  double passes = 0.0;  ///< entries; coming back within 2 s is the same pass
  double metres = 0.0;
  double seconds = 0.0;
  double blocked_s = 0.0;
  double slowed_s = 0.0;
  Micros last_us = 0;  ///< when the robot was last in it
  SpeedClasses speeds;
};

/// A straight piece of the robot's way, or a stand when both points are equal.
struct Stride {
  math::Point from, to;
  Micros t_from_us = 0, t_to_us = 0;
  double blocked = 0.0;  ///< share of the time blocked: 0, 0.5 or 1
  double slowed = 0.0;
  std::optional<double> speed_mps;  ///< counted for the cell's median speed
};

class ExposureGrid {
 public:
  explicit ExposureGrid(double cell_m) : cell_m_(cell_m) {}
  void add(const Stride& stride);

  struct Hash {
    std::size_t operator()(const math::CellIndex& c) const {
      const auto mix =
          static_cast<std::uint64_t>(c.i) * 0x9E3779B97F4A7C15u ^ static_cast<std::uint64_t>(c.j) * 0xC2B2AE3D27D4EB4Fu;
      return static_cast<std::size_t>(mix ^ (mix >> 29));
    }
  };
  using Cells = std::unordered_map<math::CellIndex, CellUse, Hash>;
  [[nodiscard]] const Cells& cells() const { return cells_; }
  [[nodiscard]] double cell_m() const { return cell_m_; }

 private:
  double cell_m_;
  Cells cells_;
  std::optional<math::CellIndex> at_;
};

/// One map of one robot at both cell sizes: which one is shown depends on the size of the site, known at the end only.
struct MapUse {
  ExposureGrid fine{0.25};
  ExposureGrid coarse{0.5};
};

/// A pose of one poll and what holds at it.
struct PoseRow {
  Micros t_us = 0;
  bool near = false;  ///< the pause before this row is no gap
  std::optional<math::Point> at;
  std::string_view map;
  std::optional<double> speed_mps;
  bool blocked = false;
  bool slowed = false;
};

struct TrackRules {
  double v_max_mps = 3.0;
  double accel_mps2 = 1.0;
  double jump_m = 0.10;
  double stride_min_m = 0.05;
};

/// One robot. Feed rows in order.
class PoseTrack {
 public:
  explicit PoseTrack(const TrackRules& rules) : rules_(rules) {}
  void step(const PoseRow& row);

  [[nodiscard]] const std::map<std::string, MapUse>& maps() const { return maps_; }
  double observed_s = 0.0;  ///< sum of the times of all strides
  double path_m = 0.0;      ///< sum of their lengths
  std::uint64_t strides = 0;
  std::uint64_t gaps = 0;
  std::uint64_t jumps = 0;
  std::uint64_t without_pose = 0;
  std::uint64_t map_changes = 0;

 private:
  TrackRules rules_;
  std::map<std::string, MapUse> maps_;
  MapUse* use_ = nullptr;
  std::string map_;
  std::optional<PoseRow> before_;  // its map view is not used
  math::Point anchor_;
  [[nodiscard]] bool leap(const PoseRow& row, double dt_s) const;
  void stride(const PoseRow& row);
  void begin(const PoseRow& row);
};

}  // namespace tacho
