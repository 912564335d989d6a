#include "analyzer/analyses/battery_tables.hpp"
#include "analyzer/math/bootstrap.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace tacho::battery {
namespace {

Quantity by_charge(const RobotFold& fold, const Pack& pack) {
  const std::optional<double> nominal = fold.config.nominal_capacity_ah;
  if (!fold.has_current()) {
    return unknown(missing(fold, Item::current), "1");
  }
  if (!nominal) {
    return unknown(kNominalMissing, "1");
  }
  const double offset = fold.config.current_offset_a;
  const double sum = pack.flow.total(1).ah.value() + pack.flow.total(-1).ah.value();
  const double sigma = std::hypot(pack.flow.sigma_ah(1, offset), pack.flow.sigma_ah(-1, offset));
  return within(sum / (2 * *nominal), (sum - kZ95 * sigma) / (2 * *nominal), (sum + kZ95 * sigma) / (2 * *nominal),
                "1");
}

void efc_table(Section& section, const Robots& robots) {
  DataTable t = make_table(
      "equivalent_full_cycles", "Equivalent full cycles",
      {kRobot,
       kPack,
       {"from", "", "First reading", false, true},
       {"to", "", "Last reading", false, true},
       {"efc", "1", "By SoC with what gaps hid; limits for rounding, hysteresis, polling and gaps", true},
       {"efc_by_charge", "1", "(discharged + charged) / (2 nominal capacity), observed time only", true},
       {"efc_by_soc", "1", "Half the variation of SoC after hysteresis, gaps bridged by their change of SoC", false},
       {"efc_by_rainflow", "1", "Sum of range times count of the same turning points", false},
       {"efc_bridged", "1", "Part of efc_by_soc that lies in gaps", false},
       {"efc_hidden", "1", "Estimate of cycling inside gaps, in efc but not in efc_by_soc", false},
       {"observed_h", "h", "Time with SoC", false},
       {"bridged_h", "h", "Gaps bridged", false},
       {"left_out_h", "h", "Gaps too long to bridge", false},
       {"soc_quantum", "%", "Resolution of SoC", false},
       {"soc_sigma", "%", "Uncertainty of one SoC reading", false},
       {"hysteresis", "%", "Smaller turns are not counted", false},
       {"apparent_capacity", "Ah", "Ah per 100 % of the robot's SoC: follows its own idea of the capacity", false},
       {"apparent_share", "1", "The same over the nominal capacity: a cross-check, no state of health", false}});
  each_pack(robots, [&](const RobotFold& fold, const Pack& pack, std::int64_t number) {
    const Cycles& c = pack.cycles;
    const bool soc = fold.has_soc();
    const std::string why = missing(fold, Item::level);
    const auto value = [&](double v) { return soc ? Value{v} : Value{Missing{why}}; };
    const double capacity = soc ? apparent_capacity_ah(pack) : kNone;
    const std::string no_capacity = "needs SoC and current over at least one full cycle";
    const std::optional<double> nominal = fold.config.nominal_capacity_ah;
    t.rows.push_back({fold.robot.name, number, Time{pack.from_us}, Time{pack.to_us},
                      soc ? within(c.total(), c.lo, c.hi, "1") : unknown(why, "1"), by_charge(fold, pack),
                      value(c.by_soc), value(c.by_rainflow), value(c.bridged), value(c.hidden), value(c.observed_h),
                      value(c.gap_h), value(c.left_out_h), value(c.quantum * 100), value(c.sigma_soc * 100),
                      value(c.hysteresis * 100), cell(capacity, no_capacity),
                      nominal ? cell(capacity / *nominal, no_capacity) : Value{Missing{kNominalMissing}}});
  });
  section.tables.push_back(std::move(t));
}

Quantity efficiency(const RobotFold& fold, const Pack& pack) {
  const ClosedPeriod& p = pack.closed.best();
  const double capacity = apparent_capacity_ah(pack);
  const double in = fold.sign() > 0 ? p.positive_ah : p.negative_ah;
  const double out = fold.sign() > 0 ? p.negative_ah : p.positive_ah;
  if (p.efc < 10 || in <= 0 || std::isnan(capacity)) {
    return unknown(fmt::format("needs 10 full cycles without a gap between two equal SoC, longest {:.1f}", p.efc), "1");
  }
  const double hours = static_cast<double>(p.to_us - p.from_us) / 3.6e9;
  const auto sampling = [&](int sign) {
    const Throughput::Total& total = pack.flow.total(sign);
    return std::sqrt(total.thinned_diff2.value()) / std::max(1e-9, total.ah.value());
  };
  const double offset = fold.config.current_offset_a * hours / in;
  const double closure = (p.soc_error + pack.cycles.quantum) * capacity / in;
  const double relative = std::hypot(offset + closure, kZ95 * std::hypot(sampling(1), sampling(-1)));
  const double ratio = out / in;
  return within(ratio, ratio * (1 - relative), ratio * (1 + relative), "1");
}

void throughput_table(Section& section, const Robots& robots) {
  DataTable t = make_table(
      "throughput", "Charge and energy moved",
      {kRobot,
       kPack,
       {"discharged", "Ah", "Trapezoids of the current, never across a gap", true},
       {"charged", "Ah", "The same into the battery", true},
       {"discharged_wh", "Wh", "Voltage times current", false},
       {"charged_wh", "Wh", "The same into the battery", false},
       {"bridged_ah", "Ah", "Change of SoC over gaps times the apparent capacity; in no other column", false},
       {"integrated_h", "h", "Time with current", false},
       {"coulomb_efficiency", "1", "Discharged / charged between two equal SoC, 10 cycles or more", true}});
  each_pack(robots, [&](const RobotFold& fold, const Pack& pack, std::int64_t number) {
    const auto energy = [&](int sign) {
      return pack.flow.energy_known() ? Value{pack.flow.total(sign).wh.value()}
                                      : Value{Missing{"needs voltage and current in one answer"}};
    };
    const double capacity = fold.has_soc() ? apparent_capacity_ah(pack) : kNone;
    t.rows.push_back({fold.robot.name, number, moved_ah(fold, pack, false), moved_ah(fold, pack, true),
                      energy(-fold.sign()), energy(fold.sign()),
                      cell(2 * pack.cycles.bridged * capacity, "needs SoC and current"), pack.flow.seconds() / 3600,
                      efficiency(fold, pack)});
  });
  section.tables.push_back(std::move(t));
}

void trend_table(Section& section, const Robots& robots) {
  DataTable t = make_table("trends", "Trends of daily values",
                           {kRobot,
                            kPack,
                            {"quantity", "", "Of each day", false},
                            integer_column("days", "Days that count"),
                            number_column("median", "Of the days"),
                            {"slope_30d", "", "Change per 30 days (Sen), 95 % limits widened for autocorrelation", true,
                             false, ColumnType::own_units},
                            {"verdict", "", "rising or falling when p < 0.05", false},
                            {"p", "1", "Mann-Kendall, variance times f", false},
                            {"f", "1", "Variance factor from the autocorrelation", false},
                            {"p_plain", "1", "Mann-Kendall without correction", false},
                            {"p_hamed_rao", "1", "Hamed and Rao 1998", false},
                            {"remark", "", "", false}});
  each_pack(robots, [&](const RobotFold& fold, const Pack& pack, std::int64_t number) {
    for (const Daily& daily :
         daily_series(pack.days.all(), pack.path.days(), pack.cycles.rung, fold.config.day_coverage)) {
      std::size_t counted = 0;
      const auto least = static_cast<std::size_t>(std::max(5.0, fold.config.trend_days));
      const std::optional<Trend> trend = daily_trend(daily, least, counted);
      const std::string why =
          fmt::format("needs {} days observed for {:.0f} %, has {}", least, fold.config.day_coverage * 100, counted);
      std::vector<Value> row{fold.robot.name, number, std::string(daily.name), static_cast<std::int64_t>(counted)};
      if (!trend) {
        row.insert(row.end(), {Missing{why}, unknown(why, std::string(daily.unit)), std::string("UNKNOWN"),
                               Missing{why}, Missing{why}, Missing{why}, Missing{why}, daily.remark});
      } else {
        std::vector<double> values;
        std::copy_if(daily.value.begin(), daily.value.end(), std::back_inserter(values),
                     [](double v) { return !std::isnan(v); });
        std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
        const bool real = trend->p < 0.05;
        row.insert(row.end(),
                   {values[values.size() / 2],
                    within(trend->line.slope * 30, trend->line.lo * 30, trend->line.hi * 30, std::string(daily.unit)),
                    std::string(!real               ? "no trend"
                                : trend->test.s > 0 ? "rising"
                                                    : "falling"),
                    trend->p, trend->factor, trend->p_plain,
                    trend->p_hamed_rao ? Value{*trend->p_hamed_rao} : Value{Missing{"its variance is not positive"}},
                    daily.remark});
      }
      t.rows.push_back(std::move(row));
    }
  });
  section.tables.push_back(std::move(t));
}

Quantity slope_cell(const std::optional<SlopeLine>& line, const std::string& why) {
  return line ? within(line->slope, line->lo, line->hi, "1") : unknown(why, "1");
}

void counter_table(Section& section, const Robots& robots) {
  DataTable t = make_table("cycle_counter", "The battery's own cycle counter",
                           {kRobot,
                            kPack,
                            {"class", "", "What it counts", false},
                            number_column("first", ""),
                            number_column("last", ""),
                            integer_column("steps", ""),
                            {"efc", "1", "Our full cycles meanwhile", false},
                            {"efc_per_count", "1", "Slope over its steps; 1.0, 0.9 and 0.8 are normal", true},
                            {"sessions_per_count", "1", "Charge sessions per count", true}});
  each_pack(robots, [&](const RobotFold& fold, const Pack& pack, std::int64_t number) {
    const CounterResult c = counter_result(fold, pack);
    const bool given = c.kind != CounterClass::not_supplied;
    const std::string why = given ? fmt::format("needs {:.0f} steps, has {}", fold.config.counter_steps, c.steps)
                                  : missing(fold, Item::counter);
    t.rows.push_back({fold.robot.name, number, std::string(counter_class_name(c.kind)),
                      given ? Value{c.first} : Value{Missing{why}}, given ? Value{c.last} : Value{Missing{why}},
                      static_cast<std::int64_t>(c.steps), given ? Value{c.efc} : Value{Missing{why}},
                      slope_cell(c.efc_per_count, why), slope_cell(c.sessions_per_count, why)});
  });
  section.tables.push_back(std::move(t));
}

void fields_table(Section& section, const Robots& robots) {
  DataTable t = make_table("battery_fields", "Battery fields in this log",
                           {kRobot,
                            {"field", "", "", false},
                            {"source", "", "Used here", false},
                            integer_column("answers", "Of that source"),
                            {"given", "%", "With a usable value", false},
                            {"last_given", "", "", false, true},
                            {"remark", "", "", false}});
  for (const std::unique_ptr<RobotFold>& fold : robots) {
    for (const Item item : {Item::level, Item::voltage, Item::current, Item::charging, Item::temp, Item::counter,
                            Item::docked, Item::plugged, Item::max_charge_v, Item::max_charge_a}) {
      const ItemStats& s = fold->reader.stats(item);
      const bool quiet = s.given > 0 && static_cast<double>(fold->reader.last_us() - s.last_us) * 1e-6 > 3600;
      const std::string why = missing(*fold, item);
      t.rows.push_back(
          {fold->robot.name, std::string(item_name(item)),
           s.source ? Value{std::string(source_name(*s.source))} : Value{Missing{why}},
           static_cast<std::int64_t>(s.rows),
           s.rows > 0 ? Value{100 * static_cast<double>(s.given) / static_cast<double>(s.rows)} : Value{Missing{why}},
           s.given > 0 ? Value{Time{s.last_us}} : Value{Missing{why}}, quiet ? "silent: not given any more" : why});
    }
  }
  section.tables.push_back(std::move(t));
}

}  // namespace

void add_tables(Section& section, const Robots& robots) {
  efc_table(section, robots);
  throughput_table(section, robots);
  trend_table(section, robots);
  add_usage_tables(section, robots);
  counter_table(section, robots);
  fields_table(section, robots);
  add_detail_tables(section, robots);
}

void add_series(Section& section, const RobotFold& fold) {
  if (!fold.has_soc()) {
    return;
  }
  section.series.push_back({"soc", "State of charge, lowest and highest of each interval", "1", fold.robot.name,
                            fold.usage.curve.t_us(), fold.usage.curve.value()});
  std::vector<Series> daily(3);
  for (const std::unique_ptr<Pack>& pack : fold.packs) {
    const std::vector<Daily> all =
        daily_series(pack->days.all(), pack->path.days(), pack->cycles.rung, fold.config.day_coverage);
    for (std::size_t i = 0; i < all.size(); ++i) {
      Series& s = daily[i];
      s.name = std::string(all[i].name);
      s.title = "Daily " + std::string(all[i].title);
      s.unit = std::string(all[i].unit);
      s.robot = fold.robot.name;
      for (std::size_t k = 0; k < all[i].day.size(); ++k) {
        s.t_us.push_back(fold.clock.noon_us(all[i].day[k]));
        s.value.push_back(all[i].value[k]);
      }
    }
  }
  for (Series& s : daily) {
    if (std::any_of(s.value.begin(), s.value.end(), [](double v) { return !std::isnan(v); })) {
      section.series.push_back(std::move(s));
    }
  }
}

}  // namespace tacho::battery
