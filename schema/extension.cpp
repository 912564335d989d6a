// tachograph.so: the virtual tables of a log for any program that uses SQLite. The entry point has the name that SQLite
// derives from the file's.

#include "schema/log.hpp"
#include "schema/store/sql/tables.hpp"

extern "C" __attribute__((visibility("default"))) int sqlite3_tachograph_init(sqlite3* connection, char** message,
                                                                              const sqlite3_api_routines* api) {
  return tacho::store::sql::load_extension(connection, message, api, tacho::open_log);
}
