#pragma once
// Everything the odometry analysis found about one robot, and how it becomes tables and findings.

#include <optional>
#include <string>
#include <vector>

#include "analyzer/analyses/odometry_counter.hpp"
#include "analyzer/analyses/odometry_cross.hpp"
#include "analyzer/analyses/odometry_drift.hpp"
#include "analyzer/analyses/odometry_jumps.hpp"
#include "analyzer/analyses/odometry_path.hpp"
#include "analyzer/analyses/odometry_speed.hpp"
#include "analyzer/analyses/odometry_standstill.hpp"
#include "analyzer/math/trend.hpp"
#include "analyzer/report/section.hpp"

namespace tacho::odometry {

/// Measures that need no pose, one per source with a counter or a speed.
struct SourceResult {
  Source source = Source::status;
  double period_s = kNone;
  std::uint64_t rows = 0;
  std::uint64_t duplicates = 0;
  Accelerations accelerations;
  CounterResult counter;
  CountsResult counts;
  SpeedResult speed;
};

/// Counter against speed of one day.
struct SpeedDay {
  std::string day;  ///< "2026-01-08" in the report's zone
  double number = 0;
  double g = 0;
  std::int64_t windows = 0;
};

struct TagTime {
  std::string name;
  std::string meaning;
  double hours = 0;
  std::uint64_t rows = 0;
};

struct RobotResult {
  std::string robot;
  Config config;
  const Settings* settings = nullptr;
  std::string zone;
  std::vector<SourceResult> sources;  ///< the first is the one that pose measures use; empty: no rows
  std::vector<Segment> segments;
  std::vector<TagTime> tags;
  std::vector<SpeedDay> days;
  std::optional<Trend> g_trend;  ///< per day; empty with fewer than five days
  StandstillResult still;
  JumpResult jumps;
  PathResult path;
  DriftResult drift;
  CrossResult cross;

  /// Sources of the named settings, "odometry." put before each.
  [[nodiscard]] std::string from(std::initializer_list<std::string_view> names) const;
};

std::vector<DataTable> make_tables(const std::vector<RobotResult>& robots);
std::vector<Series> make_series(const RobotResult& robot);
std::vector<Finding> make_findings(const RobotResult& robot);
std::vector<std::string> make_notes(const RobotResult& robot);

}  // namespace tacho::odometry
