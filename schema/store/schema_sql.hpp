#pragma once
// The tables of a part, as one table of columns. CREATE TABLE text, INSERT text and schema/schema.sql come from it.

#include <cstdint>
#include <string>
#include <string_view>

namespace tacho::store {

/// PRAGMA application_id of every part: "TACH".
inline constexpr std::int64_t kApplicationId = 0x54414348;
/// PRAGMA user_version. A reader reads all versions up to its own; a writer only continues parts of its own.
inline constexpr std::int64_t kSchemaVersion = 1;

/// Everything a new part is created with: pragmas and CREATE TABLE statements, with the meaning of each column as
/// comment.
std::string schema_sql();
/// CREATE TABLE text of one table.
std::string table_sql(std::string_view table);

/// "INSERT INTO gap(id, robot, ...) VALUES(?1, ?2, ...)": every column of the table in its order. `on_conflict`: "",
/// "OR REPLACE" or "OR IGNORE".
std::string insert_sql(std::string_view table, std::string_view on_conflict = {});
/// "SELECT id, robot, ... FROM gap": every column of the table in its order.
std::string select_sql(std::string_view table);

}  // namespace tacho::store
