#pragma once
// A log of two simulated robots, and statements run over it.

#include <map>
#include <string>
#include <vector>

#include "samples/simulator/write.hpp"
#include "schema/log.hpp"
#include "schema/store/sql/sql_session.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/temp_dir.hpp"

namespace tacho::test {

using store::sql::SqlSession;
using store::sql::SqlValue;
using store::sql::StatementError;

using SqlRow = std::vector<SqlValue>;

inline constexpr Micros kT0 = 1'767'225'600'000'000;  // 2026-01-01T00:00:00Z

/// 20 minutes of two robots that get blocked, charge and raise alarms, all sources, with a gap; written once per
/// program.
inline const std::filesystem::path& sql_log() {
  static const TempDir dir;
  static const std::filesystem::path log = [] {
    sim::WriteOptions options;
    options.duration_us = 1'200'000'000;
    options.status_period_us = 2'000'000;
    options.io_period_us = 5'000'000;
    options.registers_period_us = 500'000;
    options.inputs_period_us = 1'000'000;
    Gap gap;
    gap.robot = 1;
    gap.source = Source::inputs;
    gap.t_from_us = options.t0_us + 500'000'000;
    gap.t_to_us = options.t0_us + 560'000'000;
    gap.cause = Cause::timeout;
    options.gaps = {gap};
    sim::Scenario one = sim::busy_day(1);
    one.name = "amb-01";
    sim::Scenario two = sim::busy_day(2);
    two.name = "amb-02";
    sim::write_log({one, two}, options, dir / "log");
    return dir / "log";
  }();
  return log;
}

inline std::unique_ptr<RowSource> open_sql_log() {
  const std::vector<std::filesystem::path> paths{sql_log()};
  return open_log(paths);
}

inline std::vector<SqlRow> rows_of(SqlSession& session, const std::string& sql) {
  std::vector<SqlRow> rows;
  INFO(sql);
  session.run(
      sql, [](const std::vector<std::string>&) {},
      [&](std::span<const SqlValue> row) { rows.emplace_back(row.begin(), row.end()); });
  return rows;
}

inline std::vector<std::string> columns_of(SqlSession& session, const std::string& sql) {
  std::vector<std::string> out;
  session.run(
      sql, [&](const std::vector<std::string>& names) { out = names; }, [](std::span<const SqlValue>) {});
  return out;
}

inline std::string as_text(const SqlValue& value) {
  if (const auto* n = std::get_if<std::int64_t>(&value)) {
    return std::to_string(*n);
  }
  if (const auto* d = std::get_if<double>(&value)) {
    char text[40];
    std::snprintf(text, sizeof text, "%.17g", *d);
    return text;
  }
  if (const auto* t = std::get_if<std::string>(&value)) {
    return "'" + *t + "'";
  }
  return std::holds_alternative<std::monostate>(value) ? "NULL" : "blob";
}

inline std::string as_text(const std::vector<SqlRow>& rows) {
  std::string out;
  for (const SqlRow& row : rows) {
    for (const SqlValue& value : row) {
      out += as_text(value) + "|";
    }
    out += "\n";
  }
  return out;
}

inline std::int64_t integer(SqlSession& session, const std::string& sql) {
  const std::vector<SqlRow> rows = rows_of(session, sql);
  REQUIRE(rows.size() == 1);
  return std::get<std::int64_t>(rows[0][0]);
}

}  // namespace tacho::test
