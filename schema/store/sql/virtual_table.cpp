#include "schema/store/sql/virtual_table.hpp"

#include <exception>
#include <utility>

namespace tacho::store::sql {

namespace {

struct OpenTable {
  sqlite3_vtab base{};  // first: SQLite knows this part only
  std::unique_ptr<Table> table;
};

struct OpenCursor {
  sqlite3_vtab_cursor base{};
  std::unique_ptr<TableCursor> cursor;
};

// Both structs begin with their base, so the pointers are interchangeable; SQLite's way to derive.
OpenTable& table_of(sqlite3_vtab* base) { return *reinterpret_cast<OpenTable*>(base); }
OpenCursor& cursor_of(sqlite3_vtab_cursor* base) { return *reinterpret_cast<OpenCursor*>(base); }

/// Runs `work`; what it throws becomes `*message`, which SQLite frees.
template <class Work>
int guarded(char** message, Work work) {
  const char* what = "not a standard exception";
  try {
    work();
    return SQLITE_OK;
  } catch (const std::bad_alloc&) {
    return SQLITE_NOMEM;
  } catch (const std::exception& error) {
    sqlite3_free(*message);
    *message = sqlite3_mprintf("%s", error.what());
    return SQLITE_ERROR;
  } catch (...) {
    sqlite3_free(*message);
    *message = sqlite3_mprintf("%s", what);
    return SQLITE_ERROR;
  }
}

/// An argument as SQLite hands it over is the text between the commas: 'quoted', "quoted" or bare.
std::string unquoted(std::string_view argument) {
  const std::size_t first = argument.find_first_not_of(" \t\n");
  if (first == std::string_view::npos) {
    return {};
  }
  argument = argument.substr(first, argument.find_last_not_of(" \t\n") - first + 1);
  const char quote = argument.front();
  if ((quote != '\'' && quote != '"') || argument.size() < 2 || argument.back() != quote) {
    return std::string(argument);
  }
  std::string out;
  for (std::size_t i = 1; i + 1 < argument.size(); ++i) {
    out += argument[i];
    i += argument[i] == quote ? 1U : 0U;  // a doubled quote is one
  }
  return out;
}

int connect(sqlite3* connection, void* make, int count, const char* const* words, sqlite3_vtab** out, char** message) {
  return guarded(message, [&] {
    constexpr int kNames = 3;  // module, database, table
    std::vector<std::string> arguments;
    for (int i = kNames; i < count; ++i) {
      arguments.push_back(unquoted(words[i]));
    }
    auto open = std::make_unique<OpenTable>();
    open->table = (*static_cast<MakeTable*>(make))(arguments);
    if (sqlite3_declare_vtab(connection, open->table->declaration().c_str()) != SQLITE_OK) {
      throw std::runtime_error(sqlite3_errmsg(connection));
    }
    *out = &open.release()->base;
  });
}

int disconnect(sqlite3_vtab* base) {
  delete &table_of(base);
  return SQLITE_OK;
}

int best_index(sqlite3_vtab* base, sqlite3_index_info* info) {
  return guarded(&base->zErrMsg, [&] {
    const std::string plan = table_of(base).table->plan(*info);
    info->idxStr = sqlite3_mprintf("%s", plan.c_str());
    info->needToFreeIdxStr = 1;
    if (info->idxStr == nullptr) {
      throw std::bad_alloc();
    }
  });
}

int open_cursor(sqlite3_vtab* base, sqlite3_vtab_cursor** out) {
  return guarded(&base->zErrMsg, [&] {
    auto open = std::make_unique<OpenCursor>();
    open->cursor = table_of(base).table->open();
    *out = &open.release()->base;
  });
}

int close_cursor(sqlite3_vtab_cursor* base) {
  delete &cursor_of(base);
  return SQLITE_OK;
}

int filter(sqlite3_vtab_cursor* base, int, const char* plan, int count, sqlite3_value** values) {
  return guarded(&base->pVtab->zErrMsg, [&] {
    cursor_of(base).cursor->start(plan, {values, static_cast<std::size_t>(count)});
  });
}

int next(sqlite3_vtab_cursor* base) {
  return guarded(&base->pVtab->zErrMsg, [&] { cursor_of(base).cursor->next(); });
}

int at_end(sqlite3_vtab_cursor* base) { return cursor_of(base).cursor->at_end() ? 1 : 0; }

int column(sqlite3_vtab_cursor* base, sqlite3_context* out, int index) {
  return guarded(&base->pVtab->zErrMsg, [&] { cursor_of(base).cursor->column(out, index); });
}

int row_id(sqlite3_vtab_cursor* base, sqlite3_int64* out) {
  *out = cursor_of(base).cursor->row_id();
  return SQLITE_OK;
}

sqlite3_module make_module() {
  sqlite3_module module{};
  module.iVersion = 1;
  module.xCreate = connect;
  module.xConnect = connect;
  module.xBestIndex = best_index;
  module.xDisconnect = disconnect;
  module.xDestroy = disconnect;
  module.xOpen = open_cursor;
  module.xClose = close_cursor;
  module.xFilter = filter;
  module.xNext = next;
  module.xEof = at_end;
  module.xColumn = column;
  module.xRowid = row_id;
  return module;
}

void forget(void* make) { delete static_cast<MakeTable*>(make); }

}  // namespace

int add_module(sqlite3* connection, const std::string& name, MakeTable make) {
  static const sqlite3_module kModule = make_module();
  // SQLite calls `forget` also when it refuses the module.
  return sqlite3_create_module_v2(connection, name.c_str(), &kModule, new MakeTable(std::move(make)), forget);
}

std::string_view text_of(sqlite3_value* value) {
  const auto* text = reinterpret_cast<const char*>(sqlite3_value_text(value));
  return text == nullptr ? std::string_view()
                         : std::string_view(text, static_cast<std::size_t>(sqlite3_value_bytes(value)));
}

void give(sqlite3_context* out, std::string_view text) {
  sqlite3_result_text64(out, text.data() == nullptr ? "" : text.data(), text.size(), SQLITE_TRANSIENT, SQLITE_UTF8);
}

void give(sqlite3_context* out, std::int64_t number) { sqlite3_result_int64(out, number); }
void give(sqlite3_context* out, double number) { sqlite3_result_double(out, number); }

}  // namespace tacho::store::sql
