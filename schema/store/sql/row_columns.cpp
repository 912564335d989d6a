#include "schema/store/sql/row_columns.hpp"

#include <algorithm>
#include <array>

namespace tacho::store::sql {

namespace {

std::vector<RowColumn> make_columns(Source source) {
  std::vector<RowColumn> columns{{"robot", RowValue::robot, kNoField, "TEXT"},
                                 {"session", RowValue::session, kNoField, "INTEGER"},
                                 {"seq", RowValue::seq, kNoField, "INTEGER"},
                                 {"t_send_us", RowValue::t_send_us, kNoField, "INTEGER"},
                                 {"t_recv_us", RowValue::t_recv_us, kNoField, "INTEGER"},
                                 {"time", RowValue::time, kNoField, "TEXT"}};
  std::vector<RowColumn> hidden{{"robot_id", RowValue::robot_id, kNoField, "INTEGER", true}};
  for (std::size_t i = 0; i < kFieldCount; ++i) {
    const auto f = static_cast<FieldIndex>(i);
    if (!source_has(source, f)) {
      continue;
    }
    const std::string name(kFields[i].name);
    columns.push_back({name, RowValue::field, f, sql_type(kFields[i].kind)});
    if (kFields[i].kind == Kind::code) {
      hidden.push_back({name + "_name", RowValue::code_name, f, "TEXT", true});
    }
  }
  hidden.push_back({"states", RowValue::states, kNoField, "TEXT", true});
  columns.insert(columns.end(), hidden.begin(), hidden.end());
  return columns;
}

}  // namespace

bool source_has(Source source, FieldIndex field) {
  const Field& f = field_at(field);
  switch (source_info(source).encoding) {
    case Encoding::json:
      return !f.json.key.empty();
    case Encoding::registers:
      return f.reg.present() && !f.reg.discrete;
    case Encoding::inputs:
      return f.reg.present() && f.reg.discrete;
  }
  return false;
}

const std::vector<RowColumn>& row_columns(Source source) {
  static const auto kColumns = [] {
    std::array<std::vector<RowColumn>, kSourceCount> all;
    std::transform(all_sources().begin(), all_sources().end(), all.begin(), make_columns);
    return all;
  }();
  return kColumns[static_cast<std::size_t>(source)];
}

std::string_view sql_type(Kind kind) {
  switch (kind) {
    case Kind::real:
      return "REAL";
    case Kind::integer:
    case Kind::flag:
    case Kind::code:
      return "INTEGER";
    case Kind::text:
    case Kind::list:
    case Kind::structured:
    case Kind::alarms:
    case Kind::points:
      return "TEXT";
  }
  return "TEXT";
}

}  // namespace tacho::store::sql
