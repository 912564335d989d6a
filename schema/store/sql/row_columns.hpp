#pragma once
// The columns of the tables `status`, `io`, `registers` and `inputs`, in SQL and in exports to SQLite: THE place that
// knows them. Field columns come from the field table, one per field that the source can have.

#include <string>
#include <string_view>
#include <vector>

#include "schema/fields.hpp"
#include "schema/sample.hpp"

namespace tacho::store::sql {

enum class RowValue : std::uint8_t {
  robot,      ///< name of the robot
  session,    ///< session.id
  seq,        ///< number of the planned poll
  t_send_us,  ///< request sent, UTC microseconds
  t_recv_us,  ///< answer received, UTC microseconds
  time,       ///< t_send_us as ISO 8601 text, UTC, milliseconds
  field,      ///< value of a field in SI units; NULL when its state is not `present`
  robot_id,   ///< robot.id, for joins with gap, event and clock; hidden
  code_name,  ///< name of a code, NULL when the list does not know it; hidden
  states,     ///< JSON: why fields without a value have none (absent ones are left out); hidden
};

struct RowColumn {
  std::string name;
  RowValue value = RowValue::field;
  FieldIndex field = kNoField;  ///< of `field` and `code_name`
  std::string_view type;        ///< INTEGER, REAL or TEXT
  bool hidden = false;          ///< not part of `select *`
};

/// Whether answers of the source can contain the field.
bool source_has(Source source, FieldIndex field);

/// In the order of declaration: the row, its fields in the order of the field table, hidden columns.
const std::vector<RowColumn>& row_columns(Source source);

/// The SQL type of a field's values: INTEGER for numbers without a fraction, flags and codes; TEXT for text, JSON,
/// alarms and points.
std::string_view sql_type(Kind kind);

}  // namespace tacho::store::sql
