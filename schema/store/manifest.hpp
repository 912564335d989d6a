#pragma once
// The manifest of a part: of each robot, source and hour how many answers there are and the sum of their hashes. It is
// made of the answers as they came, before they go into blocks, and stored with the blocks: so it tells whether what is
// read is what was received, by whatever program it is read, and two logs can be compared hour by hour.

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <tuple>

#include "schema/sample.hpp"
#include "schema/store/part_head.hpp"
#include "schema/store/sqlite.hpp"

namespace tacho::store {

/// Rows and the sum of their hashes, which does not depend on their order.
struct RowSum {
  std::uint64_t rows = 0;
  std::uint64_t hash = 0;  ///< modulo 2^64
  void add(std::uint64_t row) {
    ++rows;
    hash += row;
  }
  void add(const RowSum& more) {
    rows += more.rows;
    hash += more.hash;
  }
  void remove(std::uint64_t row) {
    --rows;
    hash -= row;
  }
  friend bool operator==(const RowSum&, const RowSum&) = default;
};

/// By start of the UTC hour of t_send_us.
using ManifestKey = std::tuple<RobotId, Source, Micros>;
using Manifest = std::map<ManifestKey, RowSum>;

ManifestKey manifest_key(const AnswerMeta& meta);
/// FNV-1a, 64 bit, over source (1 byte), session (4), seq (8), t_send_us (8), t_recv_us (8), length of the header (4),
/// header, body; numbers with the low byte first. The robot is not in it: its number is a matter of the log.
std::uint64_t row_hash(const Answer& answer);

/// Adds to the rows that are there: an hour may have begun in an earlier block. Rows that are damaged stay as they are,
/// so that whoever reads them is told. Inside the open transaction.
void write_manifest(Connection& connection, const Manifest& manifest);
/// All of a part; of one that is not closed, what is in blocks. Empty for parts from before manifests. `report` is told
/// of damage, in words. Throws SqliteError.
Manifest read_manifest(Connection& connection, const PartHead& head,
                       const std::function<void(const std::string&)>& report);

}  // namespace tacho::store
