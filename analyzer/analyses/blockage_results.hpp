#pragma once
// What the blockage analysis knows after the fold: episodes and exposure per robot, put together per map.

#include <array>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "analyzer/analyses/blockage_episodes.hpp"
#include "analyzer/analyses/blockage_track.hpp"
#include "analyzer/report/section.hpp"
#include "analyzer/settings.hpp"

namespace tacho {

struct RobotBlockage {
  std::string name;
  std::string source;  ///< of `blocked`: "status" or "inputs"; empty: this log cannot tell
  std::string why_not;
  std::string pose_source;  ///< empty: no poses, no map
  std::vector<Episode> blocked, slowed;
  PoseTrack track;
  double observed_s = 0.0;  ///< pauses between polls of `blocked` that are no gaps
  double task_s = 0.0;      ///< of it on task
  double blocked_s = 0.0;   ///< of it blocked; a state that differs at the ends of a pause holds for half of it
  double slowed_s = 0.0;
  bool task_known = false;
  bool slowed_known = false;
  std::uint64_t polls = 0;
  Micros period_us = 0;
  Micros pose_period_us = 0;
};

/// Time lost to one episode: its duration less the time the same displacement takes at the cell's median speed.
struct Loss {
  std::size_t robot = 0;
  const Episode* episode = nullptr;
  double mid_s = 0.0, lo_s = 0.0, hi_s = 0.0;
  std::optional<std::size_t> site;  ///< index of its map, when its place is known
  math::CellIndex cell;
  bool costs = false;  ///< counts for BLK-01: on task; where the task is not known, not manual, charging or emergency
};

inline constexpr std::int64_t kNoReason = -1;  ///< key of "not given"

struct ReasonSum {
  double episodes = 0.0;
  double lost_s = 0.0;
};

struct SiteCell {
  double passes = 0.0, metres = 0.0, seconds = 0.0, blocked_s = 0.0, slowed_s = 0.0;
  double episodes = 0.0, lost_s = 0.0, obstacles = 0.0;
  std::map<std::int64_t, ReasonSum> by_reason;
  std::array<double, kEpisodeClasses> lost_by_class{};
  std::set<std::size_t> robots;  ///< that were blocked here
  SpeedClasses speeds;
};

/// All robots on one map. Cells by (j, i).
struct Site {
  std::string map;
  double cell_m = 0.25;
  std::map<std::pair<std::int64_t, std::int64_t>, SiteCell> cells;
  double passes = 0.0, episodes = 0.0, lost_s = 0.0;
  SiteCell& at(math::CellIndex c) { return cells[{c.j, c.i}]; }
};

struct BlockageData {
  const std::vector<RobotBlockage>& robots;
  const Settings& settings;
  std::vector<Site> sites;
  std::vector<Loss> losses;       ///< one per blocked episode, robot by robot
  std::vector<FrameTest> frames;  ///< one per robot
};
BlockageData blockage_data(const std::vector<RobotBlockage>& robots, const Settings& settings);

/// "laser", "code 17", "not given".
std::string reason_name(std::int64_t reason);

std::vector<std::string> blockage_notes(const BlockageData& data);
std::vector<Finding> blockage_findings(const BlockageData& data);
void add_blockage_tables(const BlockageData& data, Section& section);
void add_blockage_cell_tables(const BlockageData& data, Section& section);
void add_blockage_grids(const BlockageData& data, Section& section);

}  // namespace tacho
