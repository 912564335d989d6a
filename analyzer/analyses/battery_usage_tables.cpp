// How the battery is used: profile, habits, histograms.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "analyzer/analyses/battery_tables.hpp"

namespace tacho::battery {
namespace {

/// Rows of (robot, measure, value, remark).
class MeasureTable {
 public:
  MeasureTable(std::string name, std::string title)
      : table_(make_table(std::move(name), std::move(title),
                          {kRobot,
                           {"measure", "", "What", false},
                           {"value", "", "With its unit", true, false, ColumnType::own_units},
                           {"remark", "", "How it is meant", false}})) {}
  void add(const RobotFold& fold, std::string measure, Quantity value, std::string remark = {}) {
    table_.rows.push_back({fold.robot.name, std::move(measure), std::move(value), std::move(remark)});
  }
  DataTable take() { return std::move(table_); }

 private:
  DataTable table_;
};

void current_rows(MeasureTable& t, const RobotFold& fold) {
  if (!fold.has_current()) {
    t.add(fold, "current", unknown(missing(fold, Item::current), "A"));
    return;
  }
  const std::optional<double> nominal = fold.config.nominal_capacity_ah;
  for (const bool charging : {false, true}) {
    const std::string what = charging ? "charge" : "discharge";
    const TimeHistogram& h = fold.usage.current.at(charging ? fold.sign() : -fold.sign());
    for (const double share : {0.5, 0.95, 0.99}) {
      const double amperes = h.quantile(share);
      const std::string rank = fmt::format("{:.0f} % of the time below", share * 100);
      const Quantity none = unknown("no " + what + " seen", "A");
      t.add(fold, what + " current", std::isnan(amperes) ? none : known(amperes, "A"), rank);
      if (nominal) {
        t.add(fold, what + " C-rate", std::isnan(amperes) ? none : known(amperes / *nominal, "1/h"), rank);
      }
    }
    if (!nominal) {
      t.add(fold, what + " C-rate", unknown(kNominalMissing, "1/h"));
    }
  }
  t.add(fold, "time charging", known(fold.use.seconds(fold.sign() > 0 ? Use::positive : Use::negative) / 3600, "h"));
  t.add(fold, "time discharging", known(fold.use.seconds(fold.sign() > 0 ? Use::negative : Use::positive) / 3600, "h"));
  t.add(fold, "time at rest", known(fold.use.seconds(Use::rest) / 3600, "h"),
        fmt::format("current below {:.2f} A", fold.threshold_a()));
  const double noise = fold.noise.sigma_a();
  t.add(fold, "noise of the current",
        std::isnan(noise) ? unknown("needs 64 steps at standstill", "A") : known(noise, "A"), "one standard deviation");
}

void usage_table(Section& section, const Robots& robots) {
  MeasureTable t("usage", "Usage profile");
  for (const std::unique_ptr<RobotFold>& fold : robots) {
    const Usage& u = fold->usage;
    if (!fold->has_soc()) {
      t.add(*fold, "state of charge", unknown(missing(*fold, Item::level), "%"));
    } else {
      const double half = fold->packs.back()->cycles.quantum * 50;
      t.add(*fold, "lowest SoC", within(u.soc_min * 100, u.soc_min * 100 - half, u.soc_min * 100 + half, "%"));
      t.add(*fold, "highest SoC", within(u.soc_max * 100, u.soc_max * 100 - half, u.soc_max * 100 + half, "%"));
      const auto share = [&](double seconds) {
        return u.soc_s > 0 ? known(seconds / u.soc_s * 100, "%") : unknown("one reading is no time", "%");
      };
      t.add(*fold, "time above 90 % SoC", share(u.above_90_s), "of the observed time");
      t.add(*fold, "time below 20 % SoC", share(u.below_20_s), "of the observed time");
      t.add(*fold, "time below 10 % SoC", share(u.below_10_s), "of the observed time");
      const double mean = fold->packs.back()->cycles.mean_soc;
      t.add(*fold, "mean SoC of cycles", std::isnan(mean) ? unknown("no cycle seen", "%") : known(mean * 100, "%"),
            "weighted by their charge");
    }
    current_rows(t, *fold);
  }
  section.tables.push_back(t.take());
}

void habits_table(Section& section, const Robots& robots) {
  MeasureTable t("habits", "Habits that wear a battery");
  for (const std::unique_ptr<RobotFold>& fold : robots) {
    if (!fold->has_soc()) {
      t.add(*fold, "all", unknown(missing(*fold, Item::level)));
      continue;
    }
    const Usage& u = fold->usage;
    const Config& c = fold->config;
    t.add(*fold, "deepest discharge", known(u.soc_min * 100, "%"),
          fmt::format("lowest SoC, below {:.0f} % for {:.1f} h", c.deep_soc * 100, u.deep.seconds() / 3600));
    const double days = u.longest_not_full_s / 86'400;
    t.add(*fold, "longest time without a full charge", known(days, "d"),
          days > c.not_full_days
              ? fmt::format("too long: charge to {:.0f} % at least every {:.0f} days so that the battery can balance "
                            "its cells and anchor its SoC",
                            c.full_soc * 100, c.not_full_days)
              : fmt::format("limit {:.0f} d, full is {:.0f} %", c.not_full_days, c.full_soc * 100));
    const bool judged = fold->reader.stats(Item::standing).given > 0 && fold->reader.stats(Item::charging).given > 0;
    t.add(*fold, "missed charging",
          judged ? known(u.missed_charge.seconds() / 3600, "h") : unknown("needs is_stop and charging", "h"),
          fmt::format("{} times idle for more than {:.0f} min below {:.0f} % without charging", u.missed_charge.count(),
                      c.missed_charge_min, c.missed_charge_soc * 100));
  }
  section.tables.push_back(t.take());
}

void histograms(Section& section, const Robots& robots) {
  DataTable depth = make_table("cycle_depth", "Cycles by depth",
                               {kRobot,
                                {"depth_from", "%", "Deeper than", false},
                                {"depth_to", "%", "Up to", false},
                                {"cycles", "1", "Rainflow counts, half cycles as 0.5", false},
                                {"efc", "1", "Charge they moved, in full cycles", false}});
  DataTable temp = make_table(
      "temperature", "Time by battery temperature",
      {kRobot, {"from_c", "degC", "From", false}, {"to_c", "degC", "To", false}, {"hours", "h", "Time", false}});
  for (const std::unique_ptr<RobotFold>& fold : robots) {
    std::array<double, 10> count{}, efc{};
    for (const std::unique_ptr<Pack>& pack : fold->packs) {
      for (const RainflowCycle& c : pack->cycles.cycles) {
        const auto bin = static_cast<std::size_t>(std::clamp(std::ceil(c.range * 10 - 1e-9) - 1, 0.0, 9.0));
        count[bin] += c.count;
        efc[bin] += c.count * c.range;
      }
    }
    for (std::size_t i = 0; i < count.size() && fold->has_soc(); ++i) {
      const double from = static_cast<double>(i) * 10;
      depth.rows.push_back({fold->robot.name, from, from + 10, count[i], efc[i]});
    }
    const TimeHistogram& h = fold->usage.temperature;
    for (std::size_t i = 0; i < h.seconds().size() && fold->has_temperature(); ++i) {
      if (h.seconds()[i] > 0) {
        temp.rows.push_back({fold->robot.name, h.edge(i), h.edge(i + 1), h.seconds()[i] / 3600});
      }
    }
  }
  section.tables.push_back(std::move(depth));
  section.tables.push_back(std::move(temp));
}

}  // namespace

void add_usage_tables(Section& section, const Robots& robots) {
  usage_table(section, robots);
  habits_table(section, robots);
  histograms(section, robots);
}

}  // namespace tacho::battery
