#pragma once
// SQLite as virtual tables must call it: through the table of functions that the host hands to an extension. In a
// program of our own the same table is fetched once (sql_session.cpp), so that both run the same code.
//
// Included by the virtual tables only; everything else uses store/sqlite.hpp.

#include <sqlite3ext.h>

// NOLINTNEXTLINE: the name is SQLite's; all calls in files that include this go through it.
SQLITE_EXTENSION_INIT3
