// Logs written by simulated robots, read back through the store and the decoders, against the truth of the simulation.

#include <algorithm>
#include <array>

#include "samples/simulator/write.hpp"
#include "schema/log.hpp"
#include "tests/analyzer/odometry_support.hpp"
#include "tests/support/temp_dir.hpp"

using namespace tacho;
using namespace tacho::test;

namespace {

constexpr Micros kHour = 3'600'000'000;

struct Simulated {
  sim::Truth truth;
  Section section;
};

Simulated simulate(const sim::Scenario& scenario, sim::WriteOptions options) {
  TempDir dir;
  const std::filesystem::path folder = dir / "log";
  const std::vector<sim::Truth> truth = sim::write_log({scenario}, options, folder);
  const std::array<std::filesystem::path, 1> logs{folder};
  const auto log = open_log(logs);
  return {truth.front(), run_odometry(*log)};
}

}  // namespace

TEST_CASE("a simulated day at 1 Hz: both scales to 0.2 % with the truth inside, and nothing else to complain about") {
  sim::Scenario scenario = sim::busy_day(3);
  scenario.odo_scale = 0.996;
  sim::WriteOptions options;
  options.duration_us = 24 * kHour;
  const Simulated s = simulate(scenario, options);
  const Quantity s_o = quantity(s.section, "scales", "s_o");
  const Quantity g = quantity(s.section, "scales", "g");
  CHECK(half_width(s_o) <= 0.002);
  CHECK(half_width(g) <= 0.002);
  CHECK(holds(s_o, 1.0 / s.truth.odo_scale));
  CHECK(holds(g, s.truth.odo_scale / s.truth.twist_scale));
  CHECK(number(s.section, "counter", "counted_m") == Approx(s.truth.counter_m).margin(1.5));
  for (const char* id : {"ODO-01", "ODO-02", "ODO-03", "ODO-07", "LOC-02"}) {
    INFO(id);
    CHECK(finding(s.section, id).verdict == Verdict::pass);
  }
}

TEST_CASE("a simulated robot read by both protocols agrees with itself") {
  sim::WriteOptions options;
  options.duration_us = kHour;
  options.status_period_us = 500'000;
  options.registers_period_us = 500'000;
  options.inputs_period_us = 500'000;
  const Simulated s = simulate(sim::busy_day(4), options);
  CHECK(finding(s.section, "DATA-08").verdict == Verdict::pass);
  CHECK(text(s.section, "counter", "kind", 1) == "float32");
}

TEST_CASE("every injected localisation jump is found with its vector, and slip is not taken for one") {
  sim::Scenario scenario;
  scenario.seed = 5;
  scenario.slips_per_km = 3;
  scenario.slip_m = 0.4;
  scenario.jumps_per_hour = 4;
  sim::WriteOptions options;
  options.duration_us = 3 * kHour;
  options.status_period_us = 500'000;
  const Simulated s = simulate(scenario, options);
  const DataTable& jumps = table(s.section, "jumps");
  REQUIRE(s.truth.jumps.size() > 5);
  REQUIRE_FALSE(s.truth.slips.empty());
  std::size_t found = 0;
  for (const sim::TrueJump& jump : s.truth.jumps) {
    for (std::size_t row = 0; row < jumps.rows.size(); ++row) {
      const Micros from = std::get<Time>(cell(jumps, "from", row)).us;
      const Micros to = std::get<Time>(cell(jumps, "to", row)).us;
      if (jump.t_us >= from - 5'000 && jump.t_us <= to + 5'000) {
        ++found;
        CHECK(std::get<double>(cell(jumps, "dx_m", row)) == Approx(jump.dx_m).margin(0.15));
        CHECK(std::get<double>(cell(jumps, "dy_m", row)) == Approx(jump.dy_m).margin(0.15));
        CHECK(std::get<std::string>(cell(jumps, "cause", row)) == "unexplained");
      }
    }
  }
  CHECK(found == s.truth.jumps.size());
  CHECK(jumps.rows.size() <= found + 1);
  CHECK(finding(s.section, "LOC-02").verdict == Verdict::fail);
}

TEST_CASE("a simulated log at 0.1 Hz decides nothing about path, drift and jumps") {
  sim::WriteOptions options;
  options.duration_us = 24 * kHour;
  options.status_period_us = 10'000'000;
  const Simulated s = simulate(sim::busy_day(1), options);
  for (const char* id : {"ODO-02", "ODO-03", "ODO-07", "LOC-02"}) {
    INFO(id);
    CHECK(finding(s.section, id).verdict == Verdict::unknown);
    CHECK(finding(s.section, id).value.reason.find("period 10 s") == 0);
  }
  CHECK(finding(s.section, "ODO-01").verdict == Verdict::pass);
}
