#pragma once
// The virtual tables `status`, `io`, `registers` and `inputs`: one row per stored answer, one column per field
// (row_columns.hpp). Only the columns of a statement are read, only the robot and the time it asks for.

#include <memory>

#include "schema/sample.hpp"
#include "schema/store/sql/shared_log.hpp"
#include "schema/store/sql/virtual_table.hpp"

namespace tacho::store::sql {

std::unique_ptr<Table> make_row_table(Source source, std::shared_ptr<SharedLog> log);

}  // namespace tacho::store::sql
