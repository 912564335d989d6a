#include "analyzer/commands/fields.hpp"

#include <fmt/format.h>

#include "analyzer/settings.hpp"
#include "schema/docs.hpp"
#include "schema/fields.hpp"

namespace tacho::commands {
namespace {

std::string codes_text(const Field& field) {
  std::string out;
  for (const Code& code : field.codes) {
    out += fmt::format("{}{} {}", out.empty() ? "" : ", ", code.value, code.name);
  }
  return out;
}

std::string sentinel_text(Sentinel sentinel) {
  switch (sentinel) {
    case Sentinel::none:
      return "";
    case Sentinel::minus_one:
      return "-1";
    case Sentinel::negative_zero:
      return "-0.0";
    case Sentinel::any_zero:
      return "0";
  }
  return "";
}

}  // namespace

Section fields() {
  Section section;
  section.name = "fields";
  section.title = "Fields";
  section.question = "What does each column mean, and where does it come from?";
  DataTable table{"fields",
                  "Fields",
                  {{"name", "", "column name"},
                   {"unit", "", "unit in the log and in every result"},
                   {"kind", "", "real, integer, flag, code, text, list, structured, alarms or points"},
                   {"json", "", "key of the 11100 or 11013 answer, and its factor"},
                   {"register", "", "input register [3x] or discrete input [1x], and its factor"},
                   {"codes", "", "values of a code"},
                   {"condition", "", "flag; while it is false the field means nothing"},
                   {"not_supplied", "", "value that stands for: the robot does not supply this"},
                   flag_column("retired", "struck out in the vendor's document, still decoded"),
                   {"meaning", "", "meaning"}},
                  {},
                  false};
  for (const Field& f : kFields) {
    table.rows.push_back({std::string(f.name), std::string(f.unit), std::string(kind_name(f.kind)), json_text(f),
                          register_text(f), codes_text(f), std::string(f.condition), sentinel_text(f.sentinel),
                          f.retired, std::string(f.meaning)});
  }
  section.notes.push_back(
      "structured: nested JSON, kept and exported as its JSON text; list: an array of scalars, likewise");
  section.tables.push_back(std::move(table));
  return section;
}

Section settings() {
  Section section;
  section.name = "settings";
  section.title = "Settings";
  section.question = "Which thresholds and facts can --config FILE give?";
  DataTable table{"settings",
                  "Settings",
                  {{"name", "", "table and key of the TOML file; [robot.NAME.TABLE] for one robot"},
                   number_column("default", "value when it is not configured"),
                   {"unit", "", "unit"},
                   {"allowed", "", "values that it can have"},
                   {"meaning", "", "meaning"}},
                  {},
                  false};
  for (const SettingRow& row : setting_rows()) {
    table.rows.push_back({std::string(row.name),
                          row.fallback ? Value(*row.fallback) : Value(Missing{"unknown unless configured"}),
                          std::string(row.unit), row.allowed.text(), std::string(row.meaning)});
  }
  section.tables.push_back(std::move(table));
  return section;
}

}  // namespace tacho::commands
