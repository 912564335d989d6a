#pragma once
// The seal of a closed part: how many rows each small table has, and a checksum over those tables whose rows have none.
// A part that is written on has no seal.

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "schema/store/sqlite.hpp"

namespace tacho::store {

/// Table name -> rows. Empty when the part is not sealed.
using SealedRows = std::map<std::string, std::int64_t, std::less<>>;

/// Seals what is in the tables now, and returns the rows of the seal. The transaction belongs to the caller.
SealedRows write_seal(Connection& connection);
/// To be called before a sealed part is written again, in the same transaction at the latest.
void break_seal(Connection& connection);

struct Seal {
  SealedRows rows;
  std::vector<std::string> damage;             ///< in words; tables that are not as they were sealed
  std::set<std::string, std::less<>> damaged;  ///< the same tables by name
};
/// Compares the tables that have a checksum here; the rows of gap, event, clock and rollup are counted where they are
/// read. `closed`: a part without a seal is damaged, unless it is
/// older than seals. `whole`: also columns that opening
/// a log does not need.
Seal check_seal(Connection& connection, bool closed, bool whole);

}  // namespace tacho::store
