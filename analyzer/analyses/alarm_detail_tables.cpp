// Floods, chattering, standing alarms, stops, and the list of all intervals.

#include <algorithm>

#include "analyzer/analyses/alarm_results.hpp"
#include "analyzer/analyses/cells.hpp"
#include "schema/time.hpp"

namespace tacho {
namespace {

DataTable flood_table(const AlarmData& data) {
  DataTable table;
  table.name = "floods";
  table.title = "Alarm floods";
  table.columns = {{"robot", "", "Robot; all = as one operator sees them"},
                   {"from", "", "Raise that made it a flood", false, true},
                   {"to", "", "When fewer were left in the window", false, true},
                   {"duration_s", "s", "Length"},
                   integer_column("raises", "Alarms of the window that made it one, and since"),
                   integer_column("peak", "Most in one window"),
                   {"first_out", "", "Oldest alarm in the window that started it"},
                   {"first_out_robot", "", "Robot that had it"}};
  for (const AlarmScope& scope : data.scopes) {
    for (const Flood& flood : scope.floods) {
      table.rows.push_back({scope.robot.empty() ? std::string("all") : scope.robot, Time{flood.from_us},
                            Time{flood.to_us}, to_seconds(flood.to_us - flood.from_us),
                            static_cast<std::int64_t>(flood.raises), static_cast<std::int64_t>(flood.peak),
                            alarm_text(flood.first_out.key), data.robots[flood.first_out.robot].name});
    }
  }
  return table;
}

DataTable chatter_table(const AlarmData& data) {
  DataTable table;
  table.name = "chattering";
  table.title = "Chattering codes";
  table.columns = {
      {"robot", "", "Robot"},
      {"level", "", "Level of the alarm array"},
      integer_column("code", "Alarm code"),
      integer_column("raises", "Raised while observed"),
      integer_column("most_in_window", "Most raises in one window"),
      integer_column("runs", "Separate times of chattering"),
      flag_column("sure", "Chattering whatever the true onsets inside their bounds"),
      {"index", "1/s", "Chatter index: sum of P_r / r over run lengths r >= 1 s; limits over the onset bounds", true}};
  for (std::size_t r = 0; r < data.robots.size(); ++r) {
    for (const auto& [key, raises] : raises_by_key(data.robots[r], r)) {
      const Chatter c = chattering(raises, data.rules.chatter);
      if (c.possible) {
        table.rows.push_back({data.robots[r].name, std::string(alarm_level_name(key.level)), key.code,
                              static_cast<std::int64_t>(raises.size()), static_cast<std::int64_t>(c.most),
                              static_cast<std::int64_t>(c.runs), c.sure,
                              cells::bounded(c.index, c.index_lo, c.index_hi, "1/s")});
      }
    }
  }
  return table;
}

DataTable standing_table(const AlarmData& data) {
  DataTable table;
  table.name = "standing";
  table.title = "Stale alarms and alarms standing at the end";
  table.columns = {
      {"robot", "", "Robot"},
      {"level", "", "Level of the alarm array"},
      integer_column("code", "Alarm code"),
      {"since", "", "Latest possible onset; for one that stood in the first poll the first sight of it", false, true},
      {"seen_until", "", "Last sight", false, true},
      {"at_least_h", "h", "Surely active for"},
      flag_column("stale", "Longer than the limit for stale alarms"),
      flag_column("open", "Standing at the end of the record")};
  for (const RobotAlarms& robot : data.robots) {
    for (const AlarmInterval& a : robot.intervals()) {
      const bool is_stale = a.duration_lo_s() > data.rules.stale_s;
      if (is_stale || a.clear == Clear::open) {
        table.rows.push_back({robot.name, std::string(alarm_level_name(a.key.level)), a.key.code, Time{a.onset_hi_us},
                              Time{a.clear_lo_us}, a.duration_lo_s() / 3'600.0, is_stale, a.clear == Clear::open});
      }
    }
  }
  return table;
}

/// Repair times of the stops that lie whole inside the observed time.
struct Repair {
  std::vector<double> mid;
  double lo_sum = 0.0, hi_sum = 0.0;
};

Repair repairs(const std::vector<Down>& downs) {
  Repair out;
  for (const Down& d : downs) {
    if (!d.cut) {
      const double lo = std::max(0.0, to_seconds(d.end_lo_us - d.onset_hi_us));
      const double hi = to_seconds(d.end_hi_us - d.onset_lo_us);
      out.mid.push_back((lo + hi) / 2.0);
      out.lo_sum += lo;
      out.hi_sum += hi;
    }
  }
  std::sort(out.mid.begin(), out.mid.end());
  return out;
}

void repair_cells(const Repair& repair, std::vector<Value>& row) {
  if (repair.mid.empty()) {
    row.emplace_back(cells::missing("s", "no stop lies whole inside the observed time"));
    row.emplace_back(Missing{"no stop lies whole inside the observed time"});
    return;
  }
  const double n = static_cast<double>(repair.mid.size());
  double sum = 0.0;
  for (const double s : repair.mid) {
    sum += s;
  }
  Quantity mean = cells::bounded(sum / n, repair.lo_sum / n, repair.hi_sum / n, "s");
  mean.n = static_cast<std::int64_t>(repair.mid.size());
  row.emplace_back(mean);
  const std::size_t half = repair.mid.size() / 2;
  row.emplace_back(repair.mid.size() % 2 == 1 ? repair.mid[half] : (repair.mid[half - 1] + repair.mid[half]) / 2.0);
}

/// MTBF from the limits of the stop count: more stops, less time between them.
Quantity mtbf(double up_h, std::size_t stops) {
  if (!(up_h > 0.0)) {
    return cells::missing("h", "no up time was observed");
  }
  const math::Limits k = math::garwood(static_cast<double>(stops));
  Quantity q;
  q.unit = "h";
  q.n = static_cast<std::int64_t>(stops);
  q.exposure = up_h;
  q.lo = up_h / k.hi;
  if (stops == 0) {
    q.reason = "no stop seen: above " + cells::short_number(*q.lo) + " h";
    return q;
  }
  q.value = up_h / static_cast<double>(stops);
  q.hi = up_h / k.lo;
  return q;
}

DataTable availability(const AlarmData& data) {
  DataTable table;
  table.name = "availability";
  table.title = "Stops by alarms";
  table.columns = {{"robot", "", "Robot"},
                   {"task_h", "h", "Observed time with a running task"},
                   {"up_h", "h", "Of it without a stop"},
                   {"down_h", "h", "Of it stopped by an alarm"},
                   integer_column("stops", "Stops by alarms"),
                   {"mtbf", "h", "Up time per stop, Garwood limits", true},
                   {"mttr", "s", "Mean length of a stop; limits over the poll bounds", true},
                   {"median_stop_s", "s", "Median length of a stop"},
                   {"availability", "1", "Up / (up + down)"},
                   {"moving_h", "h", "Observed time in motion"}};
  for (const RobotAlarms& robot : data.robots) {
    const AlarmExposure& e = robot.exposure;
    std::vector<Value> row{robot.name};
    if (!e.task_known) {
      for (std::size_t i = 1; i < table.columns.size(); ++i) {
        row.emplace_back(Missing{"task status and motion are not both in the log"});
      }
      table.rows.push_back(std::move(row));
      continue;
    }
    const double up_s = e.task_s - e.down_s;
    row.emplace_back(e.task_s / 3'600.0);
    row.emplace_back(up_s / 3'600.0);
    row.emplace_back(e.down_s / 3'600.0);
    row.emplace_back(static_cast<std::int64_t>(e.downs.size()));
    row.emplace_back(mtbf(up_s / 3'600.0, e.downs.size()));
    repair_cells(repairs(e.downs), row);
    row.push_back(e.task_s > 0.0 ? Value(up_s / e.task_s) : Value(Missing{"no task was running"}));
    row.emplace_back(e.moving_s / 3'600.0);
    table.rows.push_back(std::move(row));
  }
  return table;
}

std::vector<ColumnSpec> interval_columns() {
  return {{"robot", "", "Robot"},
          {"level", "", "Level of the alarm array"},
          integer_column("code", "Alarm code"),
          {"description", "", "The robot's last words for it"},
          {"onset_lo", "", "Raised after this time; empty: not bounded", false, true},
          {"onset_hi", "", "Raised at this time or before", false, true},
          {"clear_lo", "", "Stood at this time", false, true},
          {"clear_hi", "", "Cleared at this time or before; empty: standing at the end", false, true},
          {"duration_lo_s", "s", "Shortest possible duration"},
          {"duration_hi_s", "s", "Longest possible duration; empty: not bounded"},
          {"onset", "", "seen, inferred, in_gap, before_record"},
          {"clear", "", "seen, inferred, in_gap, censored, open"},
          {"over_gap", "", "Stood over a gap: proven by its stamp, assumed, or no"},
          flag_column("censored_set",
                      "Seen in a full register set, or beside elements that could not be read: bounds only"),
          integer_column("repeats", "Growth of `times`"),
          {"robot_stamp_s", "s", "The robot's own stamp, unix seconds of the robot's clock"},
          flag_column("stamped", "Onset narrowed by the robot's stamp"),
          {"stopped_s", "s", "Stopped time attributed, shared"},
          {"x_m", "m", "Position at first sight"},
          {"y_m", "m", "Position at first sight"},
          {"map", "", "Map at first sight"},
          {"station", "", "Station at first sight"},
          {"speed_mps", "m/s", "Speed at first sight"},
          {"battery_level", "1", "State of charge at first sight"},
          {"confidence", "1", "Localisation confidence at first sight"},
          {"task_status", "", "Task status at first sight"},
          {"task_type", "", "Task type at first sight"},
          {"rssi", "%", "Wi-Fi signal at first sight"},
          {"solution", "", "The robot's own words on what to do"}};
}

std::vector<Value> interval_cells(const RobotAlarms& robot, const AlarmInterval& a) {
  const auto time = [](const std::optional<Micros>& t, const char* why) -> Value {
    return t ? Value(Time{*t}) : Value(Missing{why});
  };
  const auto at = robot.words.find(a.key);
  const AlarmWords words = at != robot.words.end() ? at->second : AlarmWords{};
  const std::string not_given = "not given";
  const AlarmContext& c = a.context;
  return {robot.name,
          std::string(alarm_level_name(a.key.level)),
          a.key.code,
          cells::text(words.desc, not_given),
          time(a.onset_lo_us, "stood before the first poll"),
          Time{a.onset_hi_us},
          Time{a.clear_lo_us},
          time(a.clear_hi_us, "standing at the end"),
          a.duration_lo_s(),
          cells::maybe(a.duration_hi_s(), "not bounded"),
          std::string(onset_name(a.onset)),
          std::string(clear_name(a.clear)),
          std::string(a.over_gap      ? "proven"
                      : a.assumed_one ? "assumed"
                                      : "no"),
          a.censored_set,
          a.repeats,
          a.stamp_s > 0 ? Value(a.stamp_s) : Value(Missing{not_given}),
          a.stamped,
          a.stopped_s,
          cells::maybe(c.x_m, not_given),
          cells::maybe(c.y_m, not_given),
          cells::text(c.map, not_given),
          cells::text(c.station, "at no station"),
          cells::maybe(c.speed_mps, not_given),
          cells::maybe(c.battery_level, not_given),
          cells::maybe(c.confidence, not_given),
          cells::code(field("task_status"), c.task_status),
          cells::code(field("task_type"), c.task_type),
          cells::maybe(c.rssi, not_given),
          cells::text(words.solution, not_given)};
}

}  // namespace

void add_alarm_detail_tables(const AlarmData& data, Section& section) {
  section.tables.push_back(flood_table(data));
  section.tables.push_back(chatter_table(data));
  section.tables.push_back(standing_table(data));
  section.tables.push_back(availability(data));
  DataTable intervals;
  intervals.name = "intervals";
  intervals.title = "Every alarm";
  intervals.detail = true;
  intervals.columns = interval_columns();
  for (const RobotAlarms& robot : data.robots) {
    for (const AlarmInterval& a : robot.intervals()) {
      intervals.rows.push_back(interval_cells(robot, a));
    }
  }
  section.tables.push_back(std::move(intervals));
}

}  // namespace tacho
