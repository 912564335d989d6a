#pragma once
// What of a log lies in a period, as counts: reads row times and gap rows, where coverage() knows the whole log only.

#include <vector>

#include "schema/row_source.hpp"

namespace tacho::commands {

/// `whole`: coverage of the robots asked for. Stored answers are counted by the time of sending; of a gap row that
/// reaches beyond the window the polls are shared out by time, and so is its length. `planned` is stored + missed;
/// `undecodable`, `bytes`, `seen` and `valued` stay empty.
std::vector<Coverage> coverage_within(RowSource& log, const std::vector<Coverage>& whole, const Window& window);

}  // namespace tacho::commands
