#include "analyzer/analyses/alarm_results.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "analyzer/analyses/cells.hpp"

namespace tacho {
namespace {

Micros us(double s) { return static_cast<Micros>(std::llround(s * 1e6)); }

/// Scatter of daily counts, over days observed for at least an hour.
double daily_dispersion(const AlarmScope& scope, const std::map<std::int64_t, double>& days, const std::string& zone) {
  LocalTime local(zone);
  std::map<std::int64_t, double> counts;
  for (const Raise& raise : scope.raises) {
    counts[local.day(raise.mid_us())] += 1.0;
  }
  std::vector<double> k;
  std::vector<double> e;
  for (const auto& [day, seconds] : days) {
    if (seconds >= 3'600.0) {
      k.push_back(counts[day]);
      e.push_back(seconds);
    }
  }
  return dispersion(k, e).value_or(1.0);
}

AlarmScope scope_of(const std::vector<RobotAlarms>& robots, std::optional<std::size_t> only, const AlarmData& data) {
  AlarmScope scope;
  scope.robot = only ? robots[*only].name : "";
  std::map<std::int64_t, double> days;
  for (std::size_t r = 0; r < robots.size(); ++r) {
    if ((only && *only != r) || robots[r].source.empty()) {
      continue;
    }
    const AlarmExposure& e = robots[r].exposure;
    const std::vector<Raise> raises = raises_of(robots[r].intervals(), r);
    scope.raises.insert(scope.raises.end(), raises.begin(), raises.end());
    scope.robot_hours += e.observed_s / 3'600.0;
    scope.km += e.km;
    scope.has_odo = scope.has_odo || e.has_odo;
    scope.end_us = std::max(scope.end_us, e.last_us);
    for (const auto& [bin, seconds] : e.ten_minutes) {
      double& widest = scope.bins[bin];
      widest = std::max(widest, std::min(600.0, seconds));
    }
    for (const auto& [day, seconds] : e.days) {
      days[day] += seconds;
    }
  }
  for (const auto& [bin, seconds] : scope.bins) {
    scope.hours += seconds / 3'600.0;
  }
  sort_by_middle(scope.raises);
  scope.dispersion = daily_dispersion(scope, days, data.zone);
  scope.floods = find_floods(scope.raises, data.rules.flood, scope.end_us);
  return scope;
}

std::string stamp_note(const RobotAlarms& robot) {
  const StampCounts& s = robot.tracker.stamps();
  std::string note = fmt::format("{}: ", robot.name);
  if (!robot.clock_known) {
    note += "the robot's clock is not in the log, so onsets are bounded by the polls only";
  } else {
    note += fmt::format("{} onsets narrowed by the robot's stamp", s.narrowed);
    if (s.conflicts > 0) {
      note += fmt::format("; {} stamps contradict the polls and were not used: check the robot's clock", s.conflicts);
    }
  }
  if (s.last_moves + s.first_stays > 0) {
    note +=
        fmt::format("; on this firmware the stamp of a repeated alarm tells its {} occurrence ({} of {} repetitions)",
                    s.last_moves > s.first_stays ? "last" : "first", std::max(s.last_moves, s.first_stays),
                    s.last_moves + s.first_stays);
  }
  if (s.ambiguous > 0) {
    note += fmt::format("; {} stamps moved without a matching step of `times`", s.ambiguous);
  }
  return note;
}

}  // namespace

AlarmRules alarm_rules(const Settings& settings) {
  AlarmRules rules;
  const auto whole = [&](std::string_view name) {
    return static_cast<std::size_t>(std::max(1.0, std::round(settings.number(name))));
  };
  rules.flood = {us(settings.number("alarms.flood_window_s")), whole("alarms.flood_above"),
                 whole("alarms.flood_below")};
  rules.chatter = {us(settings.number("alarms.chatter_window_s")), whole("alarms.chatter_raises")};
  rules.fleeting_s = settings.number("alarms.fleeting_s");
  rules.stale_s = settings.number("alarms.stale_h") * 3'600.0;
  rules.min_hours = settings.number("alarms.min_hours");
  return rules;
}

AlarmData alarm_data(const std::vector<RobotAlarms>& robots, const Settings& settings, const std::string& zone) {
  AlarmData data{robots, settings, zone, alarm_rules(settings), {}};
  data.scopes.push_back(scope_of(robots, std::nullopt, data));
  for (std::size_t r = 0; r < robots.size(); ++r) {
    if (!robots[r].source.empty()) {
      data.scopes.push_back(scope_of(robots, r, data));
    }
  }
  return data;
}

std::map<AlarmKey, std::vector<Raise>> raises_by_key(const RobotAlarms& robot, std::size_t index) {
  std::map<AlarmKey, std::vector<Raise>> out;
  for (const AlarmInterval& a : robot.intervals()) {
    out.try_emplace(a.key);
  }
  for (const Raise& raise : raises_of(robot.intervals(), index)) {
    out[raise.key].push_back(raise);
  }
  return out;
}

std::vector<std::string> alarm_notes(const AlarmData& data) {
  std::vector<std::string> notes{
      "An alarm is a (level, code) that stands in the robot's alarm arrays; it is raised when it appears and cleared "
      "when it "
      "disappears. Both happened between two polls: every time is an interval that holds the truth. Repetitions inside "
      "one "
      "standing alarm (`times`) are a column of their own.",
      "Rates count raises seen while the robot was observed: alarms that stood in the first poll or came up in a gap "
      "are "
      "listed, not counted. Limits are Garwood's, 95 %.",
      "Active time is what was seen: in a gap (recorder off, robot not reached) nobody knows when an alarm came or "
      "went, "
      "so the gap is in the upper limit alone, unless the robot's stamp proves that the alarm stood through it or says "
      "when it came.",
      fmt::format(
          "Stop: task running, robot not moving, and an alarm of level {} or worse active. Up time: task running "
          "without such a stop. MTBF = up time / stops.",
          alarm_level_name(static_cast<AlarmLevel>(
              std::clamp(static_cast<int>(data.settings.number("alarms.stopping_level")), 0, 3)))),
      fmt::format(
          "Rate bands: ANSI/ISA-18.2-2016 and IEC 62682:2014, per operator position: about 6 per hour acceptable, 12 "
          "manageable; flood: more than {} in {} min until fewer than {}. Printed for one operator who watches all "
          "{} robots of this log, and for each robot.",
          data.rules.flood.above, static_cast<double>(data.rules.flood.window_us) / 60e6, data.rules.flood.below,
          data.robots.size()),
  };
  for (const RobotAlarms& robot : data.robots) {
    if (robot.source.empty()) {
      notes.push_back(fmt::format("{}no alarms: {}", robot.name.empty() ? "" : robot.name + ": ", robot.why_not));
      continue;
    }
    const double period_s = static_cast<double>(robot.period_us) * 1e-6;
    notes.push_back(fmt::format(
        "{}: alarms from {}, {} polls; detection limit {} s: an alarm of length D is seen with "
        "probability D / {} s, surely from there on. Counts are not corrected for that, because "
        "ends carry no stamp.",
        robot.name, robot.source, robot.exposure.polls, cells::short_number(period_s), cells::short_number(period_s)));
    if (robot.source == "registers") {
      notes.push_back(
          fmt::format("{}: the registers show the first code of each level and six errors, no notices and no "
                      "stamps; alarms that may have stood behind others are marked censored_set.",
                      robot.name));
    } else {
      notes.push_back(stamp_note(robot));
    }
  }
  return notes;
}

}  // namespace tacho
