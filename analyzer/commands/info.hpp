#pragma once
// What a log holds, how complete it is and what is wrong with it. Reads gap rows and summaries, opens no body.

#include <string>

#include "analyzer/report/section.hpp"
#include "analyzer/settings.hpp"
#include "schema/row_source.hpp"
#include "schema/store/log_reader.hpp"

namespace tacho::commands {

/// `reader`: the log's parts, null when it has none.
Section info(RowSource& log, const std::vector<Robot>& robots, const store::LogReader* reader,
             const Settings& settings);

/// Its rows of setting_rows().
std::span<const SettingRow> info_settings();

}  // namespace tacho::commands
