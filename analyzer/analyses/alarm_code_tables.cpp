// Tables by alarm code: counts, active and stopped time, and the three Paretos.

#include <algorithm>
#include <map>

#include "analyzer/analyses/alarm_results.hpp"
#include "analyzer/analyses/cells.hpp"

namespace tacho {
namespace {

constexpr std::size_t kTopCodes = 10;

struct CodeSum {
  AlarmKey key;
  std::string desc;
  std::int64_t raises = 0, listed = 0, repeats = 0, robots = 0;
  ActiveTime active;
  double stopped_s = 0.0, stopped_first_s = 0.0;
  double hours = 0.0, km = 0.0;
  Lasting fleeting, stale;
  bool censored_set = false;
};

void add(CodeSum& sum, const AlarmInterval& a, const ActiveTime& active, const AlarmRules& rules) {
  const Lasting brief = fleeting({&a, 1}, rules.fleeting_s);
  sum.raises += a.counts() ? 1 : 0;
  sum.listed += 1;
  sum.repeats += a.repeats;
  sum.active.mid_s += active.mid_s;
  sum.active.lo_s += active.lo_s;
  sum.active.hi_s += active.hi_s;
  sum.stopped_s += a.stopped_s;
  sum.stopped_first_s += a.stopped_first_s;
  sum.fleeting.sure += brief.sure;
  sum.fleeting.possible += brief.possible;
  sum.stale.sure += stale({&a, 1}, rules.stale_s).sure;
  sum.censored_set = sum.censored_set || a.censored_set;
}

void add_exposure(CodeSum& sum, const RobotAlarms& robot) {
  sum.hours += robot.exposure.level_s[static_cast<std::size_t>(sum.key.level)] / 3'600.0;
  sum.km += robot.exposure.km;
}

using CodeSums = std::map<AlarmKey, CodeSum>;

/// Adds the intervals of one robot, without exposure.
void add(CodeSums& sums, const RobotAlarms& robot, const AlarmRules& rules) {
  std::map<AlarmKey, Micros> counted_until;
  for (const AlarmInterval& a : robot.intervals()) {
    CodeSum& sum = sums[a.key];
    sum.key = a.key;
    const auto [until, first] = counted_until.try_emplace(a.key, robot.exposure.first_us);
    sum.robots += first ? 1 : 0;
    add(sum, a, active_time(a, robot.exposure.first_us, until->second), rules);
    until->second = std::max(until->second, a.clear_hi_us.value_or(a.clear_lo_us));
  }
  for (const auto& [key, until] : counted_until) {
    const auto words = robot.words.find(key);
    if (words != robot.words.end() && !words->second.desc.empty()) {
      sums[key].desc = words->second.desc;
    }
  }
}

/// Exposure of all robots whose log can show this level: a robot on which a code never came counts too.
std::vector<CodeSum> by_code(const AlarmData& data) {
  CodeSums sums;
  for (const RobotAlarms& robot : data.robots) {
    add(sums, robot, data.rules);
  }
  std::vector<CodeSum> out;
  for (auto& [key, sum] : sums) {
    for (const RobotAlarms& robot : data.robots) {
      add_exposure(sum, robot);
    }
    out.push_back(std::move(sum));
  }
  std::stable_sort(out.begin(), out.end(), [](const CodeSum& a, const CodeSum& b) { return a.raises > b.raises; });
  return out;
}

std::vector<ColumnSpec> code_columns() {
  return {{"level", "", "Level of the alarm array"},
          integer_column("code", "Alarm code"),
          {"description", "", "The robot's last words for it"},
          integer_column("raises", "Raised while observed"),
          integer_column("listed", "With those in gaps and at the start"),
          integer_column("repeats", "Growth of `times` while standing"),
          integer_column("robots", "Robots that had it"),
          {"share", "1", "Of all raises"},
          {"per_hour", "1/h", "Raises per robot hour", true},
          {"per_100km", "1/100km", "Raises per 100 km", true},
          {"active", "s", "Time it was seen to stand; what gaps may hold of it is in the upper limit alone", true},
          {"stopped_s", "s", "Task running and not moving while it stood; simultaneous alarms share equally"},
          {"stopped_first_s", "s", "The same, all of it to the alarm that stood first"},
          integer_column("fleeting_sure", "Surely fleeting"),
          integer_column("fleeting_possible", "Possibly fleeting"),
          integer_column("stale_sure", "Surely stale"),
          flag_column("censored_set",
                      "Seen in a full register set, or beside elements that could not be read: bounds only")};
}

std::vector<Value> code_cells(const CodeSum& c, double all_raises, bool has_odo) {
  return {std::string(alarm_level_name(c.key.level)),
          c.key.code,
          cells::text(c.desc, "not given"),
          c.raises,
          c.listed,
          c.repeats,
          c.robots,
          all_raises > 0.0 ? Value(static_cast<double>(c.raises) / all_raises) : Value(Missing{"no raises"}),
          cells::rate(static_cast<double>(c.raises), c.hours, 1.0, "1/h"),
          has_odo ? cells::rate(static_cast<double>(c.raises), c.km, 100.0, "1/100km")
                  : cells::missing("1/100km", "the odometer is not in the log"),
          cells::bounded(c.active.mid_s, c.active.lo_s, c.active.hi_s, "s"),
          c.stopped_s,
          c.stopped_first_s,
          c.fleeting.sure,
          c.fleeting.possible,
          c.stale.sure,
          c.censored_set};
}

DataTable code_table(const AlarmData& data, const std::vector<CodeSum>& codes) {
  DataTable table;
  table.name = "by_code";
  table.title = "Alarms by code, all robots";
  table.columns = code_columns();
  const AlarmScope& all = data.scopes.front();
  for (const CodeSum& c : codes) {
    table.rows.push_back(code_cells(c, static_cast<double>(all.raises.size()), all.has_odo));
  }
  return table;
}

DataTable robot_code_table(const AlarmData& data) {
  DataTable table;
  table.name = "by_robot_code";
  table.title = "Alarms by robot and code";
  table.detail = true;
  table.columns = code_columns();
  table.columns.insert(table.columns.begin(), {"robot", "", "Robot"});
  for (const RobotAlarms& robot : data.robots) {
    double raises = 0.0;
    for (const AlarmInterval& a : robot.intervals()) {
      raises += a.counts() ? 1.0 : 0.0;
    }
    CodeSums sums;
    add(sums, robot, data.rules);
    for (auto& [key, sum] : sums) {
      add_exposure(sum, robot);
      std::vector<Value> row = code_cells(sum, raises, robot.exposure.has_odo);
      row.insert(row.begin(), Value(robot.name));
      table.rows.push_back(std::move(row));
    }
  }
  return table;
}

struct ParetoOf {
  const char* name;
  const char* title;
  const char* unit;
  double (*value)(const CodeSum&);
};

DataTable pareto(const ParetoOf& of, std::vector<CodeSum> codes) {
  DataTable table;
  table.name = of.name;
  table.title = of.title;
  table.columns = {integer_column("rank", "Place"),
                   {"level", "", "Level of the alarm array"},
                   integer_column("code", "Alarm code"),
                   {"description", "", "The robot's last words for it"},
                   {"value", of.unit, "What is ranked", false, false, ColumnType::number},
                   {"share", "1", "Of the sum over all codes"},
                   {"cumulative_share", "1", "Of this and the places before"}};
  std::stable_sort(codes.begin(), codes.end(),
                   [&](const CodeSum& a, const CodeSum& b) { return of.value(a) > of.value(b); });
  double sum = 0.0;
  for (const CodeSum& c : codes) {
    sum += of.value(c);
  }
  double so_far = 0.0;
  for (std::size_t i = 0; i < std::min(kTopCodes, codes.size()) && of.value(codes[i]) > 0.0; ++i) {
    const double value = of.value(codes[i]);
    so_far += value;
    table.rows.push_back({static_cast<std::int64_t>(i + 1), std::string(alarm_level_name(codes[i].key.level)),
                          codes[i].key.code, cells::text(codes[i].desc, "not given"), value, value / sum,
                          so_far / sum});
  }
  return table;
}

}  // namespace

void add_alarm_code_tables(const AlarmData& data, Section& section) {
  const std::vector<CodeSum> codes = by_code(data);
  section.tables.push_back(code_table(data, codes));
  const ParetoOf all[] = {
      {"pareto_count", "Top codes by count", "", [](const CodeSum& c) { return static_cast<double>(c.raises); }},
      {"pareto_active", "Top codes by active time", "s", [](const CodeSum& c) { return c.active.mid_s; }},
      {"pareto_stopped", "Top codes by stopped time attributed", "s", [](const CodeSum& c) { return c.stopped_s; }}};
  for (const ParetoOf& of : all) {
    section.tables.push_back(pareto(of, codes));
  }
  section.tables.push_back(robot_code_table(data));
}

}  // namespace tacho
