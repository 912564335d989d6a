// Thirty days of simulated robots at 0.1 Hz against their truth. One robot; with TACHO_LONG (tests/run.sh --long) many:
// the simulator, not the analysis, makes them long.

#include <cstdlib>

#include "tests/analyzer/battery_robot.hpp"
#include "tests/support/catch.hpp"

using namespace tacho;
using namespace tacho::test;

namespace {

void check_whole(const SimulatedBattery& robot, const Section& section) {
  const Quantity& efc = quantity(section, "equivalent_full_cycles", "efc");
  const double truth = robot.truth.equivalent_full_cycles_soc;
  INFO("efc " << *efc.lo << " " << *efc.value << " " << *efc.hi << " truth " << truth);
  CHECK(*efc.value == Approx(truth).epsilon(0.01));
  CHECK(holds(efc, truth));
  CHECK(*efc.hi - *efc.lo < 0.01 * truth);
  CHECK(holds(quantity(section, "throughput", "discharged"), robot.truth.discharged_ah));
  CHECK(holds(quantity(section, "throughput", "charged"), robot.truth.charged_ah));
  const DataTable& t = table(section, "equivalent_full_cycles");
  CHECK(std::abs(number(cell(t, 0, "efc_by_soc")) - number(cell(t, 0, "efc_by_rainflow"))) <= 1e-12 * truth);
  CHECK(table(section, "charge_sessions").rows.size() == static_cast<std::size_t>(robot.truth.charge_sessions));
  CHECK(std::get<std::string>(cell(table(section, "cycle_counter"), 0, "class")) == "90 % of a full cycle");
  for (const char* id : {"BAT-03", "BAT-04", "BAT-05", "BAT-06", "BAT-07"}) {
    CHECK(finding(section, id, "amr").verdict == Verdict::pass);
  }
}

void check_gap(const SimulatedBattery& robot) {
  GeneratedLog log = robot.log();
  log.lose(890'000, 926'000);
  const Section section = run_battery(log);
  const Quantity& efc = quantity(section, "equivalent_full_cycles", "efc");
  CHECK(*efc.value == Approx(robot.truth.equivalent_full_cycles_soc).epsilon(0.01));
  CHECK(holds(efc, robot.truth.equivalent_full_cycles_soc));
  // Sessions inside the gap were not observed; those around it are all there.
  const auto seen = static_cast<int>(table(section, "charge_sessions").rows.size());
  CHECK(seen < robot.truth.charge_sessions);
  CHECK(seen >= robot.truth.charge_sessions - 3);
}

void check_registers(const SimulatedBattery& robot) {
  GeneratedLog log = robot.log(Source::registers);
  const Section section = run_battery(log);
  const Quantity& efc = quantity(section, "equivalent_full_cycles", "efc");
  CHECK(*efc.value == Approx(robot.truth.equivalent_full_cycles_soc).epsilon(0.01));
  CHECK(holds(efc, robot.truth.equivalent_full_cycles_soc));
  CHECK(table(section, "charge_sessions").rows.size() == static_cast<std::size_t>(robot.truth.charge_sessions));
  CHECK(finding(section, "BAT-07", "amr").verdict == Verdict::unknown);
}

bool long_run() { return std::getenv("TACHO_LONG") != nullptr; }

}  // namespace

TEST_CASE("thirty simulated days at 0.1 Hz: cycles, charge, sessions, with and without a gap, status or registers") {
  for (std::uint64_t seed = 1; seed <= (long_run() ? 6 : 1); ++seed) {
    const SimulatedBattery robot(sim::busy_day(seed), 30, 10);
    GeneratedLog log = robot.log();
    check_whole(robot, run_battery(log, with_nominal(40)));
    check_gap(robot);
    check_registers(robot);
  }
}

TEST_CASE("simulated batteries that do not fade have no trend most of the time, those that fade have") {
  if (!long_run()) {
    SUCCEED("only with TACHO_LONG; battery_test.cpp has the same question with a faster battery");
    return;
  }
  int alarms = 0;
  for (const std::uint64_t seed : std::vector<std::uint64_t>{11, 12, 13, 14, 15, 16}) {
    for (const double fade : {0.0, 2e-3}) {
      sim::Scenario scenario = sim::busy_day(seed);
      scenario.fade_per_efc = fade;
      const SimulatedBattery robot(scenario, 30, 30);
      GeneratedLog log = robot.log();
      const Section section = run_battery(log);
      const std::string verdict = std::get<std::string>(cell(table(section, "trends"), 0, "verdict"));
      if (fade > 0) {
        CHECK(verdict == "rising");
      } else {
        alarms += verdict == "no trend" ? 0 : 1;
      }
    }
  }
  CHECK(alarms <= 1);
}
