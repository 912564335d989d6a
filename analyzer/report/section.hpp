#pragma once
// A result, as plain data. Analyses make Sections, exporters (terminal table, CSV, JSON, PNG, ...) render any Section.

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "schema/sample.hpp"

namespace tacho {

/// A number with its unit and, where the method gives one, its interval. Without a value: `reason` says why not.
struct Quantity {
  std::optional<double> value;
  std::string unit;          ///< "m", "1", "%", "1/h"; "" for a count
  std::optional<double> lo;  ///< 95 % unless the column says otherwise
  std::optional<double> hi;
  std::optional<std::int64_t> n;   ///< observations behind it
  std::optional<double> exposure;  ///< hours, km or passes behind a rate
  std::string reason;
};

struct Time {
  Micros us = 0;
};
/// No value, and why. Printed as an empty CSV cell, JSON null + reason, "-" in a terminal table.
struct Missing {
  std::string reason;
};

using Value = std::variant<Missing, bool, std::int64_t, double, std::string, Time, Quantity>;

/// What the cells of a column hold. A file's columns and their types follow this, never the rows it happens to have.
enum class ColumnType : std::uint8_t {
  plain,     ///< a number when the column has a unit or an interval, else text
  integer,   ///< a count or a number of something
  flag,      ///< true or false
  number,    ///< without a unit
  exact,     ///< likewise, with all its digits also where people read it
  own_units  ///< Quantities that bring a unit each: CSV has another column name_unit
};

struct ColumnSpec {
  std::string name;  ///< snake_case with the unit where the cell does not carry it: "duration_s"
  std::string unit;
  std::string description;
  /// Quantity columns print as name, name_lo, name_hi in CSV when true.
  bool interval = false;
  /// Time columns print as name_utc, name_unix_ms in CSV, also where no row has a time: say so for every column that
  /// can hold one.
  bool time = false;
  ColumnType type = ColumnType::plain;
};

inline ColumnSpec integer_column(std::string name, std::string description) {
  return {std::move(name), "", std::move(description), false, false, ColumnType::integer};
}
inline ColumnSpec flag_column(std::string name, std::string description) {
  return {std::move(name), "", std::move(description), false, false, ColumnType::flag};
}
inline ColumnSpec number_column(std::string name, std::string description) {
  return {std::move(name), "", std::move(description), false, false, ColumnType::number};
}

struct DataTable {
  std::string name;  ///< file name stem: "episodes"
  std::string title;
  std::vector<ColumnSpec> columns;
  std::vector<std::vector<Value>> rows;
  bool detail = false;  ///< long lists: in files, not on a terminal unless asked for
};

/// One curve. NaN breaks the line (gap).
struct Series {
  std::string name;
  std::string title;
  std::string unit;
  std::string robot;
  std::vector<Micros> t_us;
  std::vector<double> value;
};

/// A map in metres. Cell (i, j) covers [(i0+i) c, (i0+i+1) c) x [(j0+j) c, (j0+j+1) c). NaN = not visited.
struct GridLayer {
  std::string name;  ///< "lost_time_s", "episodes_laser"
  std::string title;
  std::string unit;
  std::vector<double> value;  ///< row j, column i: value[j * width + i]
};
struct Grid {
  std::string name;  ///< file name stem
  std::string title;
  std::string map;  ///< map name and md5
  double cell_m = 0.25;
  std::int64_t i0 = 0;
  std::int64_t j0 = 0;
  std::size_t width = 0;
  std::size_t height = 0;
  std::vector<GridLayer> layers;
  std::vector<std::string> pictures;  ///< layers drawn as PNG, the first is the default picture
};

enum class Verdict : std::uint8_t { pass, warn, fail, unknown, not_applicable };
std::string_view verdict_name(Verdict verdict);  ///< "PASS" ...

/// A stretch of the log that shows it; leads back to rows.
struct Evidence {
  Micros from_us = 0;
  Micros to_us = 0;
  std::string source;
  std::string note;
};

struct Finding {
  std::string id;     ///< stable: "ODO-02"
  std::string robot;  ///< empty = the whole log
  std::string title;
  Verdict verdict = Verdict::unknown;
  int severity = 0;  ///< 0..10
  Quantity value;
  std::string threshold;         ///< in words with numbers: "PASS < 1 %, FAIL > 3 %"
  std::string threshold_source;  ///< "default" or "config.toml"
  std::vector<Evidence> evidence;
  std::string advice;  ///< what to do; for UNKNOWN: what is missing and how to get it
};

/// FAIL, WARN, UNKNOWN, PASS, NA; within one verdict the more severe first, else in the given order.
std::vector<Finding> worst_first(std::vector<Finding> findings);

struct Section {
  std::string name;  ///< "odometry"
  std::string title;
  std::string question;            ///< the user's question it answers
  std::vector<std::string> notes;  ///< definitions, sources used, limits of this log
  std::vector<Finding> findings;
  std::vector<DataTable> tables;
  std::vector<Series> series;
  std::vector<Grid> grids;
};

}  // namespace tacho
