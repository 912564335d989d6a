#pragma once
// A virtual table of SQLite as two C++ interfaces. Exceptions end here: SQLite gets their text.
//
// Tables are read-only: without xUpdate SQLite refuses every write itself.

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "schema/store/sql/sqlite_api.hpp"

namespace tacho::store::sql {

/// One pass over a table. Must not outlive its table.
class TableCursor {
 public:
  virtual ~TableCursor() = default;
  /// Starts over and goes to the first row. `plan` is what Table::plan gave; `values` its arguments in order.
  virtual void start(std::string_view plan, std::span<sqlite3_value* const> values) = 0;
  [[nodiscard]] virtual bool at_end() const = 0;
  virtual void next() = 0;
  /// The same for the same row in every pass: where a condition says `or`, SQLite makes several passes and keeps each
  /// row once.
  [[nodiscard]] virtual std::int64_t row_id() const = 0;
  /// Hands the value of a column of the current row to SQLite; nothing handed over is NULL.
  virtual void column(sqlite3_context* out, int column) = 0;
};

class Table {
 public:
  virtual ~Table() = default;
  /// "CREATE TABLE x(...)"
  [[nodiscard]] virtual std::string declaration() const = 0;
  /// Chooses constraints (argvIndex), sets costs, and returns what the cursor must know of it as text.
  [[nodiscard]] virtual std::string plan(sqlite3_index_info& info) const = 0;
  virtual std::unique_ptr<TableCursor> open() = 0;
};

/// `arguments`: those of CREATE VIRTUAL TABLE, without their quotes.
using MakeTable = std::function<std::unique_ptr<Table>(const std::vector<std::string>& arguments)>;

/// Registers a module with the connection, which keeps `make` until it is closed. Returns a code of SQLite.
int add_module(sqlite3* connection, const std::string& name, MakeTable make);

/// The text of an argument; empty when it has none.
std::string_view text_of(sqlite3_value* value);

/// A value for the current row; empty text is text.
void give(sqlite3_context* out, std::string_view text);
void give(sqlite3_context* out, std::int64_t number);
void give(sqlite3_context* out, double number);

}  // namespace tacho::store::sql
