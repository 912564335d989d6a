#pragma once
// Answers, gaps, events and clock points of one robot in one part.

#include <array>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "schema/row_source.hpp"
#include "schema/store/answer_query.hpp"
#include "schema/store/column_scan.hpp"
#include "schema/store/manifest.hpp"
#include "schema/store/part_head.hpp"
#include "schema/store/rollup.hpp"
#include "schema/store/sqlite.hpp"

namespace tacho::store {

class PartReader {
 public:
  /// `head` must outlive the reader. Throws SqliteError.
  PartReader(const PartHead& head, Report report, Access access = Access::careful);

  /// Everything is read inside one of these: rows move into blocks while a log is recorded.
  class Transaction {
   public:
    explicit Transaction(PartReader& reader);
    ~Transaction();
    Transaction(const Transaction&) = delete;
    Transaction& operator=(const Transaction&) = delete;

   private:
    PartReader* reader_;
  };

  /// Yields the answers of the robot from all tiers of the part, in order of arrival. Bodies outside the window are not
  /// decompressed, but for those since the last keyframe before it. This is the one place that knows the tiers.
  void answers(const AnswerQuery& query, const std::function<void(const Answer&)>& yield);
  /// The same answers as columns: hands `use` a scan, which must read it to its end.
  void columns(ColumnQuery& query, const std::function<void(ColumnScan&)>& use);

  /// False: columns() and answers() have nothing to give.
  [[nodiscard]] static bool has_answers(const PartHead& head, const AnswerQuery& query);
  /// False: no gap, event or clock point of the part is inside the window. Looks once, and only where the answer stays.
  bool touches(Window window);
  /// What the window touches; by session and time.
  std::vector<Gap> gaps(RobotId robot, Window window);
  std::vector<Event> events(RobotId robot, Window window);
  /// Also points that belong to no robot.
  std::vector<ClockPoint> clock(RobotId robot, Window window);
  /// By source, minute and field.
  std::vector<Rollup> rollups(RobotId robot) { return read_rollups(connection_, *head_, robot, report_); }
  Manifest manifest() { return read_manifest(connection_, *head_, report_); }

 private:
  const PartHead* head_;
  Report report_;
  Connection connection_;
  std::optional<BlockList> blocks_;  ///< of this transaction; of a closed part for good
  std::optional<Window> records_;    ///< times of all gaps, events and clock points, once known

  const BlockList& blocks();
  template <class Read>
  void counted(const AnswerQuery& query, Read read);
  void tell_missing(RobotId robot, const StreamCounts& met) const;
  template <class Row, class Read, class Keep>
  std::vector<Row> records(const char* table, std::int64_t last_id, Read read, Keep keep);
};

/// read_head(), with the counts of a damaged part as what can really be read. What was seen and valued, and which
/// answers were undecodable, stays as the writer noted it.
PartHead read_part(const std::filesystem::path& path, Access access = Access::careful);

}  // namespace tacho::store
