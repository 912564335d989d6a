#pragma once
// One-minute rollups: what fields did, minute by minute, for plots over months that need no answer to be opened. They
// are made of the answers that move into a block, in the transaction that moves them: an answer is in its block and in
// its rollups, or in neither. Answers that are still hot are in none.

#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "schema/records.hpp"
#include "schema/store/decode.hpp"
#include "schema/store/part_head.hpp"
#include "schema/store/sqlite.hpp"

namespace tacho::store {

/// What is rolled up: quantities that are plotted over months.
const FieldSet& rollup_fields();

/// Of one source of one robot, by minute and field.
using RollupRows = std::map<std::pair<std::int64_t, FieldIndex>, Rollup>;

/// Adds one decoded answer. Only the fields in `wanted` are looked at.
void add_to(RollupRows& rows, const AnswerMeta& meta, const Sample& sample, const FieldSet& wanted);

struct Rollups {
  Source source = Source::status;
  RollupRows rows;

  /// Adds to the rows that are there: a minute may have begun in an earlier block. Rows that are damaged stay as they
  /// are, so that whoever reads them is told.
  void write(Connection& connection) const;
};

/// Sums up answers of one stream. One thread; `decode` must outlive it.
class RollupMaker {
 public:
  /// Only the fields in `wanted` are looked at.
  RollupMaker(const Decode& decode, const Stream& stream, const FieldSet& wanted)
      : decode_(&decode), stream_(stream), wanted_(wanted) {}

  void add(const Answer& answer);
  /// What was added so far.
  [[nodiscard]] Rollups take() { return {stream_.source, std::move(rows_)}; }

 private:
  const Decode* decode_;
  Stream stream_;
  FieldSet wanted_;
  Gates gates_;
  Sample sample_;
  RollupRows rows_;
};

/// The fields of rollup_fields() that a stream of this part is rolled up for: all of status, of other sources what
/// status has not given so far.
FieldSet rollup_fields(Connection& connection, const Stream& stream);

/// All of a robot in a part, by source, minute and field. `report` is told of damage, in words. Throws SqliteError.
std::vector<Rollup> read_rollups(Connection& connection, const PartHead& head, RobotId robot,
                                 const std::function<void(const std::string&)>& report);

}  // namespace tacho::store
