#pragma once
// The head of a closed part as one row with a checksum, written when it is closed: opening a log reads a page or two of
// each part and no SQL, whose schema alone takes longer to parse than all else (README.md).
//
// It repeats the small tables for those who do not look for damage; careful readers compare the two. Enums and fields
// are numbers of this program: a part whose names are numbered differently has no use for it and is read by its tables.

#include <filesystem>
#include <optional>

#include "schema/store/part_head.hpp"

namespace tacho::store {

/// Of a part that has just been sealed. The transaction belongs to the caller.
void write_summary(Connection& connection, SealedRows sealed);
/// To be called before the part is written again, in the same transaction at the latest.
void delete_summary(Connection& connection);

/// Empty: the part is not closed, cut short, of other names, or its summary is damaged. The tables know then.
std::optional<PartHead> read_summary(const std::filesystem::path& path);

/// Damage in words: there is a summary, and it says something else than `head`, which was read from the tables. "":
/// none.
std::string check_summary(Connection& connection, const PartHead& head);

}  // namespace tacho::store
