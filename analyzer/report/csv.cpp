#include "analyzer/report/csv.hpp"

#include <algorithm>
#include <cmath>

#include "analyzer/report/text.hpp"
#include "schema/time.hpp"

namespace tacho::report {
namespace {

std::int64_t unix_ms(Micros t_us) { return t_us >= 0 ? t_us / 1000 : -((-t_us + 999) / 1000); }

/// How the cells of one column are laid out in CSV.
struct Layout {
  bool time = false;
  bool interval = false;
  bool unit = false;  ///< the cells carry units that the column does not
  std::string type = "text";
};

/// From the declaration alone: files of two reports can be put together, whatever happened in their logs.
Layout layout_of(const ColumnSpec& spec) {
  Layout layout{spec.time, spec.interval, spec.type == ColumnType::own_units, "text"};
  switch (spec.type) {
    case ColumnType::plain:
      layout.type = spec.interval || !spec.unit.empty() ? "number" : "text";
      break;
    case ColumnType::integer:
      layout.type = "integer";
      break;
    case ColumnType::flag:
      layout.type = "boolean";
      break;
    case ColumnType::number:
    case ColumnType::exact:
    case ColumnType::own_units:
      layout.type = "number";
      break;
  }
  return layout;
}

std::string time_stem(const std::string& name) {
  const std::string tail = "_utc";
  return name.size() > tail.size() && name.ends_with(tail) ? name.substr(0, name.size() - tail.size()) : name;
}

void add_columns(std::vector<CsvColumn>& out, const ColumnSpec& spec, const Layout& layout) {
  if (layout.time) {
    const std::string stem = time_stem(spec.name);
    out.push_back({stem + "_utc", "", "time", spec.description + " (ISO 8601, UTC)"});
    out.push_back({stem + "_unix_ms", "ms", "integer", spec.description + " (milliseconds since 1970-01-01 UTC)"});
    return;
  }
  out.push_back({spec.name, spec.unit, layout.type, spec.description});
  if (layout.interval) {
    out.push_back({spec.name + "_lo", spec.unit, "number", "lower limit of " + spec.name});
    out.push_back({spec.name + "_hi", spec.unit, "number", "upper limit of " + spec.name});
  }
  if (layout.unit) {
    out.push_back({spec.name + "_unit", "", "text", "unit of " + spec.name});
  }
}

void write_number(CsvWriter& csv, const std::optional<double>& value) {
  if (value) {
    csv.number(*value);
  } else {
    csv.empty();
  }
}

struct CellWriter {
  CsvWriter& csv;
  void operator()(const Missing&) const { csv.empty(); }
  void operator()(bool value) const { csv.flag(value); }
  void operator()(std::int64_t value) const { csv.integer(value); }
  void operator()(double value) const { csv.number(value); }
  void operator()(const std::string& value) const { csv.text(value); }
  void operator()(const Time& value) const { csv.time(value.us); }
  void operator()(const Quantity& value) const { write_number(csv, value.value); }
};

void write_cell(CsvWriter& csv, const Value& value, const Layout& layout) {
  const auto* q = std::get_if<Quantity>(&value);
  if (layout.time && !std::holds_alternative<Time>(value)) {
    csv.empty();
    csv.empty();
    return;
  }
  std::visit(CellWriter{csv}, value);
  if (layout.interval) {
    write_number(csv, q != nullptr ? q->lo : std::nullopt);
    write_number(csv, q != nullptr ? q->hi : std::nullopt);
  }
  if (layout.unit) {
    csv.text(q != nullptr && q->value ? q->unit : "");
  }
}

void write_header(CsvWriter& csv, const std::vector<CsvColumn>& columns) {
  for (const CsvColumn& column : columns) {
    csv.text(column.name);
  }
  csv.end_row();
}

std::vector<CsvColumn> series_columns(const Series& series) {
  return {{"robot", "", "text", "robot"},
          {"t_utc", "", "time", "time (ISO 8601, UTC)"},
          {"t_unix_ms", "ms", "integer", "time (milliseconds since 1970-01-01 UTC)"},
          {"value", series.unit, "number", series.title}};
}

/// Curves of one name (one per robot) share a file.
std::string series_text(const Section& section, const std::string& name) {
  std::string text;
  CsvWriter csv(text);
  for (const Series& series : section.series) {
    if (series.name != name) {
      continue;
    }
    if (text.empty()) {
      write_header(csv, series_columns(series));
    }
    for (std::size_t i = 0; i < series.t_us.size(); ++i) {
      csv.text(series.robot);
      csv.time(series.t_us[i]);
      csv.number(series.value[i]);
      csv.end_row();
    }
  }
  return text;
}

std::vector<CsvColumn> grid_columns(const Grid& grid) {
  std::vector<CsvColumn> columns{{"x_m", "m", "number", "centre of the cell in the map " + grid.map},
                                 {"y_m", "m", "number", "centre of the cell in the map " + grid.map}};
  for (const GridLayer& layer : grid.layers) {
    columns.push_back({layer.name, layer.unit, "number", layer.title});
  }
  return columns;
}

std::string grid_text(const Grid& grid) {
  std::string text;
  CsvWriter csv(text);
  write_header(csv, grid_columns(grid));
  for (std::size_t j = 0; j < grid.height; ++j) {
    for (std::size_t i = 0; i < grid.width; ++i) {
      const std::size_t cell = j * grid.width + i;
      const bool visited = std::any_of(grid.layers.begin(), grid.layers.end(),
                                       [&](const GridLayer& layer) { return std::isfinite(layer.value[cell]); });
      if (!visited) {
        continue;
      }
      csv.number((static_cast<double>(grid.i0) + static_cast<double>(i) + 0.5) * grid.cell_m);
      csv.number((static_cast<double>(grid.j0) + static_cast<double>(j) + 0.5) * grid.cell_m);
      for (const GridLayer& layer : grid.layers) {
        csv.number(layer.value[cell]);
      }
      csv.end_row();
    }
  }
  return text;
}

Value optional_count(const std::optional<std::int64_t>& n) { return n ? Value(*n) : Value(Missing{}); }

}  // namespace

void CsvWriter::separate() {
  if (!first_) {
    out_ += ',';
  }
  first_ = false;
}

void CsvWriter::text(std::string_view value) {
  separate();
  std::string safe;
  if (!value.empty() && std::string_view("=+-@\t\r\0", 7).find(value.front()) != std::string_view::npos) {
    safe = "'" + std::string(value);
    value = safe;
  }
  if (value.find_first_of(",\"\r\n") == std::string_view::npos) {
    out_ += value;
    return;
  }
  out_ += '"';
  for (const char c : value) {
    out_ += c;
    if (c == '"') {
      out_ += c;
    }
  }
  out_ += '"';
}

void CsvWriter::number(double value) {
  separate();
  out_ += exact(value);
}

void CsvWriter::integer(std::int64_t value) {
  separate();
  out_ += exact(value);
}

void CsvWriter::flag(bool value) {
  separate();
  out_ += value ? "true" : "false";
}

void CsvWriter::time(Micros t_us) {
  text(iso_utc(t_us));
  integer(unix_ms(t_us));
}

void CsvWriter::empty() { separate(); }

void CsvWriter::end_row() {
  out_ += "\r\n";
  first_ = true;
}

CsvSchema::CsvSchema() {
  CsvWriter csv(text_);
  for (const char* name : {"file", "column", "unit", "type", "description"}) {
    csv.text(name);
  }
  csv.end_row();
}

void CsvSchema::add(std::string_view file, const std::vector<CsvColumn>& columns) {
  CsvWriter csv(text_);
  for (const CsvColumn& column : columns) {
    csv.text(file);
    csv.text(column.name);
    csv.text(column.unit);
    csv.text(column.type);
    csv.text(column.description);
    csv.end_row();
  }
}

std::vector<CsvColumn> csv_columns(const DataTable& table) {
  std::vector<CsvColumn> columns;
  for (std::size_t i = 0; i < table.columns.size(); ++i) {
    add_columns(columns, table.columns[i], layout_of(table.columns[i]));
  }
  return columns;
}

std::string csv_text(const DataTable& table) {
  std::string text;
  CsvWriter csv(text);
  write_header(csv, csv_columns(table));
  std::vector<Layout> layouts;
  for (std::size_t i = 0; i < table.columns.size(); ++i) {
    layouts.push_back(layout_of(table.columns[i]));
  }
  for (const std::vector<Value>& row : table.rows) {
    for (std::size_t i = 0; i < row.size(); ++i) {
      write_cell(csv, row[i], layouts[i]);
    }
    csv.end_row();
  }
  return text;
}

DataTable findings_table(const Section& section) {
  DataTable table;
  table.name = "findings";
  table.title = "Findings";
  table.columns = {{"id", "", "stable name of the check"},
                   {"robot", "", "robot; empty for the whole log"},
                   {"verdict", "", "PASS, WARN, FAIL, UNKNOWN or NA"},
                   integer_column("severity", "0 to 10"),
                   {"title", "", "what was checked"},
                   {"value", "", "the number the verdict is about", true, false, ColumnType::own_units},
                   integer_column("n", "observations behind the value"),
                   number_column("exposure", "hours, km or passes behind a rate"),
                   {"threshold", "", "limits of the verdict"},
                   {"threshold_source", "", "where the limits come from"},
                   {"reason", "", "why there is no value"},
                   {"advice", "", "what to do"}};
  for (const Finding& f : section.findings) {
    table.rows.push_back({f.id, f.robot, std::string(verdict_name(f.verdict)), static_cast<std::int64_t>(f.severity),
                          f.title, f.value, optional_count(f.value.n),
                          f.value.exposure ? Value(*f.value.exposure) : Value(Missing{}), f.threshold,
                          f.threshold_source, f.value.reason, f.advice});
  }
  return table;
}

DataTable evidence_table(const Section& section) {
  DataTable table;
  table.name = "evidence";
  table.title = "Evidence";
  table.columns = {{"id", "", "finding"},
                   {"robot", "", "robot; empty for the whole log"},
                   {"from", "", "start of the stretch", false, true},
                   {"to", "", "end of the stretch", false, true},
                   {"source", "", "source of the rows"},
                   {"note", "", "what is seen there"}};
  for (const Finding& f : section.findings) {
    for (const Evidence& e : f.evidence) {
      table.rows.push_back({f.id, f.robot, Time{e.from_us}, Time{e.to_us}, e.source, e.note});
    }
  }
  return table;
}

std::vector<File> csv_files(const Section& section) {
  std::vector<File> files;
  CsvSchema schema;
  const auto add = [&](const std::string& stem, std::string text, const std::vector<CsvColumn>& columns) {
    files.push_back({file_stem(stem) + ".csv", std::move(text)});
    schema.add(files.back().name, columns);
  };
  const auto add_table = [&](const DataTable& table) { add(table.name, csv_text(table), csv_columns(table)); };

  add_table(findings_table(section));
  add_table(evidence_table(section));
  for (const DataTable& table : section.tables) {
    add_table(table);
  }
  std::vector<std::string> drawn;
  for (const Series& series : section.series) {
    if (std::find(drawn.begin(), drawn.end(), series.name) == drawn.end()) {
      drawn.push_back(series.name);
      add("series_" + series.name, series_text(section, series.name), series_columns(series));
    }
  }
  for (const Grid& grid : section.grids) {
    add("grid_" + grid.name, grid_text(grid), grid_columns(grid));
  }
  files.push_back({"schema.csv", schema.text()});
  return files;
}

}  // namespace tacho::report
