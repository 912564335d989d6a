#pragma once
// Alarms as the input registers show them: the first code of a level (31-33) and the first six errors (120-125).

#include <array>

#include "analyzer/analyses/alarm_tracker.hpp"
#include "schema/row_source.hpp"

namespace tacho {

/// Fatal, error, warning; there is no register for notices.
inline constexpr std::array<FieldIndex, 3> kFirstAlarmCodes{field("fatal_code"), field("error_code"),
                                                            field("warning_code")};
inline constexpr std::array<FieldIndex, 6> kErrorSlots{field("error_code_1"), field("error_code_2"),
                                                       field("error_code_3"), field("error_code_4"),
                                                       field("error_code_5"), field("error_code_6")};

/// Fills the levels of `poll` from one row; a level whose register was not read stays unknown. A set without a free
/// place is `full`: it may hide more.
void read_alarm_registers(const Batch& batch, std::size_t row, AlarmPoll& poll);

}  // namespace tacho
