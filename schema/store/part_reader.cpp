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

PartReader::PartReader(const PartHead& head, Report report, Access access)
    : head_(&head), report_(std::move(report)), connection_(open_part_for_reading(head.path, access)) {}

PartReader::Transaction::Transaction(PartReader& reader) : reader_(&reader) { reader.connection_.exec("BEGIN"); }

PartReader::Transaction::~Transaction() {
  try {
    reader_->connection_.exec("COMMIT");
  } catch (const SqliteError&) {
    try {  // COMMIT fails on a truncated file
      if (reader_->connection_.in_transaction()) {
        reader_->connection_.exec("ROLLBACK");
      }
    } catch (const SqliteError&) {
      // Nothing was written; a reader that cannot even end its reading says so at its next one.
    }
  }
  if (!is_closed(*reader_->head_)) {
    reader_->blocks_.reset();
  }
}

const BlockList& PartReader::blocks() {
  if (!blocks_) {
    blocks_ = list_blocks(connection_, head_->vocabulary);
  }
  return *blocks_;
}

bool PartReader::has_answers(const PartHead& head, const AnswerQuery& query) {
  return !head.damage.empty() || std::any_of(head.counts.begin(), head.counts.end(), [&](const auto& entry) {
    const auto& [key, count] = entry;
    return query.asks_for(key.session, key.robot, key.source) && count.stored > 0 &&
           count.last_us >= query.window.from_us && count.first_us < query.window.to_us;
  });
}

/// Runs `read` with somewhere to report damage and to count what was met; tells what nobody met without being damaged.
template <class Read>
void PartReader::counted(const AnswerQuery& query, Read read) {
  if (!has_answers(*head_, query)) {
    return;
  }
  bool damaged = false;
  const Report report = [&](const std::string& what) {
    damaged = true;
    report_(what);
  };
  StreamCounts met;
  read(met, report);
  if (!damaged) {
    tell_missing(query.robot, met);
  }
}

void PartReader::answers(const AnswerQuery& query, const std::function<void(const Answer&)>& yield) {
  counted(query, [&](StreamCounts& met, const Report& report) {
    HotAnswers hot(connection_, *head_, query, met, report);
    BlockScan moved(connection_, blocks(), *head_, query, met, report);
    while (hot.row() != 0 || moved.row() != 0) {
      if (moved.row() == 0 || (hot.row() != 0 && hot.row() < moved.row())) {
        yield(hot.take());
      } else {
        yield(moved.take());
      }
    }
  });
}

void PartReader::columns(ColumnQuery& query, const std::function<void(ColumnScan&)>& use) {
  counted(query.answers, [&](StreamCounts& met, const Report& report) {
    ColumnScan scan(connection_, blocks(), *head_, query, met, report);
    use(scan);
  });
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
  // Without a seal the ids say how many there are: they grow by one and no row is ever deleted.
  const auto sealed = head_->sealed_rows.find(table);
  const std::int64_t had = sealed != head_->sealed_rows.end() ? sealed->second : last_id;
  if (had != read_rows && (sealed != head_->sealed_rows.end() || head_->damage.empty())) {
    report_(fmt::format("{} rows of table {} were read, but it had {}", read_rows, table, had));
  }
  return rows;
}

bool PartReader::touches(Window window) {
  const Window always;
  if (!is_closed(*head_) || !head_->damage.empty() ||
      (window.from_us == always.from_us && window.to_us == always.to_us)) {
    return true;
  }
  if (!records_) {
    try {
      Statement span(connection_,
                     "SELECT min(a), max(b) FROM (SELECT min(t_from_us) AS a, max(t_to_us) AS b FROM gap UNION ALL "
                     "SELECT min(t_us), max(t_us) FROM event UNION ALL SELECT min(wall_us), max(wall_us) FROM clock)");
      span.query();
      span.step();
      records_ = Window{span.integer(0), span.integer(1)};
    } catch (const SqliteError& error) {
      if (!error.damaged()) {
        throw;
      }
      records_ = always;  // reading them says what is wrong
    }
  }
  return records_->to_us >= window.from_us && records_->from_us < window.to_us;
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

PartHead read_part(const std::filesystem::path& path, Access access) {
  PartHead head = read_head(path, access);
  if (head.damage.empty()) {
    return head;
  }
  std::set<RobotId> robots;
  for (const Robot& robot : head.robots) {
    robots.insert(robot.id);
  }
  StreamCounts counts;
  PartReader part(head, [](const std::string&) {});
  const PartReader::Transaction reading(part);
  AnswerQuery query;
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
