#pragma once
// Looking into the Section of an odometry run.

#include <string>
#include <string_view>

#include "analyzer/analyses/analyses.hpp"
#include "tests/analyzer/odometry_robot.hpp"
#include "tests/support/catch.hpp"

namespace tacho::test {

inline Section run_odometry(RowSource& log, const Settings& settings = {}) {
  return run_analysis(kOdometry, log, {}, {}, "UTC", settings);
}

inline const Finding& finding(const Section& section, std::string_view id) {
  for (const Finding& f : section.findings) {
    if (f.id == id) {
      return f;
    }
  }
  FAIL("no finding " << id);
  return section.findings.front();
}

inline const DataTable& table(const Section& section, std::string_view name) {
  for (const DataTable& t : section.tables) {
    if (t.name == name) {
      return t;
    }
  }
  FAIL("no table " << name);
  return section.tables.front();
}

inline const Value& cell(const DataTable& t, std::string_view column, std::size_t row = 0) {
  REQUIRE(row < t.rows.size());
  for (std::size_t i = 0; i < t.columns.size(); ++i) {
    if (t.columns[i].name == column) {
      return t.rows[row][i];
    }
  }
  FAIL("no column " << column);
  return t.rows[row][0];
}

inline Quantity quantity(const Section& s, std::string_view name, std::string_view column, std::size_t row = 0) {
  return std::get<Quantity>(cell(table(s, name), column, row));
}
inline double number(const Section& s, std::string_view name, std::string_view column, std::size_t row = 0) {
  const Value& value = cell(table(s, name), column, row);
  const auto* whole = std::get_if<std::int64_t>(&value);
  return whole != nullptr ? static_cast<double>(*whole) : std::get<double>(value);
}
inline std::string text(const Section& s, std::string_view name, std::string_view column, std::size_t row = 0) {
  return std::get<std::string>(cell(table(s, name), column, row));
}

inline double half_width(const Quantity& q) { return 0.5 * (*q.hi - *q.lo); }
inline bool holds(const Quantity& q, double truth) { return q.lo && *q.lo <= truth && truth <= *q.hi; }

/// A log of status answers at 1 Hz unless said otherwise.
inline PaperLog status_log(const PaperRobot& robot, std::function<void(PaperAnswer&)> edit = {},
                           double period_s = 1.0) {
  return PaperLog(robot, {{Source::status, period_s, 0.0, std::move(edit)}});
}

}  // namespace tacho::test
