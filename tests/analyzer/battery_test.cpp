// Full cycles, throughput, sessions and days of batteries whose truth is known.

#include <random>

#include "analyzer/analyses/battery_states.hpp"
#include "tests/analyzer/battery_robot.hpp"
#include "tests/support/catch.hpp"

using namespace tacho;
using namespace tacho::test;

TEST_CASE("full cycles by SoC hold the truth, and rainflow counts the same to 1e-12") {
  for (const double quantum : {1e-4, 0.01, 0.02}) {
    for (const double period : {1.0, 10.0, 60.0}) {
      Sawtooth s;
      s.quantum = quantum;
      SawtoothLog saw(s, period < 10 ? 0.5 : period < 60 ? 4 : 12, period);
      const Section section = run_battery(saw.log, with_nominal(40));
      const Quantity& efc = quantity(section, "equivalent_full_cycles", "efc");
      INFO("quantum " << quantum << " period " << period << ": " << *efc.lo << " " << *efc.value << " " << *efc.hi
                      << " truth " << saw.truth->efc);
      CHECK(holds(efc, saw.truth->efc));
      CHECK(*efc.value == Approx(saw.truth->efc).epsilon(quantum < 0.01 ? 0.002 : 2 * quantum));
      const DataTable& t = table(section, "equivalent_full_cycles");
      const double by_soc = number(cell(t, 0, "efc_by_soc"));
      CHECK(std::abs(by_soc - number(cell(t, 0, "efc_by_rainflow"))) <= 1e-12 * by_soc);
      CHECK(number(cell(t, 0, "soc_quantum")) == Approx(quantum * 100));
    }
  }
}

TEST_CASE("full cycles by charge need the nominal capacity") {
  SawtoothLog saw(Sawtooth{}, 3, 10);
  const Section without = run_battery(saw.log);
  const Quantity& unknown = quantity(without, "equivalent_full_cycles", "efc_by_charge");
  CHECK_FALSE(unknown.value);
  CHECK(unknown.reason == "configure battery.nominal_capacity_ah");
  CHECK(measure(without, "usage", "discharge C-rate").reason == "configure battery.nominal_capacity_ah");
  CHECK(measure(without, "usage", "discharge current").value);

  const Section with = run_battery(saw.log, with_nominal(40));
  const double truth = (saw.truth->charged_ah + saw.truth->discharged_ah) / 80;
  CHECK(holds(quantity(with, "equivalent_full_cycles", "efc_by_charge"), truth));
  CHECK(*measure(with, "usage", "discharge C-rate").value == Approx(0.2).margin(0.02));
  CHECK(number(cell(table(with, "equivalent_full_cycles"), 0, "apparent_capacity")) == Approx(40).epsilon(0.01));
}

TEST_CASE("charge moved agrees with the truth within its limits, and no sign of the current matters") {
  for (const double sign : {1.0, -1.0}) {
    Sawtooth s;
    s.sign = sign;
    s.noise_a = 0.05;
    SawtoothLog saw(s, 5, 10);
    const Section section = run_battery(saw.log);
    CHECK(holds(quantity(section, "throughput", "discharged"), saw.truth->discharged_ah));
    CHECK(holds(quantity(section, "throughput", "charged"), saw.truth->charged_ah));
    CHECK(table(section, "charge_sessions").rows.size() == static_cast<std::size_t>(saw.truth->sessions));
    CHECK(has_note(section, sign > 0 ? "positive current is charging" : "negative current is charging"));
    CHECK(finding(section, "BAT-07", "amr").verdict == Verdict::pass);
  }
}

TEST_CASE("a current that crosses zero is cut there") {
  const battery::BySign<double> area = battery::signed_area(2.0, -1.0, 3.0);
  CHECK(area.positive == Approx(2.0));
  CHECK(area.negative == Approx(0.5));
  CHECK(battery::signed_area(1.0, 3.0, 2.0).positive == Approx(4.0));
  CHECK(battery::signed_area(0.0, 0.0, 2.0).negative == 0.0);
}

TEST_CASE("the error of the throughput is offset times time and what every second sample would say") {
  battery::Throughput flow;
  battery::Row row;
  row.gap_limit_s = 50;
  const std::vector<double> amperes{10, 20, 10, 20, 10};
  for (const double a : amperes) {
    row.current_a = a;
    flow.step(row, 0);
    row.t_us += 10'000'000;
  }
  flow.finish();
  const double full = 15.0 * 40 / 3600;
  const double thinned = 10.0 * 40 / 3600;
  CHECK(flow.total(1).ah.value() == Approx(full));
  CHECK(flow.total(1).thinned_ah.value() == Approx(thinned));
  const double offset = 0.05 * 40 / 3600;
  // The day's difference in quadrature is larger than |S - S2| / sqrt 3 here.
  CHECK(flow.sigma_ah(1, 0.05) == Approx(std::hypot(offset, full - thinned)));
  CHECK(flow.total(-1).ah.value() == 0.0);
}

TEST_CASE("any cut of the rows gives the identical section") {
  Sawtooth s;
  s.noise_a = 0.2;
  s.count_share = 0.9;
  SawtoothLog saw(s, 2, 20);
  saw.log.lose(30'000, 40'000);
  saw.log.slice_rows(0);
  const std::string whole = text(run_battery(saw.log, with_nominal(40)));
  for (const std::size_t rows : std::vector<std::size_t>{1, 2, 7, 100, 1'999}) {
    saw.log.slice_rows(rows);
    REQUIRE(text(run_battery(saw.log, with_nominal(40))) == whole);
  }
}

TEST_CASE("a gap is bridged by SoC, never integrated, and its doubt is in the limits") {
  Sawtooth s;
  SawtoothLog saw(s, 10, 10);
  const double whole = *quantity(run_battery(saw.log), "equivalent_full_cycles", "efc").value;
  saw.log.lose(200'000, 236'000);
  const Section section = run_battery(saw.log);
  const DataTable& t = table(section, "equivalent_full_cycles");
  const Quantity& efc = quantity(section, "equivalent_full_cycles", "efc");
  CHECK(holds(efc, saw.truth->efc));
  CHECK(*efc.value == Approx(whole).epsilon(0.01));
  CHECK(*efc.hi - *efc.lo > 0.5);
  CHECK(number(cell(t, 0, "bridged_h")) == Approx(10.0).margin(0.01));
  CHECK(number(cell(t, 0, "observed_h")) == Approx(230.0).margin(0.01));
  CHECK(number(cell(table(section, "throughput"), 0, "integrated_h")) == Approx(230.0).margin(0.01));
  CHECK(number(cell(t, 0, "efc_bridged")) > 0);
  CHECK(number(cell(table(section, "throughput"), 0, "bridged_ah")) ==
        Approx(80 * number(cell(t, 0, "efc_bridged"))).epsilon(0.02));
  const auto& soc = section.series.front();
  CHECK(soc.name == "soc");
  CHECK(std::count_if(soc.value.begin(), soc.value.end(), [](double v) { return std::isnan(v); }) == 1);
}

TEST_CASE("a gap longer than a day is left out and said so") {
  SawtoothLog saw(Sawtooth{}, 10, 10);
  saw.log.lose(200'000, 300'000);
  const DataTable t = table(run_battery(saw.log), "equivalent_full_cycles");
  CHECK(number(cell(t, 0, "left_out_h")) == Approx(27.78).margin(0.01));
  CHECK(number(cell(t, 0, "bridged_h")) == 0.0);
  CHECK(number(cell(t, 0, "efc_by_soc")) == Approx(number(cell(t, 0, "efc_by_rainflow"))));
}

TEST_CASE("noise of SoC is not counted as cycling") {
  auto noisy = [](double sigma) {
    return GeneratedLog(5 * 86'400, 10, [sigma] {
      auto truth = std::make_shared<SawtoothTruth>();
      auto random = std::make_shared<std::mt19937>(3);
      return [battery = SawtoothBattery(Sawtooth{}, truth), random, sigma](Micros t, Sample& s) mutable {
        battery(t, s);
        Cell& level = s.cells[field("battery_level")];
        level.real = std::clamp(level.real + sigma * std::normal_distribution<double>()(*random), 0.0, 1.0);
      };
    });
  };
  GeneratedLog clean = noisy(0.0);
  const double expected = *quantity(run_battery(clean), "equivalent_full_cycles", "efc").value;
  for (const double sigma : {0.001, 0.004}) {
    GeneratedLog log = noisy(sigma);
    const Section section = run_battery(log);
    const Quantity& efc = quantity(section, "equivalent_full_cycles", "efc");
    INFO("sigma " << sigma << ": " << *efc.lo << " " << *efc.value << " " << *efc.hi << " clean " << expected);
    CHECK(*efc.value == Approx(expected).epsilon(0.05));
    CHECK(holds(efc, expected));
  }
}

TEST_CASE("coulomb efficiency is given only for ten cycles between two equal SoC") {
  Sawtooth s;
  s.efficiency = 0.98;
  SawtoothLog longer(s, 8, 10);
  const Section section = run_battery(longer.log);
  const Quantity& ratio = quantity(section, "throughput", "coulomb_efficiency");
  REQUIRE(ratio.value);
  CHECK(holds(ratio, 0.98));
  CHECK(*ratio.value == Approx(0.98).margin(0.01));
  SawtoothLog shorter(s, 2, 10);
  const Quantity none = quantity(run_battery(shorter.log), "throughput", "coulomb_efficiency");
  CHECK_FALSE(none.value);
  CHECK(none.reason.find("needs 10 full cycles") == 0);
}

TEST_CASE("a charge session has its SoC, charge, peak and time to 80 percent") {
  Sawtooth s;
  SawtoothLog saw(s, 1, 10);
  const Section section = run_battery(saw.log);
  const DataTable& t = table(section, "charge_sessions");
  REQUIRE(t.rows.size() == static_cast<std::size_t>(saw.truth->sessions));
  CHECK(number(cell(t, 0, "soc_start")) == Approx(35).margin(0.2));
  CHECK(number(cell(t, 0, "soc_end")) == Approx(95).margin(0.2));
  CHECK(number(cell(t, 0, "charged_ah")) == Approx(24.0).epsilon(0.01));
  CHECK(number(cell(t, 0, "charged_wh")) == Approx(24.0 * 48.6).epsilon(0.01));
  CHECK(number(cell(t, 0, "peak_a")) == Approx(20));
  CHECK(number(cell(t, 0, "duration_min")) == Approx(72).margin(0.5));
  CHECK(number(cell(t, 0, "to_80_min")) == Approx(54).margin(0.5));
  CHECK(number(cell(t, 0, "cc_min")) == Approx(72).margin(0.6));
  CHECK(std::get<std::string>(cell(t, 0, "end_reason")) == "full");
  CHECK(std::get<bool>(cell(t, 0, "whole")));
}

TEST_CASE("days are those of the zone, and their sums are those of the record") {
  SawtoothLog saw(Sawtooth{}, 4, 30);
  for (const std::string zone : {"UTC", "+05:30", "-11:00"}) {
    const Section section = run_battery(saw.log, {}, zone);
    const DataTable& days = table(section, "days");
    CHECK(days.rows.size() == (zone == "UTC" ? 4U : 5U));
    double efc = 0.0, discharged = 0.0, hours = 0.0;
    for (std::size_t i = 0; i < days.rows.size(); ++i) {
      efc += number(cell(days, i, "efc"));
      discharged += number(cell(days, i, "discharged_ah"));
      hours += number(cell(days, i, "observed_h"));
    }
    CHECK(efc == Approx(number(cell(table(section, "equivalent_full_cycles"), 0, "efc_by_soc"))).epsilon(1e-9));
    CHECK(discharged == Approx(*quantity(section, "throughput", "discharged").value).epsilon(1e-9));
    CHECK(hours == Approx(96.0).margin(0.02));
  }
  CHECK(std::get<std::string>(cell(table(run_battery(saw.log, {}, "-11:00"), "days"), 0, "day")) == "2025-12-31");
}

TEST_CASE("the counter's class is what it counts") {
  const auto counted = [](double share) {
    Sawtooth s;
    s.count_share = share;
    s.soc_low = 0.55;  // sessions and cycles differ
    SawtoothLog saw(s, 12, 30);
    return run_battery(saw.log);
  };
  for (const auto& [share, name] : {std::pair{1.0, "full cycles"},
                                    {0.9, "90 % of a full cycle"},
                                    {0.8, "80 % of a full cycle"},
                                    {0.4, "charge sessions"},
                                    {1.5, "another share of a full cycle"}}) {
    const Section section = counted(share);
    INFO("share " << share);
    CHECK(std::get<std::string>(cell(table(section, "cycle_counter"), 0, "class")) == name);
    CHECK(finding(section, "BAT-03", "amr").verdict == (share > 1 ? Verdict::warn : Verdict::pass));
    CHECK(*quantity(section, "cycle_counter", "efc_per_count").value == Approx(share).epsilon(0.03));
  }
}

TEST_CASE("fading capacity shows as rising daily cycles, steady capacity does not") {
  int alarms = 0, found = 0;
  const int rounds = 8;
  for (int round = 0; round < rounds; ++round) {
    Sawtooth s;
    s.load_spread = 0.05;
    s.seed = static_cast<std::uint64_t>(round + 1);
    s.soc_low = 0.6;
    const auto verdict = [&](double fade) {
      s.fade_per_efc = fade;
      SawtoothLog saw(s, 30, 180);
      const Section section = run_battery(saw.log);
      const DataTable& t = table(section, "trends");
      CHECK(std::get<std::string>(cell(t, 0, "quantity")) == "efc_per_day");
      return std::get<std::string>(cell(t, 0, "verdict"));
    };
    alarms += verdict(0.0) != "no trend" ? 1 : 0;
    found += verdict(2e-3) == "rising" ? 1 : 0;
  }
  CHECK(alarms <= 1);
  CHECK(found >= rounds - 1);
}

TEST_CASE("few days have no trend") {
  SawtoothLog saw(Sawtooth{}, 5, 60);
  const DataTable t = table(run_battery(saw.log), "trends");
  for (std::size_t i = 0; i < t.rows.size(); ++i) {
    CHECK(std::get<std::string>(cell(t, i, "verdict")) == "UNKNOWN");
    // This robot never stands with little current: no day has a resting voltage.
    const bool rest = std::get<std::string>(cell(t, i, "quantity")) == "rest_voltage";
    CHECK(std::get<Quantity>(cell(t, i, "slope_30d")).reason ==
          std::string(rest ? "needs 8 days observed for 80 %, has 0" : "needs 8 days observed for 80 %, has 5"));
  }
}

TEST_CASE("two robots stand beside each other in one section") {
  MemoryLog log;
  for (const char* name : {"a", "b"}) {
    const RobotId id = log.add_robot(name);
    for (int i = 0; i < 100; ++i) {
      Sample& row = log.row(id, Source::status, i * 10.0);
      MemoryLog::set(row, "battery_level", 0.9 - 0.001 * i);
      MemoryLog::set(row, "current", -5.0 * id);
    }
  }
  const Section section = run_battery(log);
  const DataTable& t = table(section, "throughput");
  REQUIRE(t.rows.size() == 2);
  CHECK(*quantity(section, "throughput", "discharged", 1).value ==
        Approx(2 * *quantity(section, "throughput", "discharged", 0).value));
  CHECK(finding(section, "BAT-04", "a").verdict == Verdict::pass);
  CHECK(finding(section, "BAT-04", "b").verdict == Verdict::pass);
}
