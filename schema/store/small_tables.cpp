#include "schema/store/small_tables.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <optional>
#include <utility>

#include "schema/store/hot_scan.hpp"
#include "schema/store/part_head.hpp"
#include "schema/store/schema_sql.hpp"

namespace tacho::store {

namespace {

constexpr const char* kUnknown = "unknown: this row of the log was damaged";

StreamKey key_of(const Stream& stream) { return {stream.session, stream.robot, stream.source}; }

/// What the rows of a part say of one stream.
struct Trace {
  std::uint64_t seq_from = std::numeric_limits<std::uint64_t>::max();
  std::uint64_t seq_to = 0;  ///< after the last
  Micros t_from_us = std::numeric_limits<Micros>::max();
  Micros t_to_us = std::numeric_limits<Micros>::min();
  StreamCount count;
};

class Mender {
 public:
  Mender(Connection& out, PartRow part, const KnownLog& known, const std::set<std::string, std::less<>>& damaged)
      : out_(&out), part_(std::move(part)), known_(&known), damaged_(&damaged) {}

  Mending run() {
    trace();
    mend();
    return std::move(mending_);
  }

 private:
  Connection* out_;
  PartRow part_;
  const KnownLog* known_;
  const std::set<std::string, std::less<>>* damaged_;
  Mending mending_;
  std::map<StreamKey, Trace> traces_;
  std::map<SessionId, Micros> sessions_;  ///< that left rows -> first time in them
  std::set<RobotId> robots_;              ///< likewise
  std::int64_t last_place_ = 0;           ///< of hot answers

  void note(std::string text) { mending_.notes.push_back(std::move(text)); }
  [[nodiscard]] bool trusted(const char* table) const { return damaged_->count(table) == 0; }
  void trace();
  void trace_hot();
  void saw(SessionId session, RobotId robot, Micros t_us);
  void mend();
  void mend_sessions();
  void mend_robots();
  void mend_streams();
  template <class Id, class Row, class Made>
  std::map<Id, Row> mended(const char* table, std::map<Id, Row> found, const std::map<Id, Row>& known,
                           const std::set<Id>& used, Made made);
};

void Mender::saw(SessionId session, RobotId robot, Micros t_us) {
  const auto known = sessions_.try_emplace(session, t_us).first;
  known->second = std::min(known->second, t_us);
  if (robot != 0) {
    robots_.insert(robot);
  }
}

void Mender::trace_hot() {
  for_each_hot_row(*out_, read_vocabulary(*out_), 0,
                   [this](const HotRow& row, Source source, const std::vector<HotMark>& marks) {
                     Trace& trace = traces_[{row.session, row.robot, source}];
                     trace.seq_from = std::min(trace.seq_from, row.seq);
                     trace.seq_to = std::max(trace.seq_to, marks.back().seq + 1);
                     for (const HotMark& mark : marks) {
                       trace.t_from_us = std::min(trace.t_from_us, mark.t_send_us);
                       trace.t_to_us = std::max(trace.t_to_us, mark.t_send_us);
                       trace.count.bytes += mark.length;
                     }
                     trace.count.stored += row.rows;
                     trace.count.next_seq = trace.seq_to;
                     last_place_ = std::max(last_place_, marks.back().place);
                     saw(row.session, row.robot, trace.t_from_us);
                   });
}

void Mender::trace() {
  trace_hot();
  const auto polls = [&](const char* sql, bool stored, const auto& source_of) {
    Statement row(*out_, sql);
    while (row.step()) {
      StreamKey key{static_cast<SessionId>(row.integer(0)), static_cast<RobotId>(row.integer(1)), Source::status};
      if (!source_of(row, key.source)) {
        continue;
      }
      Trace& trace = traces_[key];
      const auto next = static_cast<std::uint64_t>(row.integer(4)) + 1;
      trace.seq_from = std::min(trace.seq_from, static_cast<std::uint64_t>(row.integer(3)));
      trace.seq_to = std::max(trace.seq_to, next);
      trace.t_from_us = std::min(trace.t_from_us, row.integer(5));
      trace.t_to_us = std::max(trace.t_to_us, row.integer(6));
      saw(key.session, key.robot, row.integer(5));
      if (stored) {
        trace.count.stored += static_cast<std::uint64_t>(row.integer(7));
        trace.count.bytes += static_cast<std::uint64_t>(row.integer(8));
        trace.count.next_seq = std::max(trace.count.next_seq, next);
      }
    }
  };
  const auto by_number = [](const Statement& row, Source& source) {
    source = static_cast<Source>(row.integer(2));
    return row.integer(2) >= 0 && row.integer(2) < static_cast<std::int64_t>(kSourceCount);
  };
  const auto by_name = [](const Statement& row, Source& source) { return parse_source(row.bytes(2), source); };
  polls(
      "SELECT session, robot, source, min(seq_from), max(seq_to), min(t_from_us), max(t_to_us), sum(rows), 0 "
      "FROM block GROUP BY 1, 2, 3",
      true, by_number);
  polls(
      "SELECT session, robot, source, min(seq_from), max(seq_from + seq_count - 1), min(t_from_us), max(t_to_us) "
      "FROM gap WHERE partial = 0 AND seq_count > 0 GROUP BY 1, 2, 3",
      false, by_name);
  for (const char* sql : {"SELECT session, robot, min(t_us) FROM event GROUP BY 1, 2",
                          "SELECT session, robot, min(wall_us) FROM clock GROUP BY 1, 2",
                          "SELECT session, robot, min(t_to_us) FROM gap GROUP BY 1, 2"}) {
    Statement row(*out_, sql);
    while (row.step()) {
      saw(static_cast<SessionId>(row.integer(0)), static_cast<RobotId>(row.integer(1)), row.integer(2));
    }
  }
}

/// What was found, without what nothing speaks for when the table is damaged, and what is missing.
template <class Id, class Row, class Made>
std::map<Id, Row> Mender::mended(const char* table, std::map<Id, Row> found, const std::map<Id, Row>& known,
                                 const std::set<Id>& used, Made made) {
  if (!trusted(table)) {
    std::erase_if(found, [&](const auto& row) { return used.count(row.first) == 0; });
    for (const auto& [id, row] : known) {
      found[id] = row;
    }
  }
  for (const Id& id : used) {
    if (found.count(id) > 0) {
      continue;
    }
    const auto other = known.find(id);
    found[id] = other == known.end() ? made(id) : other->second;
    mending_.made_up = true;
  }
  return found;
}

void Mender::mend_sessions() {
  std::map<SessionId, Session> found;
  Statement row(*out_, select_sql("session"));
  while (row.step()) {
    const Session session = read_session(row);
    found[session.id] = session;
  }
  std::set<SessionId> used;
  for (const auto& [id, t_us] : sessions_) {
    used.insert(id);
  }
  const auto made = [&](SessionId id) {
    note(fmt::format("session {}: its row is lost; it begins with the first row that names it", id));
    Session session;
    session.id = id;
    session.t_start_us = sessions_.at(id);
    session.software = session.config = session.host = kUnknown;
    return session;
  };
  out_->exec("DELETE FROM session");
  Statement insert(*out_, insert_sql("session"));
  for (const auto& [id, session] : mended<SessionId, Session>("session", found, known_->sessions, used, made)) {
    write(insert, session);
  }
}

void Mender::mend_robots() {
  std::map<RobotId, Robot> found;
  Statement row(*out_, select_sql("robot"));
  while (row.step()) {
    const Robot robot = read_robot(row);
    found[robot.id] = robot;
  }
  const auto made = [&](RobotId id) {
    note(fmt::format("robot {}: its row is lost; it is called robot-{}", id, id));
    Robot robot;
    robot.id = id;
    robot.name = fmt::format("robot-{}", id);
    return robot;
  };
  out_->exec("DELETE FROM robot");
  Statement insert(*out_, insert_sql("robot", "OR REPLACE"));
  for (const auto& [id, robot] : mended<RobotId, Robot>("robot", found, known_->robots, robots_, made)) {
    write(insert, robot);
  }
}

void Mender::mend_streams() {
  std::map<StreamKey, StreamRow> found;
  Statement row(*out_, select_sql("stream"));
  while (row.step()) {
    if (std::optional<StreamRow> stream = read_stream(row)) {
      found[key_of(stream->stream)] = std::move(*stream);
    }
  }
  std::set<StreamKey> used;
  for (const auto& [key, trace] : traces_) {
    used.insert(key);
  }
  const auto made = [&](const StreamKey& key) {
    const Trace& trace = traces_.at(key);
    note(fmt::format("robot {} {} session {}: the row of the stream is lost; period and order of words are estimated",
                     key.robot, source_name(key.source), key.session));
    StreamRow stream;
    stream.stream.session = key.session;
    stream.stream.robot = key.robot;
    stream.stream.source = key.source;
    const auto steps = static_cast<Micros>(trace.seq_to - trace.seq_from) - 1;
    stream.stream.period_us = steps > 0 ? (trace.t_to_us - trace.t_from_us) / steps : 0;
    return stream;
  };
  out_->exec("DELETE FROM stream");
  Statement insert(*out_, insert_sql("stream"));
  const bool trust = trusted("stream");
  for (auto& [key, stream] : mended<StreamKey, StreamRow>("stream", found, known_->streams, used, made)) {
    const auto trace = traces_.find(key);
    if (trace != traces_.end() && (!trust || found.count(key) == 0)) {
      // Its numbers may be the damage: the polls that are here know better.
      stream.seq_from = part_.number == 1 ? 0 : trace->second.seq_from;
      stream.stream.planned.reset();
    }
    if (trace != traces_.end() || trust) {
      write(insert, stream);
    }
  }
}

void Mender::mend() {
  mend_sessions();
  mend_robots();
  mend_streams();
  Statement coverage(*out_, insert_sql("coverage"));
  for (auto& [key, trace] : traces_) {
    trace.count.first_us = trace.t_from_us;
    trace.count.last_us = trace.t_to_us;
    write(coverage, key, trace.count);
  }
  part_.counted_to = std::max(last_place_, out_->integer("SELECT ifnull(max(row_to), 0) FROM block"));
  out_->exec("DELETE FROM part; DELETE FROM seal");
  Statement part(*out_, insert_sql("part"));
  part.run(part_.log, part_.number, part_.software, false, part_.counted_to);
}

}  // namespace

KnownLog ask(std::span<const std::filesystem::path> parts) {
  KnownLog known;
  for (const std::filesystem::path& path : parts) {
    PartHead head;
    try {
      head = read_head(path);
    } catch (const Error&) {
      continue;  // no part
    }
    if (!head.damage.empty()) {
      continue;
    }
    known.log = head.row.log;
    for (const Robot& robot : head.robots) {
      known.robots[robot.id] = robot;
    }
    for (const Session& session : head.sessions) {
      known.sessions[session.id] = session;
    }
    for (const StreamRow& row : head.streams) {
      known.streams[key_of(row.stream)] = row;
    }
  }
  return known;
}

Mending mend_small_tables(Connection& out, PartRow part, const KnownLog& known,
                          const std::set<std::string, std::less<>>& damaged) {
  return Mender(out, std::move(part), known, damaged).run();
}

}  // namespace tacho::store
