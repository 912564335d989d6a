#pragma once
// A damaged part -> a part of the same rows that can be read. For parts whose b-trees, header or small tables are
// damaged: rows are looked for in the pages (page_scan.hpp) and taken where their checksums fit.
//
// Rows of hot, block, gap, event and clock have checksums of their own. Those of robot, session, stream and part are
// compared with the seal; where that does not fit, or they are gone, the other parts of the log are asked, then the
// rows themselves (numbers of sessions, robots and polls), and what nobody knows gets a name that says so.

#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace tacho::store {

/// The file has the name of a part, or looks like one inside; one that cannot be read is then damaged, not foreign.
bool may_be_part(const std::filesystem::path& path);

struct Scavenged {
  std::filesystem::path part;      ///< not closed, for reading only; empty: the file holds nothing of this log
  bool whole = false;              ///< all but answers: proved by the seal to be what it was
  std::vector<std::string> notes;  ///< what was made up or taken on trust, in words
};

/// Reads `damaged`, never writes it; its WAL too. The new part is made in `folder`, which must exist and takes up to
/// twice the size of the part. `others`: whole parts of the same log. Memory: that of one block. Throws Error.
Scavenged scavenge(const std::filesystem::path& damaged, std::span<const std::filesystem::path> others,
                   const std::filesystem::path& folder);

}  // namespace tacho::store
