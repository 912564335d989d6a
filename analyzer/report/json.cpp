#include "analyzer/report/json.hpp"

#include <cmath>
#include <nlohmann/json.hpp>

#include "analyzer/report/json_layout.hpp"
#include "schema/time.hpp"

namespace tacho::report {
namespace {

using Json = nlohmann::ordered_json;

Json number_or_null(const std::optional<double>& value) {
  return value && std::isfinite(*value) ? Json(*value) : Json(nullptr);
}

Json time_json(Micros t_us) { return {{"t_utc", iso_utc(t_us)}, {"t_unix_us", t_us}}; }

Json quantity_json(const Quantity& q, const std::string& column_unit) {
  Json out;
  const bool known = q.value && std::isfinite(*q.value);
  out["value"] = number_or_null(q.value);
  out["unit"] = q.unit.empty() ? column_unit : q.unit;
  out["lo"] = number_or_null(q.lo);
  out["hi"] = number_or_null(q.hi);
  out["n"] = q.n ? Json(*q.n) : Json(nullptr);
  out["exposure"] = number_or_null(q.exposure);
  if (!known) {
    out["reason"] = !q.reason.empty() ? q.reason : q.value ? "not a finite number" : "not given";
  } else if (!q.reason.empty() && !q.lo && !q.hi) {
    out["reason"] = q.reason;  // why there is no interval
  }
  return out;
}

Quantity plain(double value) {
  Quantity q;
  q.value = value;
  return q;
}

struct CellJson {
  const ColumnSpec& column;
  Json operator()(const Missing& m) const {
    return {{"value", nullptr}, {"reason", m.reason.empty() ? "not given" : m.reason}};
  }
  Json operator()(bool value) const { return value; }
  Json operator()(std::int64_t value) const {
    Json out = quantity_json(plain(0.0), column.unit);
    out["value"] = value;  // a double would lose digits above 2^53
    return out;
  }
  Json operator()(double value) const { return quantity_json(plain(value), column.unit); }
  Json operator()(const std::string& value) const { return value; }
  Json operator()(const Time& value) const { return time_json(value.us); }
  Json operator()(const Quantity& value) const { return quantity_json(value, column.unit); }
};

Json finding_json(const Finding& f) {
  Json out;
  out["id"] = f.id;
  out["robot"] = f.robot;
  out["title"] = f.title;
  out["verdict"] = verdict_name(f.verdict);
  out["severity"] = f.severity;
  out["value"] = quantity_json(f.value, "");
  out["threshold"] = f.threshold;
  out["threshold_source"] = f.threshold_source;
  out["evidence"] = Json::array();
  for (const Evidence& e : f.evidence) {
    out["evidence"].push_back(
        {{"from", time_json(e.from_us)}, {"to", time_json(e.to_us)}, {"source", e.source}, {"note", e.note}});
  }
  out["advice"] = f.advice;
  return out;
}

Json table_json(const DataTable& table) {
  Json out;
  out["name"] = table.name;
  out["title"] = table.title;
  out["columns"] = Json::array();
  for (const ColumnSpec& c : table.columns) {
    out["columns"].push_back({{"name", c.name}, {"unit", c.unit}, {"description", c.description}});
  }
  out["rows"] = Json::array();
  for (const std::vector<Value>& row : table.rows) {
    Json cells = Json::object();
    for (std::size_t i = 0; i < row.size(); ++i) {
      cells[table.columns[i].name] = std::visit(CellJson{table.columns[i]}, row[i]);
    }
    out["rows"].push_back(std::move(cells));
  }
  return out;
}

Json packed(const std::vector<double>& values) {
  Json out = Json::array();
  for (const double v : values) {
    out.push_back(number_or_null(v));
  }
  return out;
}

Json series_json(const Series& series) {
  return {{"name", series.name},      {"title", series.title},         {"robot", series.robot},  {"unit", series.unit},
          {"t_unix_us", series.t_us}, {"value", packed(series.value)}, {"null_means", "no data"}};
}

Json grid_json(const Grid& grid) {
  Json out;
  out["name"] = grid.name;
  out["title"] = grid.title;
  out["map"] = grid.map;
  out["cell_m"] = grid.cell_m;
  out["i0"] = grid.i0;
  out["j0"] = grid.j0;
  out["width"] = grid.width;
  out["height"] = grid.height;
  out["order"] = "value[j * width + i] covers x from (i0 + i) cell_m, y from (j0 + j) cell_m";
  out["layers"] = Json::array();
  for (const GridLayer& layer : grid.layers) {
    out["layers"].push_back({{"name", layer.name},
                             {"title", layer.title},
                             {"unit", layer.unit},
                             {"value", packed(layer.value)},
                             {"null_means", "not visited"}});
  }
  return out;
}

Json section_json(const Section& section) {
  Json out;
  out["name"] = section.name;
  out["title"] = section.title;
  out["question"] = section.question;
  out["notes"] = section.notes;
  const auto list = [&](const char* key, const auto& items, const auto& convert) {
    out[key] = Json::array();
    for (const auto& item : items) {
      out[key].push_back(convert(item));
    }
  };
  list("findings", section.findings, finding_json);
  list("tables", section.tables, table_json);
  list("series", section.series, series_json);
  list("grids", section.grids, grid_json);
  return out;
}

Json origin_json(const Origin& origin) {
  Json out;
  out["format"] = kJsonFormat;
  out["version"] = kJsonVersion;
  out["tool"] = origin.tool;
  const Window open;
  out["from"] = origin.window.from_us == open.from_us ? Json(nullptr) : time_json(origin.window.from_us);
  out["to"] = origin.window.to_us == open.to_us ? Json(nullptr) : time_json(origin.window.to_us);
  out["zone"] = origin.zone;
  out["robots"] = origin.robots;
  out["settings"] = Json::array();
  for (const UsedSetting& s : origin.settings) {
    out["settings"].push_back({{"name", s.name}, {"value", quantity_json(s.value, "")}, {"source", s.source}});
  }
  return out;
}

}  // namespace

std::string json_string(std::string_view text) {
  return nlohmann::json(text).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

std::string json_text(std::span<const Section> sections, const Origin& origin) {
  Json document = origin_json(origin);
  document["sections"] = Json::array();
  for (const Section& section : sections) {
    document["sections"].push_back(section_json(section));
  }
  return laid_out(document);
}

}  // namespace tacho::report
