// Long lists: charge sessions, failed charges, days, cycles.

#include "analyzer/analyses/battery_tables.hpp"

namespace tacho::battery {
namespace {

void sessions_table(Section& section, const Robots& robots) {
  DataTable t =
      make_table("charge_sessions", "Charge sessions",
                 {kRobot,
                  {"from", "", "First answer that shows it", false, true},
                  {"to", "", "Last answer that shows it", false, true},
                  {"duration_min", "min", "Between them", false},
                  {"soc_start", "%", "", false},
                  {"soc_end", "%", "", false},
                  {"charged_ah", "Ah", "Gaps not included", false},
                  {"charged_wh", "Wh", "", false},
                  {"peak_a", "A", "Highest current", false},
                  {"cc_min", "min", "Until the current fell below 95 % of its plateau", false},
                  {"cv_min", "min", "After that, at highest voltage", false},
                  {"to_80_min", "min", "From its start to 80 % SoC", false},
                  {"end_reason", "", "full, task, unplugged, alarm, emergency, gap, end of record, not known", false},
                  {"result", "", "charged, failed, interrupted", false},
                  flag_column("whole", "Seen from start to end without a gap"),
                  {"station", "", "", false}},
                 true);
  for (const std::unique_ptr<RobotFold>& fold : robots) {
    const Config& c = fold->config;
    for (const ChargeSession& s : fold->charges().all()) {
      const auto ampere_hours = [&](double v) {
        return s.current_known ? Value{v} : Value{Missing{missing(*fold, Item::current)}};
      };
      const bool failed = s.failed(c.failed_s, c.full_soc);
      t.rows.push_back({fold->robot.name, Time{s.from_us}, Time{s.to_us}, s.seconds() / 60, percent(s.soc_start),
                        percent(s.soc_end), ampere_hours(s.ah),
                        s.energy_known ? Value{s.wh} : Value{Missing{"needs voltage and current"}}, cell(s.peak_a),
                        cell(s.cc_s / 60), cell(s.cv_s / 60), cell(s.minutes_to_80), s.end_reason(c.full_soc),
                        std::string(failed                        ? "failed"
                                    : s.no_current_s > c.failed_s ? "interrupted"
                                                                  : "charged"),
                        s.whole(), s.station});
    }
  }
  section.tables.push_back(std::move(t));
}

void failed_table(Section& section, const Robots& robots) {
  DataTable t = make_table("failed_charges", "Failed charges",
                           {kRobot,
                            {"from", "", "", false, true},
                            {"to", "", "", false, true},
                            {"duration_min", "min", "", false},
                            {"soc", "%", "At its start", false},
                            {"kind", "", "What was there while no current flowed", false},
                            {"station", "", "", false}},
                           true);
  for (const std::unique_ptr<RobotFold>& fold : robots) {
    for (const ChargeSession& s : failed_charges(*fold)) {
      t.rows.push_back({fold->robot.name, Time{s.from_us}, Time{s.to_us}, s.seconds() / 60, percent(s.soc_start),
                        std::string(s.flagged ? "charging flag" : "dock or plug"), s.station});
    }
  }
  section.tables.push_back(std::move(t));
}

void days_table(Section& section, const Robots& robots) {
  DataTable t = make_table("days", "Days",
                           {kRobot,
                            kPack,
                            {"day", "", "In the zone of the report", false},
                            {"observed_h", "h", "", false},
                            {"efc", "1", "By SoC", false},
                            {"discharged_ah", "Ah", "", false},
                            {"charged_ah", "Ah", "", false},
                            {"soc_min", "%", "", false},
                            {"soc_max", "%", "", false},
                            {"depth_of_discharge", "%", "Largest fall of SoC inside the day", false},
                            {"rest_voltage", "V", "Days that count in the trend only", false},
                            {"temp_max_c", "degC", "", false}},
                           true);
  each_pack(robots, [&](const RobotFold& fold, const Pack& pack, std::int64_t number) {
    const std::vector<Daily> series =
        daily_series(pack.days.all(), pack.path.days(), pack.cycles.rung, fold.config.day_coverage);
    std::size_t i = 0;
    for (const auto& [day_number, day] : pack.days.all()) {
      const auto efc = pack.path.days().find(day_number);
      t.rows.push_back({fold.robot.name, number, day_name(day_number), day.observed_s / 3600,
                        efc == pack.path.days().end() ? Value{Missing{"no SoC"}} : Value{efc->second[pack.cycles.rung]},
                        day.ah.at(-fold.sign()), day.ah.at(fold.sign()), percent(day.soc_min), percent(day.soc_max),
                        percent(day.fall), cell(series[2].value[i++]),
                        fold.has_temperature() ? cell(day.temp_max) : Value{Missing{missing(fold, Item::temp)}}});
    }
  });
  section.tables.push_back(std::move(t));
}

void cycles_table(Section& section, const Robots& robots) {
  DataTable t = make_table("cycles", "Rainflow cycles of SoC",
                           {kRobot,
                            kPack,
                            {"from", "", "Earlier turning point", false, true},
                            {"to", "", "Later turning point", false, true},
                            {"range", "%", "", false},
                            {"mean", "%", "", false},
                            {"count", "1", "1 or 0.5", false}},
                           true);
  each_pack(robots, [&](const RobotFold& fold, const Pack& pack, std::int64_t number) {
    for (const RainflowCycle& c : pack.cycles.cycles) {
      t.rows.push_back({fold.robot.name, number, Time{c.from}, Time{c.to}, c.range * 100, c.mean * 100, c.count});
    }
  });
  section.tables.push_back(std::move(t));
}

}  // namespace

void add_detail_tables(Section& section, const Robots& robots) {
  sessions_table(section, robots);
  failed_table(section, robots);
  days_table(section, robots);
  cycles_table(section, robots);
}

}  // namespace tacho::battery
