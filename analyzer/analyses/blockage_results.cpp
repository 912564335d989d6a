#include "analyzer/analyses/blockage_results.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

#include "analyzer/analyses/cells.hpp"

namespace tacho {
namespace {

/// Longest side of what was visited on a map, by all robots.
double extent_m(const std::vector<RobotBlockage>& robots, const std::string& map) {
  std::int64_t i0 = std::numeric_limits<std::int64_t>::max(), j0 = i0;
  std::int64_t i1 = std::numeric_limits<std::int64_t>::min(), j1 = i1;
  double cell_m = 0.0;
  for (const RobotBlockage& robot : robots) {
    const auto use = robot.track.maps().find(map);
    if (use == robot.track.maps().end()) {
      continue;
    }
    cell_m = use->second.fine.cell_m();
    for (const auto& [cell, sums] : use->second.fine.cells()) {
      i0 = std::min(i0, cell.i);
      i1 = std::max(i1, cell.i);
      j0 = std::min(j0, cell.j);
      j1 = std::max(j1, cell.j);
    }
  }
  return i1 < i0 ? 0.0 : cell_m * static_cast<double>(std::max(i1 - i0, j1 - j0) + 1);
}

void add_exposure(Site& site, const ExposureGrid& grid) {
  for (const auto& [index, use] : grid.cells()) {
    SiteCell& cell = site.at(index);
    cell.passes += use.passes;
    cell.metres += use.metres;
    cell.seconds += use.seconds;
    cell.blocked_s += use.blocked_s;
    cell.slowed_s += use.slowed_s;
    cell.speeds.add(use.speeds);
  }
}

std::vector<Site> make_sites(const std::vector<RobotBlockage>& robots, double coarse_above_m) {
  std::set<std::string> maps;
  for (const RobotBlockage& robot : robots) {
    for (const auto& [map, use] : robot.track.maps()) {
      maps.insert(map);
    }
    for (const Episode& e : robot.blocked) {
      if (e.at) {
        maps.insert(e.map);
      }
    }
  }
  std::vector<Site> sites;
  for (const std::string& map : maps) {
    Site site;
    site.map = map;
    const bool coarse = extent_m(robots, map) > coarse_above_m;
    site.cell_m = coarse ? 0.5 : 0.25;
    for (const RobotBlockage& robot : robots) {
      const auto use = robot.track.maps().find(map);
      if (use != robot.track.maps().end()) {
        add_exposure(site, coarse ? use->second.coarse : use->second.fine);
      }
    }
    sites.push_back(std::move(site));
  }
  return sites;
}

std::optional<double> site_speed(const Site& site) {
  SpeedClasses all;
  for (const auto& [index, cell] : site.cells) {
    all.add(cell.speeds);
  }
  return all.median();
}

bool costs(const RobotBlockage& robot, const Episode& e) {
  return robot.task_known ? e.cls == EpisodeClass::on_task
                          : e.cls == EpisodeClass::on_task || e.cls == EpisodeClass::off_task;
}

Loss loss_of(const Episode& e, std::optional<double> median_mps) {
  const double free_s = median_mps ? e.moved_m() / *median_mps : 0.0;
  Loss loss;
  loss.episode = &e;
  loss.mid_s = std::max(0.0, e.duration_mid_s() - free_s);
  loss.lo_s = std::max(0.0, e.duration_lo_s() - free_s);
  loss.hi_s = std::max(loss.mid_s, e.duration_most_s() - free_s);
  return loss;
}

void put_on_map(Site& site, const Loss& loss, std::optional<math::Point> obstacle) {
  const Episode& e = *loss.episode;
  SiteCell& cell = site.at(loss.cell);
  cell.episodes += 1.0;
  cell.lost_s += loss.mid_s;
  ReasonSum& reason = cell.by_reason[e.reason.value_or(kNoReason)];
  reason.episodes += 1.0;
  reason.lost_s += loss.mid_s;
  cell.lost_by_class[static_cast<std::size_t>(e.cls)] += loss.mid_s;
  cell.robots.insert(loss.robot);
  if (obstacle) {
    site.at(math::cell_of(*obstacle, site.cell_m)).obstacles += 1.0;
  }
}

std::string limits_note(const RobotBlockage& robot) {
  const double period_s = static_cast<double>(robot.period_us) * 1e-6;
  std::string note = fmt::format(
      "{}: `blocked` from {}, {} polls; episodes longer than two periods ({} s) are all counted, shorter ones may be "
      "missed.",
      robot.name, robot.source, robot.polls, cells::short_number(2.0 * period_s));
  const double pose_period_s = static_cast<double>(robot.pose_period_us) * 1e-6;
  if (!robot.pose_source.empty() && pose_period_s > 2.0) {
    note += fmt::format(
        " Poses come every {} s: the way between two of them is guessed to be straight, so exposure by metres and "
        "passes is "
        "an estimate; seconds and episodes are not affected.",
        cells::short_number(pose_period_s));
  }
  return note;
}

const char* frame_text(ObstacleFrame frame) {
  switch (frame) {
    case ObstacleFrame::world:
      return "the map";
    case ObstacleFrame::robot:
      return "the robot's frame";
    case ObstacleFrame::unknown:
      break;
  }
  return "UNKNOWN, no obstacle layer";
}

}  // namespace

std::string reason_name(std::int64_t reason) {
  if (reason == kNoReason) {
    return "not given";
  }
  const std::string_view name = code_name(field_at(field("block_reason")), reason);
  return name.empty() ? fmt::format("code {}", reason) : std::string(name);
}

BlockageData blockage_data(const std::vector<RobotBlockage>& robots, const Settings& settings) {
  BlockageData data{robots, settings, make_sites(robots, settings.number("blockage.coarse_above_m")), {}, {}};
  std::vector<std::optional<double>> speeds;
  for (const Site& site : data.sites) {
    speeds.push_back(site_speed(site));
  }
  for (std::size_t r = 0; r < robots.size(); ++r) {
    data.frames.push_back(obstacle_frame(robots[r].blocked));
    for (const Episode& e : robots[r].blocked) {
      const auto site =
          std::find_if(data.sites.begin(), data.sites.end(), [&](const Site& s) { return s.map == e.map; });
      const bool placed = e.at && site != data.sites.end();
      std::optional<double> speed;
      math::CellIndex cell;
      if (placed) {
        cell = math::cell_of(*e.at, site->cell_m);
        speed = site->at(cell).speeds.median();
        speed = speed ? speed : speeds[static_cast<std::size_t>(site - data.sites.begin())];
      }
      Loss loss = loss_of(e, speed);
      loss.robot = r;
      loss.costs = costs(robots[r], e);
      if (placed) {
        loss.site = static_cast<std::size_t>(site - data.sites.begin());
        loss.cell = cell;
        put_on_map(*site, loss, obstacle_in_map(e, data.frames.back().frame));
      }
      data.losses.push_back(loss);
    }
  }
  for (Site& site : data.sites) {
    for (const auto& [index, cell] : site.cells) {
      site.passes += cell.passes;
      site.episodes += cell.episodes;
      site.lost_s += cell.lost_s;
    }
  }
  return data;
}

std::vector<std::string> blockage_notes(const BlockageData& data) {
  std::vector<std::string> notes{
      "An episode is a run of `blocked`; runs interrupted for at most 2 s by the same reason are one. Onset and end "
      "lie "
      "between two polls and are given as bounds. Reason and obstacle count only while the robot is blocked.",
      "Lost time = duration minus the time the same displacement takes at the median speed of the cell (0.05 m/s "
      "classes). "
      "BLK-01 counts episodes on task; where the log has no task status, all but manual driving, charging and "
      "emergency "
      "stop.",
      "Exposure: every straight stride between two poses is shared out exactly over the cells it crosses; pauses over "
      "gaps, "
      "pose jumps and changes of map give none. A pass is an entry into a cell; coming back within 2 s is the same "
      "pass. "
      "Poses nearer to each other than the smallest stride are a stand.",
      "per_hour = episodes / hours in which the robot was observed, wherever it was. rate_per_cell_hour of the map = "
      "episodes / hours that all robots spent in that cell: it is higher, and no rate of a robot.",
      "rate = episodes / passes (hidden below the smallest number of passes); theta = the same, drawn towards the "
      "site's "
      "mean where a cell has little data (empirical Bayes); opacity = how much the cell's own data count.",
  };
  for (std::size_t r = 0; r < data.robots.size(); ++r) {
    const RobotBlockage& robot = data.robots[r];
    if (robot.source.empty()) {
      notes.push_back(fmt::format("{}no blockage: {}", robot.name.empty() ? "" : robot.name + ": ", robot.why_not));
      continue;
    }
    notes.push_back(limits_note(robot));
    if (robot.pose_source.empty()) {
      notes.push_back(fmt::format("{}: no poses in the log: episodes are listed but are on no map", robot.name));
      continue;
    }
    const FrameTest& f = data.frames[r];
    notes.push_back(fmt::format(
        "{}: {} strides, {} m in {} h; left out: {} gaps, {} pose jumps, {} changes of map, {} rows without pose. "
        "Obstacle "
        "points are in {} ({} episodes at {} places; distance to the robot {} m, to the origin {} m, median).",
        robot.name, robot.track.strides, cells::short_number(robot.track.path_m),
        cells::short_number(robot.track.observed_s / 3'600.0), robot.track.gaps, robot.track.jumps,
        robot.track.map_changes, robot.track.without_pose, frame_text(f.frame), f.episodes, f.places,
        cells::short_number(f.world_median_m), cells::short_number(f.robot_median_m)));
  }
  return notes;
}

}  // namespace tacho
