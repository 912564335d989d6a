#pragma once
// Robots, sessions, streams and coverage of a part whose rows were found in the pages of a damaged one (scavenge.hpp):
// kept where the seal fits, asked of other parts, or made from the rows.

#include <filesystem>
#include <map>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "schema/store/coverage.hpp"
#include "schema/store/part.hpp"
#include "schema/store/rows.hpp"

namespace tacho::store {

/// What the whole parts of a log say.
struct KnownLog {
  std::string log;  ///< its identity; empty when there is no such part
  std::map<RobotId, Robot> robots;
  std::map<SessionId, Session> sessions;
  std::map<StreamKey, StreamRow> streams;
};
/// Files that are no part, or a damaged one, say nothing.
KnownLog ask(std::span<const std::filesystem::path> parts);

struct Mending {
  bool made_up = false;            ///< something was missing
  std::vector<std::string> notes;  ///< what nobody knew
};
/// Rewrites the tables from what stands in them, `known`, and the rows of hot, block, gap, event and clock. `damaged`:
/// tables that are not as they were sealed. Writes the one row of part, too. The transaction belongs to the caller.
Mending mend_small_tables(Connection& out, PartRow part, const KnownLog& known,
                          const std::set<std::string, std::less<>>& damaged);

}  // namespace tacho::store
