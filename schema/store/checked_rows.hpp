#pragma once
// Reading a table whose rows have checksums and whose number of rows is sealed.

#include <fmt/format.h>

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include "schema/store/schema_sql.hpp"
#include "schema/store/seal.hpp"
#include "schema/store/sqlite.hpp"

namespace tacho::store {

/// Gives every row of the table to `take`, which returns false for one that is damaged. All are read: that is how a row
/// that is gone is noticed. `report` is told of damage, in words. Throws SqliteError where it is no damage.
template <class Take>
void read_checked(Connection& connection, std::string_view table, const SealedRows& sealed,
                  const std::function<void(const std::string&)>& report, Take take) {
  std::int64_t met = 0;
  std::int64_t bad = 0;
  try {
    Statement row(connection, select_sql(table));
    for (row.query(); row.step(); ++met) {
      bad += take(row) ? 0 : 1;
    }
  } catch (const SqliteError& error) {
    if (!error.damaged()) {
      throw;
    }
    report(fmt::format("the rest of table {} cannot be read: {}", table, error.what()));
  }
  if (bad > 0) {
    report(fmt::format("{} rows of table {} are damaged and left out", bad, table));
  }
  const auto known = sealed.find(table);
  if (known != sealed.end() && known->second != met) {
    report(fmt::format("{} rows of table {} were read, but it had {}", met, table, known->second));
  }
}

}  // namespace tacho::store
