#pragma once
// What changes when a running recorder gets another configuration. Pure.
//
// A robot whose settings are the same, by its name, is not touched. Every other difference of a robot restarts its
// connections; what belongs to the log and to the program as a whole takes a restart of the recorder.

#include <string>
#include <vector>

#include "recorder/config.hpp"

namespace tacho::recorder {

struct ReloadPlan {
  std::vector<std::string> removed;
  std::vector<RobotConfig> changed;  ///< as they will be
  std::vector<RobotConfig> added;
  std::size_t kept = 0;
  [[nodiscard]] bool nothing() const { return removed.empty() && changed.empty() && added.empty(); }
  /// "2 robots kept, changed: amr-1, added: amr-7"
  [[nodiscard]] std::string text() const;
};

/// Throws UsageError when something differs that cannot be changed while recording; names it.
ReloadPlan plan_reload(const Config& now, const Config& next);

}  // namespace tacho::recorder
