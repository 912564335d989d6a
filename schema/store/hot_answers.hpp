#pragma once
// The hot answers of a query, in order of arrival.

#include <cstddef>
#include <cstdint>
#include <map>
#include <vector>

#include "schema/store/answer_query.hpp"
#include "schema/store/hot_scan.hpp"
#include "schema/store/part_head.hpp"

namespace tacho::store {

/// Rows of several streams overlap: an answer is handed out once no unread row can have one that arrived before it.
/// Memory: the bodies of one row per source.
class HotAnswers {
 public:
  /// Counts every answer of every robot in `met`. The arguments must outlive this.
  HotAnswers(Connection& connection, const PartHead& head, const AnswerQuery& query, StreamCounts& met,
             const Report& report);
  HotAnswers(const HotAnswers&) = delete;
  HotAnswers& operator=(const HotAnswers&) = delete;
  /// Place of the next answer among all of the part; 0 at the end.
  [[nodiscard]] std::int64_t row() const { return next_ == nullptr ? 0 : next_->mark().place; }
  /// Valid until the next call.
  const Answer& take();

 private:
  /// Runs of answers that could not be decompressed, one report per run and stream.
  class BrokenRuns {
   public:
    explicit BrokenRuns(const Report& report) : report_(&report) {}
    void bad(const HotRow& row, Source source, std::uint64_t seq);
    void good(Source source) { tell(source, runs_[source]); }
    void finish();

   private:
    struct Run {
      RobotId robot = 0;
      SessionId session = 0;
      std::uint64_t from = 0;
      std::uint64_t to = 0;
      std::uint64_t count = 0;
    };
    const Report* report_;
    std::map<Source, Run> runs_;
    void tell(Source source, Run& run) const;
  };
  /// A row that is being handed out.
  struct Open {
    AnswerMeta meta;  ///< of all its answers
    HotBatch batch;
    std::size_t next = 0;
    [[nodiscard]] bool done() const { return next == batch.marks.size(); }
    [[nodiscard]] const HotMark& mark() const { return batch.marks[next]; }
  };

  const AnswerQuery* query_;
  StreamCounts* met_;
  const Vocabulary* vocabulary_;
  HotScan scan_;
  BodyChain chain_;
  BrokenRuns broken_;
  const HotRow* unread_;  ///< null: none
  std::vector<Open> open_;
  Open* next_ = nullptr;  ///< whose turn it is
  Answer answer_;

  void advance();
  void open(const HotRow& row, Source source);
  void skip_outside(Open& open) const;
};

}  // namespace tacho::store
