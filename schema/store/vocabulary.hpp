#pragma once
// Names that stand in a log instead of enum numbers, and the `field` and `code` tables that explain them.

#include <array>
#include <optional>
#include <string_view>
#include <vector>

#include "schema/records.hpp"
#include "schema/store/sqlite.hpp"

namespace tacho::store {

std::optional<Cause> parse_cause(std::string_view name);
std::optional<EventKind> parse_event_kind(std::string_view name);

/// Fills the `field` and `code` tables of a new part.
void write_vocabulary(Connection& connection);

/// What the numbers of one part mean to this program. Numbers may differ between versions, names do not.
struct Vocabulary {
  std::array<std::optional<Source>, 256> source;  ///< by hot.source
  std::vector<FieldIndex> field;                  ///< by field.id; kNoField when this program does not know the name
  friend bool operator==(const Vocabulary&, const Vocabulary&) = default;
};
Vocabulary read_vocabulary(Connection& connection);
/// Of a part that this program makes.
const Vocabulary& own_vocabulary();
/// A checksum of the names of fields, sources, causes and word orders of this program, in the order of their numbers.
std::int64_t own_names();

/// coverage.seen and coverage.valued of this program's field table, and back.
std::string pack_fields(const FieldSet& fields);
FieldSet unpack_fields(std::string_view bits, const Vocabulary& vocabulary);

}  // namespace tacho::store
