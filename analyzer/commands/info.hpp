#pragma once
// What a log holds, how complete it is and what is wrong with it. Of closed parts it reads the summaries
// only, unless a period is asked for.

#include <string>

#include "analyzer/report/section.hpp"
#include "analyzer/settings.hpp"
#include "schema/row_source.hpp"
#include "schema/store/log_reader.hpp"

namespace tacho::commands {

struct InfoQuery {
  std::vector<Robot> robots = {};            ///< those asked for
  const store::LogReader* reader = nullptr;  ///< the log's parts, null when it has none
  Settings settings = {};
  /// Parts, sessions, answers, missed polls and DATA-01 are those of it; what only the whole log can tell says so.
  Window window = {};
  std::string zone = "UTC";
};
Section info(RowSource& log, const InfoQuery& query);

/// In words: parts that are no longer at the beginning of a log, and whether one seems to be missing at its end.
std::vector<std::string> notes_of(const store::LogReader::Absent& absent, const store::LogReader& log);

/// Its rows of setting_rows().
std::span<const SettingRow> info_settings();

}  // namespace tacho::commands
