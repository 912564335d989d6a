#pragma once
// Reads the hot rows of a part in the order of their first answers, past damage.

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "schema/store/hot_codec.hpp"
#include "schema/store/rows.hpp"
#include "schema/store/sqlite.hpp"

namespace tacho::store {

/// Steps through rows whose checksums are right. Works in short read transactions, so that a long analysis never keeps
/// a recorder from shortening its WAL.
class HotScan {
 public:
  /// Told of damage: rows between two ids (exclusive), or one row, and why.
  using Lost = std::function<void(std::int64_t after, std::int64_t before, const std::string& why)>;

  HotScan(Connection& connection, const Vocabulary& vocabulary, std::int64_t last_id, Lost lost);
  /// The next row, or null at the end. Its source is known. Valid until the next call.
  const HotRow* next();

 private:
  Connection* connection_;
  const Vocabulary* vocabulary_;
  std::int64_t end_;
  Lost lost_;
  std::optional<Statement> batch_;  ///< made when there are rows: a closed part has none
  std::optional<Statement> probe_;  ///< made for damage
  std::int64_t last_ = 0;
  std::int64_t batch_start_ = 0;
  std::int64_t tried_ = 0;
  std::int64_t reported_ = 0;
  int in_batch_ = 0;
  bool open_ = false;
  HotRow row_;

  bool advance();
  std::int64_t probe(std::int64_t from);
  std::int64_t readable_after(std::int64_t id);
  void report(std::int64_t before, const std::string& why);
  bool skip_damage(const std::string& why);
};

/// Yields the rows with id > `after` that are whole, and their answers without bodies. Throws SqliteError.
void for_each_hot_row(Connection& connection, const Vocabulary& vocabulary, std::int64_t after,
                      const std::function<void(const HotRow&, Source, const std::vector<HotMark>&)>& yield);

/// Gives the answers of rows back, following bases. Keeps the last body of each stream; fetches older rows when the
/// chain was not read from its keyframe on.
class BodyChain {
 public:
  explicit BodyChain(Connection& connection) : connection_(&connection) {}

  /// False when this row or one it is based on is damaged. `out` has the answers without their bodies then, or none
  /// when not even those can be read.
  [[nodiscard]] bool open(const HotRow& row, HotBatch& out);

 private:
  struct Last {
    std::int64_t id = 0;  ///< row whose last body this is; 0: none
    std::int64_t broken = 0;
    std::string body;
  };
  Connection* connection_;
  std::optional<Statement> fetch_;     ///< made when needed
  std::optional<HotDecoder> decoder_;  ///< likewise
  HotBatch link_;
  std::map<std::pair<RobotId, std::int64_t>, Last> streams_;

  bool walk_to(std::int64_t base, Last& last);
  bool unpack(const HotRow& row, HotBatch& out, Last& last);
};

}  // namespace tacho::store
