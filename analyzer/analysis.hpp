#pragma once
// What an analysis is. It folds over the slices of one robot, merges with the same analysis of other robots, and ends
// in a Section. It knows neither SQLite, nor the command line, nor other analyses, nor how results are printed.

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "analyzer/report/section.hpp"
#include "analyzer/settings.hpp"
#include "schema/row_source.hpp"

namespace tacho {

/// What an analysis is told about the robot it folds over, before the first slice.
struct RobotContext {
  Robot robot;
  std::vector<Coverage> coverage;      ///< of this robot, one per source that has rows or gaps
  Window window;                       ///< the period asked for
  std::string zone = "UTC";            ///< day boundaries
  const Settings* settings = nullptr;  ///< outlives the analysis

  [[nodiscard]] const Coverage* find(Source source) const;
  /// The best source of the need that this robot's log has rows of and that ever gave the field a value. When none did,
  /// the best one that ever had the field at all (null, "no sensor", not meaningful); empty when none.
  [[nodiscard]] std::optional<Source> choose(const Need& need) const;
};

class Analysis {
 public:
  virtual ~Analysis() = default;
  /// Slices of one robot, in order. Chunking must not matter: any cut of the same rows gives the same result.
  virtual void fold(const Slice& slice) = 0;
  /// Takes over the result of the same analysis of another robot; called after both have seen all their slices, in the
  /// order of robot ids.
  virtual void merge(Analysis& other) = 0;
  /// Called once, after the last merge.
  virtual Section finish() = 0;
};

struct AnalysisSpec {
  std::string_view name;      ///< command and folder name
  std::string_view question;  ///< one line
  std::vector<Need> (*needs)();
  std::unique_ptr<Analysis> (*make)(const RobotContext& context);
  std::span<const SettingRow> (*settings)() = nullptr;  ///< its rows of setting_rows(); null when it has none
  bool maps = false;                                    ///< its Section can hold grids, to be drawn as PNG
};

/// Every analysis, in the order of the report. One row each (registry.cpp).
std::span<const AnalysisSpec> analyses();

/// Runs analyses over the robots (ids; empty = all) in the order of their ids, all in one pass over the log: each row
/// is decoded once, with the union of the needs. An analysis is shown only the sources that one of its own needs chose.
std::vector<Section> run_analyses(std::span<const AnalysisSpec> specs, RowSource& log, std::span<const RobotId> robots,
                                  Window window, const std::string& zone, const Settings& settings);

/// The same for one.
Section run_analysis(const AnalysisSpec& spec, RowSource& log, std::span<const RobotId> robots, Window window,
                     const std::string& zone, const Settings& settings);

}  // namespace tacho
