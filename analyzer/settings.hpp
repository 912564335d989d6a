#pragma once
// Thresholds and facts about the robots, in one table. Values come from `--config FILE` (TOML), else the default; each
// is printed with the result that used it, together with where it came from.

#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace tacho {

struct SettingRow {
  std::string_view name;           ///< "odometry.v_max_mps": table and key of the TOML file
  std::optional<double> fallback;  ///< empty: unknown unless configured (nominal capacity, wheel track)
  std::string_view unit;
  std::string_view meaning;
};

struct SettingValue {
  std::optional<double> value;
  std::string source;  ///< "default", "config.toml:12", or "not configured"
};

class Settings {
 public:
  Settings() = default;
  /// Throws Error with file, line and "did you mean" for an unknown key or a value that is no number.
  static Settings load(const std::filesystem::path& file);

  /// `name` must be a row of the table (assert). A per-robot value ([robot.NAME.battery]) wins over the general one.
  [[nodiscard]] SettingValue get(std::string_view name, std::string_view robot = {}) const;
  [[nodiscard]] double number(std::string_view name, std::string_view robot = {}) const;  ///< has a default
  /// `name` is "odometry.v_max_mps", or "NAME/odometry.v_max_mps" for one robot.
  void set(std::string_view name, double value, std::string source);
  /// Robots that have values of their own, sorted.
  [[nodiscard]] std::vector<std::string> robots() const;

 private:
  std::map<std::string, SettingValue, std::less<>> values_;  // "name" or "robot/name"
};

/// The rows of all analyses (AnalysisSpec::settings), in their order.
std::span<const SettingRow> setting_rows();

}  // namespace tacho
