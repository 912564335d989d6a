#pragma once
// The rows of one table as they look in a page (page_scan.hpp), and the way from there into a table of the same
// columns.

#include <cstdint>
#include <optional>
#include <vector>

#include "schema/store/page_scan.hpp"
#include "schema/store/sqlite.hpp"

namespace tacho::store {

class RecordShape {
 public:
  /// `table`: of schema_sql.hpp; it must exist in `out`, which must outlive this.
  RecordShape(Connection& out, const char* table, const char* on_conflict);

  [[nodiscard]] const char* name() const { return name_; }
  [[nodiscard]] bool fits(const RawRecord& record) const;
  /// The record as a row of the table, for the read functions of rows.hpp. Valid until the next call.
  const Statement& row(const RawRecord& record);
  /// False: nothing was inserted, the row id is taken. Without `rowid` a new one is given.
  bool insert(const RawRecord& record, std::optional<std::int64_t> rowid);

 private:
  struct Column {
    RawValue::Type type;
    bool nullable;
    bool rowid;
  };
  const char* name_;
  bool without_rowid_ = false;
  std::vector<Column> columns_;
  Statement insert_;
  Statement row_;

  void bind(Statement& statement, const RawRecord& record, std::optional<std::int64_t> rowid) const;
};

}  // namespace tacho::store
