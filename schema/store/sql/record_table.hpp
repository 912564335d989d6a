#pragma once
// The plain tables of a log as one: robot, session, stream, coverage, unknown_key, gap, event, clock, problem. Columns
// have the names and meanings they have in a part (schema.sql), without the ids and checksums that belong to one part;
// but `robot` is the robot's name, as in the tables of rows, and the hidden `robot_id` its number.
// A table is read robot by robot when a statement uses it.

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "schema/store/sql/shared_log.hpp"
#include "schema/store/sql/virtual_table.hpp"

namespace tacho::store::sql {

/// The tables above, by name.
const std::vector<std::string>& record_table_names();
std::vector<std::string> record_column_names(std::string_view table);

std::unique_ptr<Table> make_record_table(std::string_view table, std::shared_ptr<SharedLog> log);

}  // namespace tacho::store::sql
