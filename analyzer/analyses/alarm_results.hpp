#pragma once
// What the alarm analysis knows after the fold, and the parts of its Section.

#include <map>
#include <string>
#include <vector>

#include "analyzer/analyses/alarm_exposure.hpp"
#include "analyzer/analyses/alarm_measures.hpp"
#include "analyzer/analyses/alarm_tracker.hpp"
#include "analyzer/report/section.hpp"
#include "analyzer/settings.hpp"

namespace tacho {

/// The robot's own words about an alarm: the last ones seen.
struct AlarmWords {
  std::string desc;
  std::string solution;
};

struct RobotAlarms {
  std::string name;
  std::string source;   ///< "status" or "registers"; empty: this log cannot tell
  std::string why_not;  ///< reason when it cannot
  AlarmTracker tracker;
  AlarmExposure exposure;
  std::map<AlarmKey, AlarmWords> words;
  Micros period_us = 0;  ///< detection limit: shorter alarms may be missed
  bool clock_known = false;

  [[nodiscard]] const std::vector<AlarmInterval>& intervals() const { return tracker.intervals(); }
};

struct AlarmRules {
  FloodRule flood;
  ChatterRule chatter;
  double fleeting_s;
  double stale_s;
  double min_hours;
};
AlarmRules alarm_rules(const Settings& settings);

/// One robot, or all robots of the log as one operator sees them.
struct AlarmScope {
  std::string robot;  ///< empty: all
  std::vector<Raise> raises;
  double hours = 0.0;        ///< observed; for all robots: while at least one was observed
  double robot_hours = 0.0;  ///< observed hours of each robot, added up
  double km = 0.0;
  bool has_odo = false;
  double dispersion = 1.0;  ///< of daily counts; 1 when there are too few days
  Micros end_us = 0;
  std::map<std::int64_t, double> bins;  ///< observed seconds per 10 minutes, at most 600
  std::vector<Flood> floods;
};

struct AlarmData {
  const std::vector<RobotAlarms>& robots;
  const Settings& settings;
  std::string zone;
  AlarmRules rules;
  std::vector<AlarmScope> scopes;  ///< all robots first, then each robot that can tell
};
AlarmData alarm_data(const std::vector<RobotAlarms>& robots, const Settings& settings, const std::string& zone);

/// Raises of one robot by key, each list by middle. Keys that never count have an empty list.
std::map<AlarmKey, std::vector<Raise>> raises_by_key(const RobotAlarms& robot, std::size_t index);

std::vector<std::string> alarm_notes(const AlarmData& data);
std::vector<Finding> alarm_findings(const AlarmData& data);
void add_alarm_rate_tables(const AlarmData& data, Section& section);
void add_alarm_code_tables(const AlarmData& data, Section& section);
void add_alarm_detail_tables(const AlarmData& data, Section& section);

}  // namespace tacho
