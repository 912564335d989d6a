#include "schema/store/seal.hpp"

#include <fmt/format.h>

#include <array>
#include <bit>
#include <string_view>

#include "schema/store/checksum.hpp"
#include "schema/store/schema_sql.hpp"

namespace tacho::store {

namespace {

/// Rows that have no checksum of their own.
constexpr std::array<std::string_view, 8> kHeadTables{"part",  "robot", "session",  "stream",
                                                      "field", "code",  "coverage", "unknown_key"};
/// Rows that have one: only their number is sealed.
constexpr std::array<std::string_view, 3> kRecordTables{"gap", "event", "clock"};

struct Sum {
  std::int64_t rows = 0;
  std::int64_t crc = 0;
};

Sum sum_of(Connection& connection, std::string_view table) {
  Sum sum;
  Checksum checksum;
  Statement row(connection, select_sql(table));
  while (row.step()) {
    ++sum.rows;
    for (int column = 0; column < row.columns(); ++column) {
      checksum.add(row.null(column) ? 0 : 1);
      if (row.floating(column)) {
        checksum.add(std::bit_cast<std::int64_t>(row.real(column)));
      } else {
        checksum.add(row.bytes(column));
      }
    }
  }
  sum.crc = checksum.value();
  return sum;
}

/// Parts from before seals have no such table.
bool can_be_sealed(Connection& connection) {
  return connection.integer("SELECT count(*) FROM sqlite_schema WHERE name = 'seal'") > 0;
}

std::string compare(Connection& connection, std::string_view table, const Sum& sealed) {
  try {
    const Sum now = sum_of(connection, table);
    if (now.rows == sealed.rows && now.crc == sealed.crc) {
      return "";
    }
    return fmt::format("table {} is not as it was when the part was closed", table);
  } catch (const SqliteError& error) {
    return fmt::format("table {} cannot be read: {}", table, error.what());
  }
}

}  // namespace

void write_seal(Connection& connection) {
  if (!can_be_sealed(connection)) {
    return;
  }
  Statement insert(connection, insert_sql("seal", "OR REPLACE"));
  for (const std::string_view table : kHeadTables) {
    const Sum sum = sum_of(connection, table);
    insert.run(table, sum.rows, sum.crc);
  }
  for (const std::string_view table : kRecordTables) {
    insert.run(table, connection.integer(fmt::format("SELECT count(*) FROM {}", table)), std::nullopt);
  }
}

void break_seal(Connection& connection) {
  if (can_be_sealed(connection)) {
    connection.exec("DELETE FROM seal");
  }
}

Seal check_seal(Connection& connection, bool closed) {
  Seal seal;
  if (!can_be_sealed(connection)) {
    return seal;
  }
  std::map<std::string, Sum, std::less<>> sealed;
  try {
    Statement row(connection, select_sql("seal"));
    while (row.step()) {
      sealed[row.text(0)] = {row.integer(1), row.integer(2)};
      seal.rows[row.text(0)] = row.integer(1);
    }
  } catch (const SqliteError& error) {
    seal.damage.push_back(fmt::format("table seal cannot be read: {}", error.what()));
    return seal;
  }
  if (!closed && sealed.empty()) {
    return seal;
  }
  for (const std::string_view table : kHeadTables) {
    const auto known = sealed.find(table);
    const std::string wrong = known == sealed.end() ? fmt::format("the seal of table {} is missing", table)
                                                    : compare(connection, table, known->second);
    if (!wrong.empty()) {
      seal.damage.push_back(wrong);
      seal.damaged.emplace(table);
    }
  }
  for (const std::string_view table : kRecordTables) {
    if (sealed.find(table) == sealed.end()) {
      seal.damage.push_back(fmt::format("the seal of table {} is missing", table));
      seal.damaged.emplace(table);
    }
  }
  return seal;
}

}  // namespace tacho::store
