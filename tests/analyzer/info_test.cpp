#include "analyzer/commands/info.hpp"

#include "tests/support/catch.hpp"
#include "tests/support/memory_log.hpp"

using namespace tacho;
using namespace tacho::test;

namespace {

/// 95 of 100 planned polls are stored.
MemoryLog mostly_recorded() {
  MemoryLog log;
  const RobotId robot = log.add_robot("a");
  for (int t = 0; t < 95; ++t) {
    MemoryLog::set(log.row(robot, Source::status, t), "x", 1.0);
  }
  Gap gap;
  gap.robot = robot;
  gap.source = Source::status;
  gap.seq_from = 95;
  gap.seq_count = 5;
  gap.t_from_us = MemoryLog::micros(95.0);
  gap.t_to_us = MemoryLog::micros(100.0);
  gap.cause = Cause::timeout;
  log.gap(gap);
  return log;
}

Finding stored_share(const Settings& settings) {
  MemoryLog log = mostly_recorded();
  const Section section = commands::info(log, log.robots(), nullptr, settings);
  REQUIRE(section.findings.at(0).id == "DATA-01");
  return section.findings[0];
}

}  // namespace

TEST_CASE("95 % of the planned polls are a warning unless the site has said otherwise") {
  const Finding usual = stored_share({});
  CHECK(*usual.value.value == Approx(95.0));
  CHECK(usual.verdict == Verdict::warn);
  CHECK(usual.threshold == "PASS >= 99 %, FAIL < 90 %");
  CHECK(usual.threshold_source == "default");

  Settings wireless;
  wireless.set("info.stored_pass", 0.95, "site.toml:2");
  CHECK(stored_share(wireless).verdict == Verdict::pass);
  CHECK(stored_share(wireless).threshold == "PASS >= 95 %, FAIL < 90 %");
  CHECK(stored_share(wireless).threshold_source == "site.toml:2, default");

  Settings wired;
  wired.set("a/info.stored_fail", 0.97, "site.toml:4");
  CHECK(stored_share(wired).verdict == Verdict::fail);
}
