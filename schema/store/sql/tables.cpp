#include "schema/store/sql/tables.hpp"

#include <algorithm>
#include <exception>
#include <string_view>
#include <utility>

#include "schema/error.hpp"
#include "schema/store/schema_sql.hpp"
#include "schema/store/sql/record_table.hpp"
#include "schema/store/sql/row_columns.hpp"
#include "schema/store/sql/row_table.hpp"
#include "schema/store/sql/sqlite_api.hpp"
#include "schema/store/sql/time_text.hpp"

SQLITE_EXTENSION_INIT1

namespace tacho::store::sql {

namespace {

int compare_times(void*, int length_a, const void* a, int length_b, const void* b) {
  const auto key = [](const void* text, int length) {
    return time_key({static_cast<const char*>(text), static_cast<std::size_t>(length)});
  };
  return key(a, length_a).compare(key(b, length_b));
}

void check(sqlite3* connection, int code, const std::string& what) {
  if (code != SQLITE_OK) {
    throw Error(what, sqlite3_errmsg(connection), "is another version of this extension loaded already?");
  }
}

std::int64_t application_id(sqlite3* connection) {
  sqlite3_stmt* statement = nullptr;
  std::int64_t id = 0;
  if (sqlite3_prepare_v2(connection, "PRAGMA main.application_id", -1, &statement, nullptr) == SQLITE_OK &&
      sqlite3_step(statement) == SQLITE_ROW) {
    id = sqlite3_column_int64(statement, 0);
  }
  sqlite3_finalize(statement);
  return id;
}

}  // namespace

void use_api(const sqlite3_api_routines* api) { sqlite3_api = api; }

const std::vector<std::string>& row_table_names() {
  static const std::vector<std::string> kNames = [] {
    std::vector<std::string> names;
    for (std::size_t s = 0; s < kSourceCount; ++s) {
      names.emplace_back(source_name(static_cast<Source>(s)));
    }
    return names;
  }();
  return kNames;
}

std::vector<std::string> all_table_names() {
  std::vector<std::string> names = row_table_names();
  names.insert(names.end(), record_table_names().begin(), record_table_names().end());
  return names;
}

std::vector<std::string> all_column_names() {
  std::vector<std::string> names;
  for (std::size_t s = 0; s < kSourceCount; ++s) {
    for (const RowColumn& column : row_columns(static_cast<Source>(s))) {
      names.push_back(column.name);
    }
  }
  for (const std::string& table : record_table_names()) {
    const std::vector<std::string> more = record_column_names(table);
    names.insert(names.end(), more.begin(), more.end());
  }
  std::sort(names.begin(), names.end());
  names.erase(std::unique(names.begin(), names.end()), names.end());
  return names;
}

void register_modules(sqlite3* connection, OpenLog open, std::shared_ptr<SharedLog> standard) {
  const auto shelf = std::make_shared<LogShelf>(std::move(open), std::move(standard));
  check(connection,
        sqlite3_create_collation_v2(connection, kTimeCollation, SQLITE_UTF8, nullptr, compare_times, nullptr),
        kTimeCollation);
  for (std::size_t s = 0; s < kSourceCount; ++s) {
    const std::string name = "tacho_" + row_table_names()[s];
    const int code = add_module(connection, name, [shelf, s](const std::vector<std::string>& paths) {
      return make_row_table(static_cast<Source>(s), shelf->at(paths));
    });
    check(connection, code, name);
  }
  for (const std::string& table : record_table_names()) {
    const int code = add_module(connection, "tacho_" + table, [shelf, table](const std::vector<std::string>& paths) {
      return make_record_table(table, shelf->at(paths));
    });
    check(connection, code, "tacho_" + table);
  }
}

int load_extension(sqlite3* connection, char** message, const sqlite3_api_routines* api, OpenLog open) {
  use_api(api);
  try {
    std::shared_ptr<SharedLog> standard;
    const char* file = sqlite3_db_filename(connection, "main");
    const bool part = file != nullptr && *file != '\0' && application_id(connection) == kApplicationId;
    if (part) {
      standard = std::make_shared<SharedLog>(open, std::vector<std::filesystem::path>{file});
    }
    register_modules(connection, std::move(open), std::move(standard));
    for (const std::string& name : part ? row_table_names() : std::vector<std::string>()) {
      const std::string sql = "CREATE VIRTUAL TABLE IF NOT EXISTS temp." + name + " USING tacho_" + name;
      check(connection, sqlite3_exec(connection, sql.c_str(), nullptr, nullptr, nullptr), name);
    }
    return SQLITE_OK;
  } catch (const std::exception& error) {
    *message = sqlite3_mprintf("%s", error.what());
    return SQLITE_ERROR;
  }
}

}  // namespace tacho::store::sql
