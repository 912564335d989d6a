#pragma once
// A Section with one of everything that exporters must get right.

#include <cmath>
#include <limits>

#include "analyzer/report/section.hpp"

namespace tacho::test {

inline constexpr Micros kExampleTime = 1'767'225'600'123'456;  // 2026-01-01T00:00:00.123456Z
inline const double kNaN = std::numeric_limits<double>::quiet_NaN();

inline Quantity quantity(double value, const char* unit) {
  Quantity q;
  q.value = value;
  q.unit = unit;
  return q;
}

inline Quantity bounded(double value, double lo, double hi, const char* unit) {
  Quantity q = quantity(value, unit);
  q.lo = lo;
  q.hi = hi;
  q.n = 42;
  q.exposure = 12.5;
  return q;
}

inline Quantity unknown(const char* reason) {
  Quantity q;
  q.reason = reason;
  return q;
}

inline DataTable example_table() {
  DataTable table;
  table.name = "episodes";
  table.title = "Episodes";
  table.columns = {{"start", "", "first answer", false, true},
                   {"robot", "", "robot"},
                   flag_column("loaded", "carried something"),
                   integer_column("polls", "answers"),
                   {"duration_s", "s", "length"},
                   {"rate", "1/h", "per observed hour", true}};
  table.rows = {
      {Time{kExampleTime}, std::string("amb-01"), true, std::int64_t{9'007'199'254'740'993}, 0.1,
       bounded(1.5, 1.25, 1.75, "1/h")},
      {Time{kExampleTime + 1'000'000}, std::string("halle, \"süd\"\n二"), false, std::int64_t{0}, kNaN,
       unknown("no exposure")},
      {Missing{"not started"}, std::string("=cmd()"), Missing{"never told"}, std::int64_t{-3}, -0.25, Missing{}}};
  return table;
}

inline Grid example_grid() {
  Grid grid;
  grid.name = "blocked";
  grid.title = "amb-01";
  grid.map = "hall";
  grid.cell_m = 0.5;
  grid.i0 = -2;
  grid.j0 = 3;
  grid.width = 3;
  grid.height = 2;
  grid.layers = {{"lost_s", "Lost time", "s", {0.0, 10.0, kNaN, 5.0, kNaN, 0.0}},
                 {"rate", "Episodes per pass", "1/pass", {0.0, 1.0, kNaN, 0.5, kNaN, 0.0}},
                 {"opacity", "Weight of the cell's own data", "1", {1.0, 1.0, kNaN, 0.0, kNaN, 0.5}}};
  grid.pictures = {"lost_s", "rate"};
  return grid;
}

inline Finding finding(const char* id, Verdict verdict, int severity, Quantity value) {
  Finding f;
  f.id = id;
  f.robot = "amb-01";
  f.title = "example check";
  f.verdict = verdict;
  f.severity = severity;
  f.value = std::move(value);
  f.threshold = "PASS < 1 %, FAIL > 3 %";
  f.threshold_source = "default";
  f.advice = "calibrate the wheel diameter";
  return f;
}

inline Section example_section() {
  Section section;
  section.name = "example";
  section.title = "Example";
  section.question = "Do exporters tell the truth?";
  section.notes = {"a note"};
  section.findings = {finding("EXA-01", Verdict::pass, 0, bounded(0.5, 0.4, 0.6, "%")),
                      finding("EXA-02", Verdict::unknown, 0, unknown("no answers while driving")),
                      finding("EXA-03", Verdict::fail, 7, bounded(4.0, 3.5, 4.5, "%"))};
  section.findings[2].evidence = {{kExampleTime, kExampleTime + 60'000'000, "status", "+3 % over one minute"}};
  section.tables = {example_table()};
  section.series = {
      {"voltage", "Pack voltage", "V", "amb-01", {kExampleTime, kExampleTime + 1'000'000}, {52.347, kNaN}},
      {"voltage", "Pack voltage", "V", "amb-02", {kExampleTime}, {48.0}}};
  section.grids = {example_grid()};
  return section;
}

}  // namespace tacho::test
