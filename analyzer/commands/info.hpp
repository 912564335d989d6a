#pragma once
// What a log holds, how complete it is and what is wrong with it. Of closed parts it reads the summaries
// only.

#include <string>

#include "analyzer/report/section.hpp"
#include "analyzer/settings.hpp"
#include "schema/row_source.hpp"
#include "schema/store/log_reader.hpp"

namespace tacho::commands {

/// `reader`: the log's parts, null when it has none.
Section info(const RowSource& log, const std::vector<Robot>& robots, const store::LogReader* reader,
             const Settings& settings);

/// In words: parts that are no longer at the beginning of a log, and whether one seems to be missing at its end.
std::vector<std::string> notes_of(const store::LogReader::Absent& absent, const store::LogReader& log);

/// Its rows of setting_rows().
std::span<const SettingRow> info_settings();

}  // namespace tacho::commands
