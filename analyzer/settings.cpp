#include "analyzer/settings.hpp"

#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <vector>

#include "analyzer/analyses/analyses.hpp"
#include "analyzer/analyses/incident.hpp"
#include "analyzer/commands/info.hpp"
#include "schema/error.hpp"
#include "schema/text.hpp"

namespace tacho {
namespace {

const SettingRow* find_row(std::string_view name) {
  for (const SettingRow& row : setting_rows()) {
    if (row.name == name) {
      return &row;
    }
  }
  return nullptr;
}

/// Where a value of the file stands: "config.toml:12". The folder is left out, so that reports do not depend on it.
struct Place {
  std::string file;
  [[nodiscard]] std::string at(const toml::node& node) const {
    return file + ":" + std::to_string(node.source().begin.line);
  }
};

[[noreturn]] void refuse_key(const std::string& at, const std::string& name) {
  std::vector<std::string> names;
  for (const SettingRow& row : setting_rows()) {
    names.emplace_back(row.name);
  }
  const std::string near = nearest(name, names);
  throw SettingsError(at + ": " + name, "no such setting",
                      (near.empty() ? "" : "did you mean '" + near + "'? ") + "`tacho-analyzer settings` lists them");
}

class Reader {
 public:
  Reader(const std::filesystem::path& file, Settings& out) : place_{file.filename().string()}, out_(out) {}

  void read(const toml::table& root) {
    for (const auto& [key, node] : root) {
      if (key.str() == "robot") {
        read_robots(node);
      } else {
        read_group(std::string(key.str()), node, "");
      }
    }
  }

 private:
  Place place_;
  Settings& out_;

  void read_robots(const toml::node& node) {
    const toml::table* robots = node.as_table();
    if (robots == nullptr) {
      throw SettingsError(place_.at(node) + ": robot", "not a table", "write [robot.NAME.battery]");
    }
    for (const auto& [name, settings] : *robots) {
      const toml::table* groups = settings.as_table();
      if (groups == nullptr) {
        throw SettingsError(place_.at(settings) + ": robot." + std::string(name.str()), "not a table",
                            "write [robot." + std::string(name.str()) + ".battery]");
      }
      for (const auto& [group, values] : *groups) {
        read_group(std::string(group.str()), values, name.str());
      }
    }
  }

  void read_group(const std::string& group, const toml::node& node, std::string_view robot) {
    const toml::table* values = node.as_table();
    if (values == nullptr) {
      refuse_key(place_.at(node), group);
    }
    for (const auto& [key, value] : *values) {
      const std::string name = group + "." + std::string(key.str());
      const SettingRow* row = find_row(name);
      if (row == nullptr) {
        refuse_key(place_.at(value), name);
      }
      const std::optional<double> number = value.value<double>();
      if (!value.is_number() || !number || !std::isfinite(*number)) {
        throw SettingsError(place_.at(value) + ": " + name, "not a number",
                            "write " + name + " as a plain number in " + unit_of(name));
      }
      if (!row->allowed.holds(*number)) {
        throw SettingsError(place_.at(value) + ": " + name,
                            with_unit(*number, *row) + ": allowed is " + row->allowed.text(), "");
      }
      out_.set(robot.empty() ? name : std::string(robot) + "/" + name, *number, place_.at(value));
    }
  }

  static std::string with_unit(double number, const SettingRow& row) {
    return fmt::format("{}{}{}", number, row.unit.empty() || row.unit == "1" ? "" : " ",
                       row.unit == "1" ? "" : row.unit);
  }

  static std::string unit_of(std::string_view name) {
    const std::string_view unit = find_row(name)->unit;
    return unit.empty() || unit == "1" ? "no unit" : std::string(unit);
  }
};

}  // namespace

std::string Range::text() const {
  if (std::isfinite(high)) {
    return fmt::format("{}{} to {}", low_itself ? "" : "above ", low, high);
  }
  return low_itself ? fmt::format("{} or more", low) : fmt::format("above {}", low);
}

Settings Settings::load(const std::filesystem::path& file) {
  if (std::error_code ec; !std::filesystem::is_regular_file(file, ec)) {
    throw SettingsError(file.string(), ec ? ec.message() : "no such file", "give --config the path of a TOML file");
  }
  Settings settings;
  try {
    const toml::table root = toml::parse_file(file.string());
    Reader(file, settings).read(root);
  } catch (const toml::parse_error& error) {
    throw SettingsError(file.filename().string() + ":" + std::to_string(error.source().begin.line),
                        std::string(error.description()), "the file must be TOML 1.0");
  }
  return settings;
}

SettingValue Settings::get(std::string_view name, std::string_view robot) const {
  if (!robot.empty()) {
    const auto own = values_.find(std::string(robot) + "/" + std::string(name));
    if (own != values_.end()) {
      return own->second;
    }
  }
  const auto general = values_.find(name);
  if (general != values_.end()) {
    return general->second;
  }
  const SettingRow* row = find_row(name);
  assert(row != nullptr && "a setting that no table declares");
  return {row->fallback, row->fallback ? "default" : "not configured"};
}

double Settings::number(std::string_view name, std::string_view robot) const {
  const SettingValue value = get(name, robot);
  assert(value.value.has_value() && "a setting without default is read with get()");
  return *value.value;
}

std::string Settings::sources(std::span<const std::string_view> names, std::string_view robot) const {
  std::vector<std::string> all;
  for (const std::string_view name : names) {
    std::string source = get(name, robot).source;
    if (std::find(all.begin(), all.end(), source) == all.end()) {
      all.push_back(std::move(source));
    }
  }
  return fmt::format("{}", fmt::join(all, ", "));
}

void Settings::set(std::string_view name, double value, std::string source) {
  values_.insert_or_assign(std::string(name), SettingValue{value, std::move(source)});
}

std::vector<std::string> Settings::robots() const {
  std::vector<std::string> names;
  for (const auto& [key, value] : values_) {
    const std::size_t slash = key.rfind('/');  // setting names hold none, robot names may
    if (slash != std::string::npos && (names.empty() || names.back() != key.substr(0, slash))) {
      names.push_back(key.substr(0, slash));
    }
  }
  return names;
}

std::span<const SettingRow> setting_rows() {
  static const std::vector<SettingRow> rows = [] {
    std::vector<SettingRow> all;
    const auto add = [&all](std::span<const SettingRow> own) { all.insert(all.end(), own.begin(), own.end()); };
    for (const AnalysisSpec& spec : analyses()) {
      if (spec.settings != nullptr) {
        add(spec.settings());
      }
    }
    add(commands::info_settings());
    add(incident_settings());
    return all;
  }();
  return rows;
}

}  // namespace tacho
