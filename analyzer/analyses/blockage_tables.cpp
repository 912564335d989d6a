// Episodes, and their sums by robot, reason, class and sensor.

#include <fmt/format.h>

#include <algorithm>

#include "analyzer/analyses/blockage_results.hpp"
#include "analyzer/analyses/cells.hpp"
#include "analyzer/math/robust.hpp"

namespace tacho {
namespace {

/// Durations and losses of some episodes.
struct EpisodeSum {
  std::int64_t episodes = 0;
  double mid_s = 0.0, lo_s = 0.0, hi_s = 0.0;
  double lost_s = 0.0, lost_lo_s = 0.0, lost_hi_s = 0.0;
  std::vector<double> durations;
  void add(const Loss& loss) {
    const Episode& e = *loss.episode;
    ++episodes;
    mid_s += e.duration_mid_s();
    lo_s += e.duration_lo_s();
    hi_s += e.duration_most_s();
    lost_s += loss.mid_s;
    lost_lo_s += loss.lo_s;
    lost_hi_s += loss.hi_s;
    durations.push_back(e.duration_mid_s());
  }
  [[nodiscard]] Quantity blocked() const { return cells::bounded(mid_s, lo_s, hi_s, "s"); }
  [[nodiscard]] Quantity lost() const { return cells::bounded(lost_s, lost_lo_s, lost_hi_s, "s"); }
};

double slowed_s(const std::vector<Episode>& episodes, std::optional<std::int64_t> reason) {
  double sum = 0.0;
  for (const Episode& e : episodes) {
    sum += !reason || e.reason.value_or(kNoReason) == *reason ? e.duration_mid_s() : 0.0;
  }
  return sum;
}

DataTable by_robot(const BlockageData& data) {
  DataTable table;
  table.name = "by_robot";
  table.title = "Blockage by robot";
  table.columns = {{"robot", "", "Robot"},
                   {"observed", "h", "Time between polls of `blocked` without gaps"},
                   {"on_task", "h", "Of it with a running task"},
                   {"distance", "km", "Path between poses"},
                   integer_column("episodes", "Blocked episodes"),
                   integer_column("incidents", "Episodes within 10 min and 1 m of the one before count once"),
                   {"per_hour", "1/h", "Episodes per hour in which the robot was observed, wherever it was", true},
                   {"per_km", "1/km", "Episodes per km", true},
                   {"blocked", "s", "Sum of durations; limits over the poll bounds", true},
                   {"lost", "s", "Lost time; limits over the poll bounds", true},
                   {"lost_of_task_pct", "%", "Lost time over time on task, see BLK-01"},
                   integer_column("slowed_episodes", "Slowed episodes"),
                   {"slowed_h", "h", "Observed time slowed"}};
  const std::vector<Finding> findings = blockage_findings(data);
  for (std::size_t r = 0; r < data.robots.size(); ++r) {
    const RobotBlockage& robot = data.robots[r];
    std::vector<Value> row{robot.name};
    if (robot.source.empty()) {
      row.resize(table.columns.size(), Missing{robot.why_not});
      table.rows.push_back(std::move(row));
      continue;
    }
    EpisodeSum sum;
    for (const Loss& loss : data.losses) {
      if (loss.robot == r) {
        sum.add(loss);
      }
    }
    const double k = static_cast<double>(sum.episodes);
    const std::string no_pose = "no poses in the log";
    const std::string no_slowed = "slowed is not in the log";
    const auto finding =
        std::find_if(findings.begin(), findings.end(), [&](const Finding& f) { return f.robot == robot.name; });
    row.emplace_back(robot.observed_s / 3'600.0);
    row.push_back(robot.task_known ? Value(robot.task_s / 3'600.0) : Value(Missing{"task status is not in the log"}));
    row.push_back(robot.pose_source.empty() ? Value(Missing{no_pose}) : Value(robot.track.path_m * 1e-3));
    row.emplace_back(sum.episodes);
    row.emplace_back(static_cast<std::int64_t>(count_incidents(robot.blocked)));
    row.emplace_back(cells::rate(k, robot.observed_s, 3'600.0, "1/h"));
    row.emplace_back(robot.pose_source.empty() ? cells::missing("1/km", no_pose)
                                               : cells::rate(k, robot.track.path_m, 1'000.0, "1/km"));
    row.emplace_back(sum.blocked());
    row.emplace_back(sum.lost());
    row.push_back(finding != findings.end() && finding->value.value ? Value(*finding->value.value)
                                                                    : Value(Missing{"no time on task observed"}));
    row.push_back(robot.slowed_known ? Value(static_cast<std::int64_t>(robot.slowed.size()))
                                     : Value(Missing{no_slowed}));
    row.push_back(robot.slowed_known ? Value(robot.slowed_s / 3'600.0) : Value(Missing{no_slowed}));
    table.rows.push_back(std::move(row));
  }
  return table;
}

DataTable by_reason(const BlockageData& data) {
  DataTable table;
  table.name = "by_reason";
  table.title = "Blockage by reason";
  table.columns = {{"reason", "", "What saw the obstacle; of an episode the first that was given"},
                   integer_column("episodes", "Blocked episodes"),
                   {"blocked", "s", "Sum of durations; limits over the poll bounds", true},
                   {"lost", "s", "Lost time; limits over the poll bounds", true},
                   {"lost_of_all_lost_pct", "%", "Lost time for this reason over all lost time"},
                   {"median_s", "s", "Median duration"},
                   integer_column("slowed_episodes", "Slowed episodes"),
                   {"slowed_s", "s", "Sum of their durations"}};
  std::map<std::int64_t, EpisodeSum> reasons;
  double all_lost_s = 0.0;
  for (const Loss& loss : data.losses) {
    reasons[loss.episode->reason.value_or(kNoReason)].add(loss);
    all_lost_s += loss.mid_s;
  }
  std::vector<Episode> slowed;
  for (const RobotBlockage& robot : data.robots) {
    slowed.insert(slowed.end(), robot.slowed.begin(), robot.slowed.end());
  }
  for (const Episode& e : slowed) {
    reasons.try_emplace(e.reason.value_or(kNoReason));
  }
  for (const auto& [reason, sum] : reasons) {
    const auto key = reason;
    const auto slow = std::count_if(slowed.begin(), slowed.end(),
                                    [&](const Episode& e) { return e.reason.value_or(kNoReason) == key; });
    table.rows.push_back({reason_name(reason), sum.episodes, sum.blocked(), sum.lost(),
                          all_lost_s > 0.0 ? Value(100.0 * sum.lost_s / all_lost_s) : Value(Missing{"no time lost"}),
                          sum.episodes > 0 ? Value(median(sum.durations)) : Value(Missing{"no episode"}),
                          static_cast<std::int64_t>(slow), slowed_s(slowed, reason)});
  }
  return table;
}

DataTable by_class(const BlockageData& data) {
  DataTable table;
  table.name = "by_class";
  table.title = "Blockage by what the robot was about";
  table.columns = {{"class", "", "on_task: task running; off_task: none running or not known; manual: joystick active"},
                   integer_column("episodes", "Blocked episodes"),
                   {"blocked", "s", "Sum of durations; limits over the poll bounds", true},
                   {"lost", "s", "Lost time; limits over the poll bounds", true}};
  for (std::size_t c = 0; c < kEpisodeClasses; ++c) {
    EpisodeSum sum;
    for (const Loss& loss : data.losses) {
      if (static_cast<std::size_t>(loss.episode->cls) == c) {
        sum.add(loss);
      }
    }
    table.rows.push_back(
        {std::string(episode_class_name(static_cast<EpisodeClass>(c))), sum.episodes, sum.blocked(), sum.lost()});
  }
  return table;
}

/// One bad sensor blocks everywhere: many places for one id.
DataTable by_sensor(const BlockageData& data) {
  DataTable table;
  table.name = "by_sensor";
  table.title = "Episodes by ultrasonic sensor and digital input";
  table.columns = {{"robot", "", "Robot"},
                   {"sensor", "", "Ultrasonic sensor or digital input"},
                   integer_column("id", "Its number"),
                   integer_column("episodes", "Blocked episodes"),
                   integer_column("places", "Different square metres in which they happened"),
                   {"lost_s", "s", "Lost time"}};
  struct Sums {
    std::int64_t episodes = 0;
    double lost_s = 0.0;
    std::set<std::pair<std::int64_t, std::int64_t>> places;
  };
  std::map<std::tuple<std::size_t, std::string, std::int64_t>, Sums> sensors;
  for (const Loss& loss : data.losses) {
    const Episode& e = *loss.episode;
    const bool sonic = e.reason == 0 && e.ultrasonic_id;
    const bool input = e.reason && *e.reason >= 2 && *e.reason <= 4 && e.di;
    if (!sonic && !input) {
      continue;
    }
    Sums& sums = sensors[{loss.robot, sonic ? "ultrasonic" : "di", sonic ? *e.ultrasonic_id : *e.di}];
    ++sums.episodes;
    sums.lost_s += loss.mid_s;
    if (e.at) {
      const math::CellIndex place = math::cell_of(*e.at, 1.0);
      sums.places.emplace(place.i, place.j);
    }
  }
  for (const auto& [key, sums] : sensors) {
    table.rows.push_back({data.robots[std::get<0>(key)].name, std::get<1>(key), std::get<2>(key), sums.episodes,
                          static_cast<std::int64_t>(sums.places.size()), sums.lost_s});
  }
  return table;
}

std::vector<Value> episode_cells(const BlockageData& data, const Loss& loss) {
  const Episode& e = *loss.episode;
  const std::string not_given = "not given";
  const std::optional<math::Point> obstacle = obstacle_in_map(e, data.frames[loss.robot].frame);
  const auto time = [](const std::optional<Micros>& t, const char* why) -> Value {
    return t ? Value(Time{*t}) : Value(Missing{why});
  };
  const auto coordinate = [](const std::optional<math::Point>& p, double math::Point::*axis, const char* why) -> Value {
    return p ? Value((*p).*axis) : Value(Missing{why});
  };
  const char* no_frame = "the frame of obstacle points is unknown, or the point is not given";
  return {data.robots[loss.robot].name,
          time(e.onset_lo_us, "blocked in the first poll"),
          Time{e.onset_hi_us},
          Time{e.end_lo_us},
          time(e.end_hi_us, "blocked at the end"),
          e.duration_lo_s(),
          cells::maybe(e.duration_hi_s(), "not bounded"),
          cells::bounded(loss.mid_s, loss.lo_s, loss.hi_s, "s"),
          reason_name(e.reason.value_or(kNoReason)),
          std::string(episode_class_name(e.cls)),
          coordinate(e.at, &math::Point::x, "no pose"),
          coordinate(e.at, &math::Point::y, "no pose"),
          coordinate(obstacle, &math::Point::x, no_frame),
          coordinate(obstacle, &math::Point::y, no_frame),
          e.map,
          cells::text(e.station, "at no station"),
          cells::code(field("task_type"), e.task_type),
          cells::maybe(e.ultrasonic_id, not_given),
          cells::maybe(e.di, not_given),
          e.joined,
          e.onset_in_gap || e.end_in_gap || e.over_gap};
}

DataTable episode_table(const BlockageData& data) {
  DataTable table;
  table.name = "episodes";
  table.title = "Every blocked episode";
  table.detail = true;
  table.columns = {{"robot", "", "Robot"},
                   {"onset_lo", "", "Blocked after this time; empty: not bounded", false, true},
                   {"onset_hi", "", "Blocked at this time", false, true},
                   {"end_lo", "", "Still blocked at this time", false, true},
                   {"end_hi", "", "Free at this time; empty: blocked at the end", false, true},
                   {"duration_lo_s", "s", "Shortest possible duration"},
                   {"duration_hi_s", "s", "Longest possible duration; empty: not bounded"},
                   {"lost", "s", "Lost time; limits over the poll bounds", true},
                   {"reason", "", "First reason given"},
                   {"class", "", "What the robot was about at the onset"},
                   {"x_m", "m", "Robot at first sight"},
                   {"y_m", "m", "Robot at first sight"},
                   {"obstacle_x_m", "m", "Obstacle in the map"},
                   {"obstacle_y_m", "m", "Obstacle in the map"},
                   {"map", "", "Map"},
                   {"station", "", "Station at first sight"},
                   {"task_type", "", "Task type at first sight"},
                   integer_column("ultrasonic_id", "Ultrasonic sensor"),
                   integer_column("di", "Digital input"),
                   integer_column("joined", "Further runs joined to the first"),
                   flag_column("gap", "Onset or end lies in a gap")};
  for (const Loss& loss : data.losses) {
    table.rows.push_back(episode_cells(data, loss));
  }
  return table;
}

}  // namespace

void add_blockage_tables(const BlockageData& data, Section& section) {
  section.tables.push_back(by_robot(data));
  section.tables.push_back(by_reason(data));
  section.tables.push_back(by_class(data));
  section.tables.push_back(by_sensor(data));
  section.tables.push_back(episode_table(data));
}

}  // namespace tacho
