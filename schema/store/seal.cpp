#include "schema/store/seal.hpp"

#include <fmt/format.h>

#include <array>
#include <bit>
#include <string_view>

#include "schema/store/checksum.hpp"
#include "schema/store/schema_sql.hpp"

namespace tacho::store {

namespace {

/// Tables whose rows have no checksum of their own. The same large references are in every part, and opening a log
/// needs little of them: what it needs is sealed once more, for those who do not look for damage.
struct HeadTable {
  std::string_view name;
  std::string_view needed;       ///< columns; empty: all
  std::string_view needed_seal;  ///< name of their seal
};
constexpr std::array<HeadTable, 8> kHeadTables{{{"part", "", ""},
                                                {"robot", "", ""},
                                                {"session", "", ""},
                                                {"stream", "", ""},
                                                {"field", "id, name", "field names"},
                                                {"code", "list, value, name", "code names"},
                                                {"coverage", "", ""},
                                                {"unknown_key", "", ""}}};
/// Rows that have one: only their number is sealed.
constexpr std::array<std::string_view, 5> kRecordTables{"gap", "event", "clock", "rollup", "manifest"};

struct Sum {
  std::int64_t rows = 0;
  std::int64_t crc = 0;
};

Sum sum_of(Connection& connection, const std::string& select) {
  Sum sum;
  Checksum checksum;
  Statement row(connection, select);
  while (row.step()) {
    ++sum.rows;
    for (int column = 0; column < row.columns(); ++column) {
      if (row.whole(column)) {
        checksum.add(row.integer(column));
      } else if (row.floating(column)) {
        checksum.add(std::bit_cast<std::int64_t>(row.real(column)));
      } else {
        checksum.add(row.null(column) ? 0 : 1);
        checksum.add(row.bytes(column));
      }
    }
  }
  sum.crc = checksum.value();
  return sum;
}

std::string select_needed(const HeadTable& table) { return fmt::format("SELECT {} FROM {}", table.needed, table.name); }

std::string compare(Connection& connection, std::string_view table, const std::string& select, const Sum& sealed) {
  try {
    const Sum now = sum_of(connection, select);
    if (now.rows == sealed.rows && now.crc == sealed.crc) {
      return "";
    }
    return fmt::format("table {} is not as it was when the part was closed", table);
  } catch (const SqliteError& error) {
    return fmt::format("table {} cannot be read: {}", table, error.what());
  }
}

}  // namespace

void seal_vocabulary(Connection& connection) {
  Statement insert(connection, insert_sql("seal", "OR REPLACE"));
  for (const HeadTable& table : kHeadTables) {
    if (!table.needed.empty()) {
      const Sum all = sum_of(connection, select_sql(table.name));
      const Sum needed = sum_of(connection, select_needed(table));
      insert.run(table.name, all.rows, all.crc);
      insert.run(table.needed_seal, needed.rows, needed.crc);
    }
  }
}

void seal_head(Connection& connection) {
  if (!connection.has_table("seal")) {
    return;
  }
  Statement insert(connection, insert_sql("seal", "OR REPLACE"));
  for (const HeadTable& table : kHeadTables) {
    if (table.needed.empty()) {
      const Sum sum = sum_of(connection, select_sql(table.name));
      insert.run(table.name, sum.rows, sum.crc);
    }
  }
}

SealedRows write_seal(Connection& connection) {
  SealedRows rows;
  if (!connection.has_table("seal")) {
    return rows;
  }
  seal_head(connection);
  {
    Statement insert(connection, insert_sql("seal", "OR REPLACE"));
    for (const std::string_view table : kRecordTables) {
      if (!connection.has_table(table)) {
        continue;
      }
      insert.run(table, connection.integer(fmt::format("SELECT count(*) FROM {}", table)), std::nullopt);
    }
  }
  Statement row(connection, select_sql("seal"));
  while (row.step()) {
    rows[row.text(0)] = row.integer(1);
  }
  return rows;
}

void break_seal(Connection& connection) {
  if (!connection.has_table("seal")) {
    return;
  }
  Statement drop(connection, "DELETE FROM seal WHERE name = ?1");
  for (const std::string_view table : kRecordTables) {
    drop.run(table);
  }
  seal_head(connection);
}

Seal check_seal(Connection& connection, bool closed, bool whole) {
  Seal seal;
  if (!connection.has_table("seal")) {
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
  for (const HeadTable& table : kHeadTables) {
    const bool part = !whole && !table.needed.empty();
    const auto known = sealed.find(part ? table.needed_seal : table.name);
    const std::string select = part ? select_needed(table) : select_sql(table.name);
    const std::string wrong = known == sealed.end() ? fmt::format("the seal of table {} is missing", table.name)
                                                    : compare(connection, table.name, select, known->second);
    if (!wrong.empty()) {
      seal.damage.push_back(wrong);
      seal.damaged.emplace(table.name);
    }
  }
  for (const std::string_view table : kRecordTables) {
    if (closed && sealed.find(table) == sealed.end() && connection.has_table(table)) {
      seal.damage.push_back(fmt::format("the seal of table {} is missing", table));
      seal.damaged.emplace(table);
    }
  }
  return seal;
}

}  // namespace tacho::store
