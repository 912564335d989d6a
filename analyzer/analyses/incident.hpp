#pragma once
// What happened around one moment: events, alarms, gaps and changed signals of all robots in the order of time, the
// state at that moment, and how good the data are that say so (METHODS E.2).

#include <span>
#include <string>

#include "analyzer/report/section.hpp"
#include "analyzer/settings.hpp"
#include "schema/row_source.hpp"

namespace tacho {

struct IncidentQuery {
  Micros at_us = 0;
  Micros before_us = 60'000'000;
  Micros after_us = 30'000'000;
  std::string zone = "UTC";
};

/// Robots by id; empty = all. Reads the window, the ten minutes before it (the state things were in) and the gap and
/// event rows of the whole log.
Section incident(RowSource& log, std::span<const RobotId> robots, const IncidentQuery& query, const Settings& settings);

/// Its rows of setting_rows(): what counts as a change, one row per unit.
std::span<const SettingRow> incident_settings();

}  // namespace tacho
