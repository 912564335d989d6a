#include "schema/store/part_reader.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "schema/store/block_scan.hpp"
#include "schema/store/hot_scan.hpp"
#include "schema/store/schema_sql.hpp"

namespace tacho::store {

namespace {

/// Runs of answers that could not be decompressed, one report per run and stream.
class BrokenRuns {
 public:
  explicit BrokenRuns(const PartReader::Report& report) : report_(&report) {}
  void bad(const AnswerMeta& meta) {
    Run& run = runs_[meta.source];
    if (run.count > 0 && run.session != meta.session) {
      tell(meta.source, run);
    }
    if (run.count == 0) {
      run = {meta.robot, meta.session, meta.seq, meta.seq, 0};
    }
    run.to = meta.seq;
    ++run.count;
  }
  void good(Source source) { tell(source, runs_[source]); }
  void finish() {
    for (auto& [source, run] : runs_) {
      tell(source, run);
    }
  }

 private:
  struct Run {
    RobotId robot = 0;
    SessionId session = 0;
    std::uint64_t from = 0;
    std::uint64_t to = 0;
    std::uint64_t count = 0;
  };
  void tell(Source source, Run& run) const {
    if (run.count > 0) {
      (*report_)(
          fmt::format("{} answers of robot {} source {} session {} (poll {} to {}) are damaged and left out; "
                      "reading goes on at the next keyframe",
                      run.count, run.robot, source_name(source), run.session, run.from, run.to));
      run.count = 0;
    }
  }
  const PartReader::Report* report_;
  std::map<Source, Run> runs_;
};

/// The hot answers of a query, in order of arrival.
class HotAnswers {
 public:
  /// Counts every row of every robot in `met`.
  HotAnswers(Connection& connection, const PartHead& head, const PartReader::Query& query, StreamCounts& met,
             const PartReader::Report& report)
      : query_(&query),
        met_(&met),
        scan_(connection, head.vocabulary, last_row(connection, head),
              [&report](std::int64_t after, std::int64_t before, const std::string& why) {
                report(fmt::format("answers between rows {} and {} are lost: {}", after, before, why));
              }),
        chain_(connection, head.vocabulary),
        broken_(report) {
    advance();
  }
  /// Place of the next answer among all of the part; 0 at the end.
  [[nodiscard]] std::int64_t row() const { return row_; }
  /// Valid until the next call.
  const Answer& take() {
    std::swap(answer_, next_);
    advance();
    return answer_;
  }

 private:
  const PartReader::Query* query_;
  StreamCounts* met_;
  HotScan scan_;
  BodyChain chain_;
  BrokenRuns broken_;
  std::int64_t row_ = 0;
  Answer answer_;
  Answer next_;

  /// The last hot row that this reader looks at. The table itself says, because rows may have moved since the head was
  /// read; where it cannot, the head knows.
  static std::int64_t last_row(Connection& connection, const PartHead& head) {
    try {
      const std::int64_t last = connection.integer("SELECT ifnull(max(id), 0) FROM hot");
      return std::min(last, head.ends.row);
    } catch (const SqliteError& error) {
      if (!error.damaged()) {
        throw;
      }
      return head.ends.row;
    }
  }

  void advance() {
    row_ = 0;
    while (const HotRow* row = scan_.next()) {
      ++(*met_)[{row->meta.session, row->meta.robot, row->meta.source}].stored;
      if (row->meta.robot != query_->robot || !query_->sources[static_cast<std::size_t>(row->meta.source)] ||
          !query_->window.contains(row->meta.t_send_us)) {
        continue;
      }
      const std::string* body = chain_.body(*row);
      if (body == nullptr) {
        broken_.bad(row->meta);
        continue;
      }
      broken_.good(row->meta.source);
      next_.meta = row->meta;
      next_.body = *body;
      next_.header = row->header;
      row_ = row->id;
      return;
    }
    broken_.finish();
  }
};

}  // namespace

PartReader::PartReader(const PartHead& head, Report report)
    : head_(&head), report_(std::move(report)), connection_(open_part_for_reading(head.path)) {
  connection_.exec("BEGIN");
}

void PartReader::answers(const Query& query, const std::function<void(const Answer&)>& yield) {
  const bool any = std::any_of(head_->counts.begin(), head_->counts.end(), [&](const auto& entry) {
    const auto& [key, count] = entry;
    return key.robot == query.robot && query.sources[static_cast<std::size_t>(key.source)] && count.stored > 0 &&
           count.last_us >= query.window.from_us && count.first_us < query.window.to_us;
  });
  if (!any && head_->damage.empty()) {
    return;
  }
  bool damaged = false;
  const Report report = [&](const std::string& what) {
    damaged = true;
    report_(what);
  };
  StreamCounts met;
  HotAnswers hot(connection_, *head_, query, met, report);
  BlockScan moved(connection_, *head_, query.robot, query.sources, query.window, met, report);
  while (hot.row() != 0 || moved.row() != 0) {
    if (moved.row() == 0 || (hot.row() != 0 && hot.row() < moved.row())) {
      yield(hot.take());
    } else {
      yield(moved.take());
    }
  }
  if (!damaged) {
    tell_missing(query.robot, met);
  }
}

/// Rows can vanish without a trace when a page forgets that it has them; the counts of the head know better.
void PartReader::tell_missing(RobotId robot, const StreamCounts& met) const {
  for (const auto& [key, count] : head_->counts) {
    const auto found = met.find(key);
    const std::uint64_t here = found == met.end() ? 0 : found->second.stored;
    if (key.robot == robot && here < count.stored) {
      report_(fmt::format("{} answers of robot {} source {} session {} are missing", count.stored - here, key.robot,
                          source_name(key.source), key.session));
    }
  }
}

template <class Row, class Read, class Keep>
std::vector<Row> PartReader::records(const char* table, std::int64_t last_id, Read read, Keep keep) {
  std::vector<Row> rows;
  std::uint64_t bad = 0;
  std::int64_t read_rows = 0;
  try {
    Statement statement(connection_, select_sql(table) + " WHERE id <= ?1 ORDER BY id");
    statement.query(last_id);
    while (statement.step()) {
      ++read_rows;
      std::optional<Row> row = read(statement);
      if (!row) {
        ++bad;
      } else if (keep(*row)) {
        rows.push_back(std::move(*row));
      }
    }
  } catch (const SqliteError& error) {
    if (!error.damaged()) {
      throw;
    }
    report_(fmt::format("the rest of table {} cannot be read: {}", table, error.what()));
  }
  if (bad > 0) {
    report_(fmt::format("{} rows of table {} are damaged and left out", bad, table));
  }
  if (const auto sealed = head_->sealed_rows.find(table);
      sealed != head_->sealed_rows.end() && sealed->second != read_rows) {
    report_(fmt::format("{} rows of table {} were read, but it had {}", read_rows, table, sealed->second));
  }
  return rows;
}

std::vector<Gap> PartReader::gaps(RobotId robot, Window window) {
  std::vector<Gap> rows = records<Gap>("gap", head_->ends.gap, read_gap, [&](const Gap& g) {
    return g.robot == robot && g.t_to_us >= window.from_us && g.t_from_us < window.to_us;
  });
  std::stable_sort(rows.begin(), rows.end(), [](const Gap& a, const Gap& b) {
    return std::pair(a.session, a.t_from_us) < std::pair(b.session, b.t_from_us);
  });
  return rows;
}

std::vector<Event> PartReader::events(RobotId robot, Window window) {
  std::vector<Event> rows = records<Event>("event", head_->ends.event, read_event,
                                           [&](const Event& e) { return e.robot == robot && window.contains(e.t_us); });
  std::stable_sort(rows.begin(), rows.end(), [](const Event& a, const Event& b) {
    return std::pair(a.session, a.t_us) < std::pair(b.session, b.t_us);
  });
  return rows;
}

std::vector<ClockPoint> PartReader::clock(RobotId robot, Window window) {
  std::vector<ClockPoint> rows = records<ClockPoint>("clock", head_->ends.clock, read_clock, [&](const ClockPoint& c) {
    return (c.robot == robot || c.robot == 0) && window.contains(c.wall_us);
  });
  std::stable_sort(rows.begin(), rows.end(), [](const ClockPoint& a, const ClockPoint& b) {
    return std::pair(a.session, a.wall_us) < std::pair(b.session, b.wall_us);
  });
  return rows;
}

PartHead read_part(const std::filesystem::path& path) {
  PartHead head = read_head(path);
  if (head.damage.empty()) {
    return head;
  }
  std::set<RobotId> robots;
  for (const Robot& robot : head.robots) {
    robots.insert(robot.id);
  }
  StreamCounts counts;
  PartReader part(head, [](const std::string&) {});
  PartReader::Query query;
  query.sources.fill(true);
  for (const RobotId robot : robots) {
    query.robot = robot;
    part.answers(query, [&](const Answer& answer) {
      counts[{answer.meta.session, answer.meta.robot, answer.meta.source}].add(answer.meta, answer.body.size());
    });
  }
  for (auto& [key, count] : counts) {
    count.seen = head.counts[key].seen;
    count.valued = head.counts[key].valued;
    count.undecodable = head.counts[key].undecodable;
  }
  head.counts = std::move(counts);
  return head;
}

}  // namespace tacho::store
