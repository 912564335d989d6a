#pragma once
// The seal of a part: how many rows each small table has, and a checksum over those tables whose rows have none. It is
// renewed with every transaction that changes one of them. A closed part also has the numbers of its other rows in it.

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "schema/store/sqlite.hpp"

namespace tacho::store {

/// Table name -> rows, as sealed. Those of gap, event, clock, rollup and manifest only of a closed part.
using SealedRows = std::map<std::string, std::int64_t, std::less<>>;

// Transactions belong to the caller.

/// Of a new part: the tables that never change.
void seal_vocabulary(Connection& connection);
/// After one of the other small tables has changed.
void seal_head(Connection& connection);
/// When the part is closed. Returns the whole seal.
SealedRows write_seal(Connection& connection);
/// When a closed part is written again, after that is on record in `part`.
void break_seal(Connection& connection);

struct Seal {
  SealedRows rows;
  std::vector<std::string> damage;             ///< in words; tables that are not as they were sealed
  std::set<std::string, std::less<>> damaged;  ///< the same tables by name
};
/// Compares the tables that have a checksum here; the rows of gap, event, clock, rollup and manifest are counted where
/// they are read. `closed`: a part without a seal is damaged, unless it is
/// older than seals. `whole`: also columns that opening
/// a log does not need.
Seal check_seal(Connection& connection, bool closed, bool whole);

}  // namespace tacho::store
