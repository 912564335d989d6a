#include "schema/store/record_shape.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "schema/store/schema_sql.hpp"

namespace tacho::store {

namespace {

RawValue::Type type_of(std::string_view declared) {
  return declared == "TEXT"   ? RawValue::Type::text
         : declared == "BLOB" ? RawValue::Type::blob
         : declared == "REAL" ? RawValue::Type::real
                              : RawValue::Type::integer;
}

std::string parameters(Connection& out, const char* table) {
  std::string text;
  for (int i = 1; i <= Statement(out, select_sql(table)).columns(); ++i) {
    text += fmt::format("{}?{}", i > 1 ? ", " : "", i);
  }
  return text;
}

}  // namespace

RecordShape::RecordShape(Connection& out, const char* table, const char* on_conflict)
    : name_(table),
      insert_(out, insert_sql(table, on_conflict) + " RETURNING 1"),
      // The values of a record as a row, so that it is read and checked like one of the table itself.
      row_(out, "SELECT " + parameters(out, table)) {
  Statement columns(out, fmt::format("SELECT type, \"notnull\", pk, (SELECT wr FROM pragma_table_list('{0}')) FROM "
                                     "pragma_table_info('{0}') ORDER BY cid",
                                     table));
  while (columns.step()) {
    without_rowid_ = columns.integer(3) != 0;
    const bool rowid = !without_rowid_ && columns.integer(2) != 0 && columns.bytes(0) == "INTEGER";
    columns_.push_back({type_of(columns.bytes(0)), columns.integer(1) == 0, rowid});
  }
}

bool RecordShape::fits(const RawRecord& record) const {
  const auto fits = [](const Column& column, const RawValue& value) {
    return value.type == RawValue::Type::null ? column.rowid || column.nullable
                                              : !column.rowid && value.type == column.type;
  };
  return record.table != without_rowid_ && record.values.size() == columns_.size() &&
         std::equal(columns_.begin(), columns_.end(), record.values.begin(), fits);
}

const Statement& RecordShape::row(const RawRecord& record) {
  bind(row_, record, record.rowid);
  row_.step();
  return row_;
}

bool RecordShape::insert(const RawRecord& record, std::optional<std::int64_t> rowid) {
  bind(insert_, record, rowid);
  const bool inserted = insert_.step();
  insert_.reset();
  return inserted;
}

void RecordShape::bind(Statement& statement, const RawRecord& record, std::optional<std::int64_t> rowid) const {
  statement.reset();
  for (std::size_t i = 0; i < columns_.size(); ++i) {
    const int index = static_cast<int>(i) + 1;
    const RawValue& value = record.values[i];
    if (columns_[i].rowid && rowid) {
      statement.set(index, *rowid);
    } else if (value.type == RawValue::Type::null) {
      statement.set(index, std::nullopt);
    } else if (value.type == RawValue::Type::integer) {
      statement.set(index, value.integer);
    } else if (value.type == RawValue::Type::real) {
      statement.set(index, value.real);
    } else if (value.type == RawValue::Type::text) {
      statement.set(index, value.bytes);
    } else {
      statement.set(index, Statement::Blob{value.bytes});
    }
  }
}

}  // namespace tacho::store
