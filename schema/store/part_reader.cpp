#include "schema/store/part_reader.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <utility>

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

}  // namespace

PartReader::PartReader(const PartHead& head, Report report)
    : head_(&head), report_(std::move(report)), connection_(open_part_for_reading(head.path)) {}

void PartReader::answers(const Query& query, const std::function<void(const Answer&)>& yield) {
  const bool any = std::any_of(head_->counts.begin(), head_->counts.end(), [&](const auto& entry) {
    const auto& [key, count] = entry;
    return key.robot == query.robot && query.sources[static_cast<std::size_t>(key.source)] && count.stored > 0 &&
           count.last_us >= query.window.from_us && count.first_us < query.window.to_us;
  });
  if (any) {
    hot_answers(query, yield);
  }
}

void PartReader::hot_answers(const Query& query, const std::function<void(const Answer&)>& yield) {
  bool lost = false;
  HotScan scan(connection_, head_->vocabulary, head_->ends.hot,
               [&](std::int64_t after, std::int64_t before, const std::string& why) {
                 lost = true;
                 report_(fmt::format("answers between rows {} and {} are lost: {}", after, before, why));
               });
  BodyChain chain(connection_, head_->vocabulary);
  BrokenRuns broken(report_);
  Answer answer;
  StreamCounts met;
  while (const HotRow* row = scan.next()) {
    ++met[{row->meta.session, row->meta.robot, row->meta.source}].stored;
    if (row->meta.robot != query.robot || !query.sources[static_cast<std::size_t>(row->meta.source)] ||
        !query.window.contains(row->meta.t_send_us)) {
      continue;
    }
    const std::string* body = chain.body(*row);
    if (body == nullptr) {
      broken.bad(row->meta);
      continue;
    }
    broken.good(row->meta.source);
    answer.meta = row->meta;
    answer.body = *body;
    answer.header = row->header;
    yield(answer);
  }
  broken.finish();
  if (!lost) {
    tell_missing(query.robot, met);
  }
}

/// Rows can vanish without a trace when a page forgets that it has them; the counts of the head know better.
void PartReader::tell_missing(RobotId robot, const StreamCounts& met) {
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

}  // namespace tacho::store
