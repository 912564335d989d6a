#pragma once
// The hot answers of a query, in order of arrival.

#include <cstdint>
#include <map>

#include "schema/store/answer_query.hpp"
#include "schema/store/hot_scan.hpp"
#include "schema/store/part_head.hpp"

namespace tacho::store {

class HotAnswers {
 public:
  /// Counts every row of every robot in `met`. The arguments must outlive this.
  HotAnswers(Connection& connection, const PartHead& head, const AnswerQuery& query, StreamCounts& met,
             const Report& report);
  /// Place of the next answer among all of the part; 0 at the end.
  [[nodiscard]] std::int64_t row() const { return row_; }
  /// Valid until the next call.
  const Answer& take();

 private:
  /// Runs of answers that could not be decompressed, one report per run and stream.
  class BrokenRuns {
   public:
    explicit BrokenRuns(const Report& report) : report_(&report) {}
    void bad(const AnswerMeta& meta);
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

  const AnswerQuery* query_;
  StreamCounts* met_;
  HotScan scan_;
  BodyChain chain_;
  BrokenRuns broken_;
  std::int64_t row_ = 0;
  Answer answer_;
  Answer next_;

  void advance();
};

}  // namespace tacho::store
