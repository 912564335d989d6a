#pragma once
// Thresholds and facts about the robots, in one table. Values come from `--config FILE` (TOML), else the default; each
// is printed with the result that used it, together with where it came from.

#include <algorithm>
#include <array>
#include <cstddef>
#include <filesystem>
#include <initializer_list>
#include <limits>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "schema/error.hpp"

namespace tacho {

/// The values that a setting can have.
struct Range {
  double low = 0.0;
  double high = std::numeric_limits<double>::infinity();
  bool low_itself = true;  ///< the low end is allowed too

  [[nodiscard]] constexpr bool holds(double value) const {
    return (low_itself ? value >= low : value > low) && value <= high;
  }
  [[nodiscard]] std::string text() const;  ///< "above 0", "0 to 1", "0 or more"
};
inline constexpr Range kAbove0{0.0, std::numeric_limits<double>::infinity(), false};
inline constexpr Range kFrom1{1.0};
inline constexpr Range kShare{0.0, 1.0};
inline constexpr Range kTemperature{-273.15};

/// The configuration is wrong, which is for its author to correct.
class SettingsError : public Error {
 public:
  using Error::Error;
};

struct SettingRow {
  std::string_view name;           ///< "odometry.v_max_mps": table and key of the TOML file
  std::optional<double> fallback;  ///< empty: unknown unless configured (nominal capacity, wheel track)
  std::string_view unit;
  std::string_view meaning;
  Range allowed = {};  ///< unless said otherwise 0 or more
};

struct SettingValue {
  std::optional<double> value;
  std::string source;  ///< "default", "config.toml:12", or "not configured"
};

class Settings {
 public:
  Settings() = default;
  /// Throws SettingsError with file, line and "did you mean" for an unknown key, a value that is no number, and one
  /// outside its range.
  static Settings load(const std::filesystem::path& file);

  /// `name` must be a row of the table (assert). A per-robot value ([robot.NAME.battery]) wins over the general one.
  [[nodiscard]] SettingValue get(std::string_view name, std::string_view robot = {}) const;
  [[nodiscard]] double number(std::string_view name, std::string_view robot = {}) const;  ///< has a default
  /// Where these came from: "default", or the places in the configuration file.
  [[nodiscard]] std::string sources(std::span<const std::string_view> names, std::string_view robot = {}) const;
  [[nodiscard]] std::string sources(std::initializer_list<std::string_view> names, std::string_view robot = {}) const {
    return sources(std::span(names.begin(), names.size()), robot);
  }
  /// `name` is "odometry.v_max_mps", or "NAME/odometry.v_max_mps" for one robot.
  void set(std::string_view name, double value, std::string source);
  /// Robots that have values of their own, sorted.
  [[nodiscard]] std::vector<std::string> robots() const;

 private:
  std::map<std::string, SettingValue, std::less<>> values_;  // "name" or "robot/name"
};

/// The rows of all analyses (AnalysisSpec::settings), in their order, then those of info and incident.
std::span<const SettingRow> setting_rows();

/// A row of the table and the member of an analysis' Config that it fills. Optional members are those without default.
template <typename Config>
struct ConfigRow {
  SettingRow row;
  std::variant<double Config::*, std::optional<double> Config::*> member;
};

template <typename Config, std::size_t kCount>
constexpr std::array<SettingRow, kCount> rows_of(const std::array<ConfigRow<Config>, kCount>& table) {
  std::array<SettingRow, kCount> rows;
  std::transform(table.begin(), table.end(), rows.begin(), [](const ConfigRow<Config>& entry) { return entry.row; });
  return rows;
}

/// Fills every member that the table names with its value for one robot.
template <typename Config, std::size_t kCount>
void fill(Config& config, const std::array<ConfigRow<Config>, kCount>& table, const Settings& settings,
          std::string_view robot) {
  for (const ConfigRow<Config>& entry : table) {
    if (const auto* number = std::get_if<double Config::*>(&entry.member)) {
      config.*(*number) = settings.number(entry.row.name, robot);
    } else {
      config.*std::get<std::optional<double> Config::*>(entry.member) = settings.get(entry.row.name, robot).value;
    }
  }
}

}  // namespace tacho
