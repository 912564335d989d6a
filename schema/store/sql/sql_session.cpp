#include "schema/store/sql/sql_session.hpp"

#include <sqlite3.h>

#include <algorithm>
#include <array>
#include <memory>
#include <string_view>
#include <utility>

#include "schema/store/schema_sql.hpp"
#include "schema/store/sql/tables.hpp"
#include "schema/store/sqlite.hpp"
#include "schema/store/vocabulary.hpp"
#include "schema/text.hpp"

namespace tacho::store::sql {

namespace {

int take_api(sqlite3*, const char**, const sqlite3_api_routines* api) {
  use_api(api);
  return SQLITE_OK;
}

/// SQLite hands out its table of functions to extensions only, so for one moment we are one.
void fetch_api() {
  const auto entry = reinterpret_cast<void (*)()>(take_api);
  sqlite3_auto_extension(entry);
  const Connection any(":memory:", OpenMode::create);
  sqlite3_cancel_auto_extension(entry);
}

/// What was refused, for the message; empty while nothing was.
struct Guard {
  std::string refused;
};

const char* name_of(int action) {
  struct Name {
    int action;
    const char* name;
  };
  static constexpr std::array<Name, 12> kNames{{{SQLITE_ATTACH, "ATTACH"},
                                                {SQLITE_DETACH, "DETACH"},
                                                {SQLITE_INSERT, "INSERT"},
                                                {SQLITE_UPDATE, "UPDATE"},
                                                {SQLITE_DELETE, "DELETE"},
                                                {SQLITE_PRAGMA, "PRAGMA"},
                                                {SQLITE_TRANSACTION, "BEGIN or COMMIT"},
                                                {SQLITE_SAVEPOINT, "SAVEPOINT"},
                                                {SQLITE_REINDEX, "REINDEX"},
                                                {SQLITE_ANALYZE, "ANALYZE"},
                                                {SQLITE_CREATE_VTABLE, "CREATE VIRTUAL TABLE"},
                                                {SQLITE_DROP_TABLE, "DROP TABLE"}}};
  const auto* found = std::find_if(kNames.begin(), kNames.end(), [&](const Name& n) { return n.action == action; });
  return found == kNames.end() ? "CREATE, ALTER or DROP" : found->name;
}

int authorize(void* guard, int action, const char* first, const char* second, const char*, const char*) {
  const auto is = [](const char* text, const char* wanted) {
    return text != nullptr && sqlite3_stricmp(text, wanted) == 0;
  };
  std::string& refused = static_cast<Guard*>(guard)->refused;
  switch (action) {
    case SQLITE_SELECT:
    case SQLITE_READ:
    case SQLITE_RECURSIVE:
      return SQLITE_OK;
    case SQLITE_FUNCTION:
      if (is(second, "load_extension")) {
        refused = "load_extension";
        return SQLITE_DENY;
      }
      return SQLITE_OK;
    case SQLITE_PRAGMA:
      if (is(first, "table_info") || is(first, "table_xinfo") || is(first, "table_list")) {
        return SQLITE_OK;
      }
      break;
    default:
      break;
  }
  if (refused.empty()) {
    // A table is made and dropped by changing the table of tables.
    const bool schema = first != nullptr && std::string_view(first).starts_with("sqlite_");
    refused = schema ? name_of(SQLITE_CREATE_TABLE) : name_of(action);
  }
  return SQLITE_DENY;
}

std::string joined(const std::vector<std::string>& names) {
  std::string out;
  for (const std::string& name : names) {
    out += (out.empty() ? "" : ", ") + name;
  }
  return out;
}

/// What follows `head` in `text`; empty when it does not begin so.
std::string after(const std::string& text, const std::string& head) {
  return text.rfind(head, 0) == 0 ? text.substr(head.size()) : std::string();
}

std::string without_table(const std::string& name) {
  const std::size_t dot = name.rfind('.');
  return dot == std::string::npos ? name : name.substr(dot + 1);
}

SqlValue value_at(sqlite3_stmt* row, int column) {
  const auto bytes = [&](const void* data) {
    const auto size = static_cast<std::size_t>(sqlite3_column_bytes(row, column));
    return data == nullptr ? std::string() : std::string(static_cast<const char*>(data), size);
  };
  switch (sqlite3_column_type(row, column)) {
    case SQLITE_INTEGER:
      return std::int64_t{sqlite3_column_int64(row, column)};
    case SQLITE_FLOAT:
      return sqlite3_column_double(row, column);
    case SQLITE_TEXT:
      return bytes(sqlite3_column_text(row, column));
    case SQLITE_BLOB:
      return SqlBlob{bytes(sqlite3_column_blob(row, column))};
    default:
      return {};
  }
}

}  // namespace

struct SqlSession::Impl {
  Connection connection{":memory:", OpenMode::create};
  Guard guard;

  explicit Impl(RowSource& log);
  void run(const std::string& sql, const Head& head, const Row& row);
  [[nodiscard]] std::vector<std::string> table_names() const;
  [[noreturn]] void fail(const std::string& sql) const;
  [[nodiscard]] std::string place(const std::string& sql) const;
  /// False for white space, semicolons and remarks.
  [[nodiscard]] bool is_statement(const char* sql) const;
};

SqlSession::Impl::Impl(RowSource& log) {
  register_modules(connection.handle(), nullptr, std::make_shared<SharedLog>(log));
  connection.exec(table_sql("field") + table_sql("code"));
  write_vocabulary(connection);
  for (const std::string& name : all_table_names()) {
    connection.exec("CREATE VIRTUAL TABLE temp." + name + " USING tacho_" + name);
  }
  connection.check(sqlite3_set_authorizer(connection.handle(), authorize, &guard), "authorizer");
}

std::vector<std::string> SqlSession::Impl::table_names() const {
  std::vector<std::string> names = all_table_names();
  names.insert(names.end(), {"field", "code"});
  return names;
}

/// " at 'fro status'": where in the statement the error is, when SQLite knows.
std::string SqlSession::Impl::place(const std::string& sql) const {
  constexpr std::size_t kShown = 24;
  const int at = sqlite3_error_offset(connection.handle());
  if (at < 0 || static_cast<std::size_t>(at) >= sql.size()) {
    return {};
  }
  const std::string rest = sql.substr(static_cast<std::size_t>(at));
  return " at '" + rest.substr(0, kShown) + (rest.size() > kShown ? "...'" : "'");
}

bool SqlSession::Impl::is_statement(const char* sql) const {
  sqlite3_stmt* raw = nullptr;
  const int code = sqlite3_prepare_v2(connection.handle(), sql, -1, &raw, nullptr);
  const std::unique_ptr<sqlite3_stmt, FinalizeStatement> statement(raw);
  return code != SQLITE_OK || raw != nullptr;
}

void SqlSession::Impl::fail(const std::string& sql) const {
  const std::string cause = sqlite3_errmsg(connection.handle());
  if (!guard.refused.empty()) {
    throw StatementError("sql: " + guard.refused, "a log is only read", "write a SELECT");
  }
  if (cause.ends_with("may not be modified")) {
    throw StatementError("sql", cause, "a log is only read: write a SELECT");
  }
  if (const std::string table = after(cause, "no such table: "); !table.empty()) {
    throw StatementError("sql: " + table, "no such table" + did_you_mean(without_table(table), table_names()),
                         "tables: " + joined(table_names()));
  }
  if (const std::string column = after(cause, "no such column: "); !column.empty()) {
    throw StatementError(
        "sql: " + column, "no such column" + did_you_mean(without_table(column), all_column_names()),
        "`select name, meaning from field` lists the fields, `pragma table_xinfo(status)` the columns");
  }
  throw StatementError("sql", cause + place(sql), "the statement is one SELECT in the language of SQLite");
}

void SqlSession::Impl::run(const std::string& sql, const Head& head, const Row& row) {
  sqlite3_stmt* raw = nullptr;
  const char* rest = nullptr;
  const int code = sqlite3_prepare_v2(connection.handle(), sql.c_str(), static_cast<int>(sql.size()), &raw, &rest);
  const std::unique_ptr<sqlite3_stmt, FinalizeStatement> statement(raw);
  if (code != SQLITE_OK) {
    fail(sql);
  }
  if (raw == nullptr) {
    throw StatementError("sql", "there is no statement", "for example: select robot, count(*) from status group by 1");
  }
  if (is_statement(rest)) {
    throw StatementError("sql", "more than one statement", "give one SELECT");
  }
  if (sqlite3_bind_parameter_count(raw) > 0) {
    throw StatementError("sql: ?", "nothing gives a value for a parameter", "write the value itself");
  }
  const int columns = sqlite3_column_count(raw);
  std::vector<std::string> names;
  for (int i = 0; i < columns; ++i) {
    names.emplace_back(sqlite3_column_name(raw, i));
  }
  head(names);
  std::vector<SqlValue> values(names.size());
  int step = SQLITE_ROW;
  while ((step = sqlite3_step(raw)) == SQLITE_ROW) {
    for (int i = 0; i < columns; ++i) {
      values[static_cast<std::size_t>(i)] = value_at(raw, i);
    }
    row(values);
  }
  if (step != SQLITE_DONE) {
    fail(sql);
  }
}

SqlSession::SqlSession(RowSource& log) : log_(&log) {
  static const bool kFetched = (fetch_api(), true);
  static_cast<void>(kFetched);
  impl_ = std::make_unique<Impl>(log);
}

SqlSession::~SqlSession() = default;

void SqlSession::run(const std::string& sql, const Head& head, const Row& row) {
  try {
    impl_->run(sql, head, row);
  } catch (const StatementError&) {
    // A refused statement can make SQLite forget its tables; to declare them again it would need what the guard denies.
    impl_ = std::make_unique<Impl>(*log_);
    throw;
  }
}

}  // namespace tacho::store::sql
