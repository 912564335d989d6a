#pragma once
// The streams of the open session, as the writer keeps them: counts as they are and as they were at the last commit.

#include <algorithm>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "schema/store/coverage.hpp"
#include "schema/store/hot_codec.hpp"
#include "schema/store/log_writer.hpp"
#include "schema/store/rows.hpp"

namespace tacho::store {

using StreamId = std::pair<RobotId, Source>;

struct StreamState {
  StreamRow row;
  StreamCount count;       // of this part
  StreamCount committed;   // the same at the last commit
  StreamCount covered;     // the same as the part has it
  LogWriter::Tally tally;  // of the session
  LogWriter::Tally committed_tally;
  std::uint64_t next_seq = 0;  // after the last stored or missed poll
  std::uint64_t committed_seq = 0;
  std::optional<std::uint64_t> planned;
  bool dirty = false;    // `count` is not what the part has
  bool news = false;     // nor can what the part has be completed from hot rows
  HotBatch pending;      // answers that are not in the part yet
  std::string previous;  // last body of row previous_id, the base of the next row
  std::int64_t previous_id = 0;
  std::uint64_t deltas = 0;  // answers of rows since the last keyframe
  std::set<std::string, std::less<>> unknown;

  /// The next row is a keyframe.
  void forget_previous() {
    previous_id = 0;
    deltas = 0;
  }
  /// What the pending answers may be compressed against, when so many may stand between a row and its keyframe.
  [[nodiscard]] const std::string* base(std::uint64_t keyframe_every) const {
    return previous_id != 0 && deltas + pending.marks.size() <= keyframe_every ? &previous : nullptr;
  }
  /// They are row `id` now.
  void packed(std::int64_t id, bool delta) {
    deltas = delta ? deltas + pending.marks.size() : 0;
    previous = pending.last_body();
    previous_id = id;
    pending.clear();
  }
  /// What the part has of the counts, with what hot rows cannot tell.
  [[nodiscard]] StreamCount with_news() const {
    StreamCount told = covered;
    told.undecodable = count.undecodable;
    told.seen = count.seen;
    told.valued = count.valued;
    return told;
  }
  void add(const Gap& gap) {
    (gap.partial ? tally.partial : tally.missed[static_cast<std::size_t>(gap.cause)]) += gap.seq_count;
  }
  void commit() {
    committed = count;
    committed_tally = tally;
    committed_seq = next_seq;
  }
  void roll_back() {
    count = committed;
    tally = committed_tally;
    dirty = true;
    news = false;
    unknown.clear();
    pending.clear();
    forget_previous();
  }
  void begin_part() {
    const Micros last_us = count.last_us;
    count = StreamCount{};
    count.last_us = last_us;  // a kill has to know when the stream was last heard
    committed = count;
    covered = count;
    dirty = true;
    news = false;
    unknown.clear();
    forget_previous();
  }
  /// Polls that failed transactions have lost; empty: none.
  [[nodiscard]] std::optional<Gap> lost(const StreamId& id, const Session& session) const {
    if (next_seq <= committed_seq) {
      return std::nullopt;
    }
    Gap gap;
    gap.robot = id.first;
    gap.source = id.second;
    gap.session = session.id;
    gap.seq_from = committed_seq;
    gap.seq_count = next_seq - committed_seq;
    gap.t_from_us = std::max(count.last_us, session.t_start_us);
    gap.t_to_us = gap.t_from_us + static_cast<Micros>(gap.seq_count) * row.stream.period_us;
    gap.cause = Cause::disk;
    return gap;
  }
};

/// The newest row of a stream in earlier sessions.
struct LastRow {
  SessionId session = 0;
  Micros t_us = 0;
};

/// What every part carries, so that it can be read alone.
struct WriterHead {
  std::map<RobotId, Robot> robots;
  std::optional<Session> session;  ///< the open one
  std::map<StreamId, StreamState> streams;
  std::map<StreamId, LastRow> earlier;
  RobotId new_robots_from = 1;

  void write_head(Connection& connection) const;
  /// Of the robot with this name, or the next free one.
  [[nodiscard]] RobotId id_of(const std::string& name) const;
  /// What a robot says of itself; texts that are empty say nothing. The robot as it is known now.
  const Robot& learn(RobotId id, const Robot& told);
};

}  // namespace tacho::store
