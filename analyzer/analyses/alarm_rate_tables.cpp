// Rates by robot, level, hour of day, and how alarms spread over 10-minute bins.

#include <algorithm>
#include <cmath>

#include "analyzer/analyses/alarm_results.hpp"
#include "analyzer/analyses/cells.hpp"

namespace tacho {
namespace {

constexpr const char* kAll = "all";
constexpr double kFullBin_s = 540.0;  // bins observed for less than 90 % would look quieter than they were

std::string name_of(const AlarmScope& scope) { return scope.robot.empty() ? kAll : scope.robot; }

/// Counts of the 10-minute bins that were observed nearly whole, sorted.
std::vector<std::int64_t> bin_counts(const AlarmScope& scope) {
  std::map<std::int64_t, std::int64_t> counts;
  for (const auto& [bin, seconds] : scope.bins) {
    if (seconds >= kFullBin_s) {
      counts[bin] = 0;
    }
  }
  for (const Raise& raise : scope.raises) {
    const auto at = counts.find(LocalTime::floor_div(raise.mid_us(), 600'000'000));
    if (at != counts.end()) {
      ++at->second;
    }
  }
  std::vector<std::int64_t> out;
  for (const auto& [bin, n] : counts) {
    out.push_back(n);
  }
  std::sort(out.begin(), out.end());
  return out;
}

struct Tally {
  std::int64_t inferred = 0, in_gap = 0, before = 0, open = 0, repeats = 0;
};

Tally tally(const AlarmData& data, const AlarmScope& scope) {
  Tally t;
  for (const RobotAlarms& robot : data.robots) {
    if (!scope.robot.empty() && robot.name != scope.robot) {
      continue;
    }
    for (const AlarmInterval& a : robot.intervals()) {
      t.inferred += a.onset == Onset::inferred ? 1 : 0;
      t.in_gap += a.onset == Onset::in_gap ? 1 : 0;
      t.before += a.onset == Onset::before_record ? 1 : 0;
      t.open += a.clear == Clear::open ? 1 : 0;
      t.repeats += a.repeats;
    }
  }
  return t;
}

void ten_minute_cells(const AlarmData& data, const AlarmScope& scope, std::vector<Value>& row) {
  const std::vector<std::int64_t> counts = bin_counts(scope);
  if (counts.empty()) {
    for (int i = 0; i < 6; ++i) {
      row.emplace_back(Missing{"no 10 minutes were observed whole"});
    }
    return;
  }
  const double n = static_cast<double>(counts.size());
  double sum = 0.0;
  double above = 0.0;
  for (const std::int64_t k : counts) {
    sum += static_cast<double>(k);
    above += static_cast<std::size_t>(k) > data.rules.flood.above ? 1.0 : 0.0;
  }
  const std::size_t half = counts.size() / 2;
  const double median = counts.size() % 2 == 1 ? static_cast<double>(counts[half])
                                               : static_cast<double>(counts[half - 1] + counts[half]) / 2.0;
  const auto p95 = static_cast<std::size_t>(std::ceil(0.95 * n)) - 1;
  row.emplace_back(static_cast<std::int64_t>(counts.size()));
  row.emplace_back(sum / n);
  row.emplace_back(median);
  row.emplace_back(counts[p95]);
  row.emplace_back(counts.back());
  row.emplace_back(above / n);
}

DataTable summary(const AlarmData& data) {
  DataTable table;
  table.name = "summary";
  table.title = "Alarm rates";
  table.columns = {
      {"robot", "", "Robot; all = as one operator sees them"},
      {"observed", "h", "Time between polls without gaps; all: while at least one robot was observed"},
      {"distance", "km", "Driven by odometer while observed"},
      integer_column("raises", "Alarms raised while observed"),
      integer_column("inferred", "Of them hidden between two polls, inferred from stamp and `times`"),
      integer_column("raised_in_gaps", "Came up in a gap: not in the rates"),
      integer_column("at_start", "Stood already in the first poll: not in the rates"),
      integer_column("at_end", "Standing at the end of the record"),
      integer_column("repeats", "Growth of `times` inside standing alarms"),
      {"per_hour", "1/h", "Raises per observed hour", true},
      {"per_day", "1/d", "Raises per 24 observed hours", true},
      {"per_100km", "1/100km", "Raises per 100 km", true},
      integer_column("bins_10min", "10-minute bins observed nearly whole"),
      number_column("mean_10min", "Raises per 10 minutes, mean"),
      number_column("median_10min", "Raises per 10 minutes, median"),
      number_column("p95_10min", "Raises per 10 minutes, 95th percentile"),
      integer_column("max_10min", "Raises per 10 minutes, most"),
      {"share_above_flood", "1", "Share of bins with more raises than start a flood"},
      {"dispersion", "1", "Variance over mean of daily counts; above 1.5 the limits are widened by its root"},
  };
  for (const AlarmScope& scope : data.scopes) {
    const double k = static_cast<double>(scope.raises.size());
    const Tally t = tally(data, scope);
    const std::string no_odo = "the odometer is not in the log";
    std::vector<Value> row{name_of(scope), scope.hours};
    row.push_back(scope.has_odo ? Value(scope.km) : Value(Missing{no_odo}));
    for (const std::int64_t n :
         {static_cast<std::int64_t>(scope.raises.size()), t.inferred, t.in_gap, t.before, t.open, t.repeats}) {
      row.emplace_back(n);
    }
    row.emplace_back(cells::rate(k, scope.hours, 1.0, "1/h", scope.dispersion));
    row.emplace_back(cells::rate(k, scope.hours, 24.0, "1/d", scope.dispersion));
    row.emplace_back(scope.has_odo ? cells::rate(k, scope.km, 100.0, "1/100km", scope.dispersion)
                                   : cells::missing("1/100km", no_odo));
    ten_minute_cells(data, scope, row);
    row.emplace_back(scope.dispersion);
    table.rows.push_back(std::move(row));
  }
  return table;
}

DataTable by_level(const AlarmData& data) {
  DataTable table;
  table.name = "by_level";
  table.title = "Priority mix";
  table.columns = {{"level", "", "Level of the alarm array"},
                   integer_column("raises", "Alarms raised while observed"),
                   {"share", "1", "Of all raises"},
                   {"reference_share", "1", "80 / 15 / 5 from the lowest priority up (ANSI/ISA-18.2-2016)"},
                   {"observed", "h", "Robot hours in which the array of this level was in the answers"},
                   {"per_hour", "1/h", "Raises per robot hour", true}};
  const AlarmScope& all = data.scopes.front();
  const std::array<std::optional<double>, kAlarmLevels> reference{0.05, 0.15, 0.80, std::nullopt};
  for (std::size_t l = 0; l < kAlarmLevels; ++l) {
    const auto level = static_cast<AlarmLevel>(l);
    const auto k = std::count_if(all.raises.begin(), all.raises.end(),
                                 [&](const Raise& raise) { return raise.key.level == level; });
    double hours = 0.0;
    for (const RobotAlarms& robot : data.robots) {
      hours += robot.exposure.level_s[l] / 3'600.0;
    }
    const double n = static_cast<double>(all.raises.size());
    table.rows.push_back(
        {std::string(alarm_level_name(level)),
         hours > 0.0 ? Value(static_cast<std::int64_t>(k)) : Value(Missing{"this array was not recorded"}),
         n > 0.0 ? Value(static_cast<double>(k) / n) : Value(Missing{"no alarms"}),
         cells::maybe(reference[l], "a notice asks for no response"), hours,
         cells::rate(static_cast<double>(k), hours, 1.0, "1/h")});
  }
  return table;
}

DataTable by_hour(const AlarmData& data) {
  DataTable table;
  table.name = "by_hour";
  table.title = "Alarms by hour of day (" + data.zone + ")";
  table.columns = {integer_column("hour", "Hour of day in the zone of the report"),
                   {"observed", "h", "Robot hours observed"},
                   integer_column("raises", "Alarms raised while observed"),
                   {"per_hour", "1/h", "Raises per robot hour", true}};
  LocalTime local(data.zone);
  std::array<std::int64_t, 24> counts{};
  for (const Raise& raise : data.scopes.front().raises) {
    ++counts[local.hour(raise.mid_us())];
  }
  for (std::size_t h = 0; h < 24; ++h) {
    double hours = 0.0;
    for (const RobotAlarms& robot : data.robots) {
      hours += robot.exposure.hours[h] / 3'600.0;
    }
    table.rows.push_back({static_cast<std::int64_t>(h), hours, counts[h],
                          cells::rate(static_cast<double>(counts[h]), hours, 1.0, "1/h")});
  }
  return table;
}

DataTable ten_minutes(const AlarmData& data) {
  DataTable table;
  table.name = "ten_minutes";
  table.title = "How many 10-minute bins had how many alarms";
  table.columns = {{"robot", "", "Robot; all = as one operator sees them"},
                   integer_column("raises", "Raises in 10 minutes"),
                   integer_column("bins", "Bins with so many")};
  for (const AlarmScope& scope : data.scopes) {
    std::map<std::int64_t, std::int64_t> histogram;
    for (const std::int64_t k : bin_counts(scope)) {
      ++histogram[k];
    }
    for (const auto& [k, bins] : histogram) {
      table.rows.push_back({name_of(scope), k, bins});
    }
  }
  return table;
}

/// Raises per local day, one curve per robot; days without observation break the line.
void add_series(const AlarmData& data, Section& section) {
  LocalTime local(data.zone);
  for (std::size_t r = 0; r < data.robots.size(); ++r) {
    const RobotAlarms& robot = data.robots[r];
    if (robot.exposure.days.empty()) {
      continue;
    }
    std::map<std::int64_t, double> counts;
    for (const Raise& raise : raises_of(robot.intervals(), r)) {
      counts[local.day(raise.mid_us())] += 1.0;
    }
    Series series;
    series.name = "per_day";
    series.title = "Alarms raised per day";
    series.unit = "1/d";
    series.robot = robot.name;
    const std::int64_t last = robot.exposure.days.rbegin()->first;
    for (std::int64_t day = robot.exposure.days.begin()->first; day <= last; ++day) {
      series.t_us.push_back(local.day_start_us(day));
      series.value.push_back(robot.exposure.days.contains(day) ? counts[day] : std::nan(""));
    }
    section.series.push_back(std::move(series));
  }
}

}  // namespace

void add_alarm_rate_tables(const AlarmData& data, Section& section) {
  section.tables.push_back(summary(data));
  section.tables.push_back(by_level(data));
  section.tables.push_back(by_hour(data));
  section.tables.push_back(ten_minutes(data));
  add_series(data, section);
}

}  // namespace tacho
