#include "schema/store/log_writer.hpp"

#include <algorithm>
#include <cassert>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "schema/store/hot_codec.hpp"
#include "schema/store/part_sequence.hpp"
#include "schema/store/repack.hpp"
#include "schema/store/schema_sql.hpp"

namespace tacho::store {

namespace {

namespace fs = std::filesystem;

constexpr Micros kDayUs = 86'400'000'000;
constexpr std::uint64_t kCommitsPerCoverage = 10;
constexpr std::uint64_t kCommitsPerCheckpoint = 60;
constexpr std::uint64_t kCommitsAfterFailedMove = 60;
/// Moving rows into blocks after a commit takes about this long at most: rows of many robots are due at the same time.
constexpr auto kMoveBudget = std::chrono::milliseconds(50);
constexpr int kWalPagesPerCheckpoint = 2048;  // 8 MiB
constexpr int kWalPagesPinned = 16384;        // 64 MiB: a reader keeps the WAL from being emptied
// Against a robot that invents keys: the answers themselves keep all of them.
constexpr std::size_t kUnknownKeysPerStream = 1000;

Micros day_of(Micros t_us) { return t_us >= 0 ? t_us / kDayUs : (t_us + 1) / kDayUs - 1; }

/// One stream of the open session.
struct StreamState {
  StreamRow row;
  StreamCount count;       // of this part
  StreamCount committed;   // the same at the last commit
  LogWriter::Tally tally;  // of the session
  LogWriter::Tally committed_tally;
  std::uint64_t next_seq = 0;  // after the last stored or missed poll
  std::uint64_t committed_seq = 0;
  std::optional<std::uint64_t> planned;
  bool dirty = false;
  std::string previous;  // body of row previous_id, the base of the next row
  std::int64_t previous_id = 0;
  int deltas = 0;
  std::set<std::string, std::less<>> unknown;

  void forget_previous() {
    previous_id = 0;
    deltas = 0;
  }
};

using StreamId = std::pair<RobotId, Source>;

void count_gap(StreamState& state, const Gap& gap) {
  (gap.partial ? state.tally.partial : state.tally.missed[static_cast<std::size_t>(gap.cause)]) += gap.seq_count;
}

/// The newest row of a stream in earlier sessions.
struct LastRow {
  SessionId session = 0;
  Micros t_us = 0;
};

}  // namespace

struct LogWriter::Impl {
  WriterOptions options;
  PartSequence parts;
  HotEncoder encoder;
  HotLedger hot;  // of the current part
  Repacker repacker;
  std::map<RobotId, Robot> robots;
  SessionId next_session = 1;
  std::optional<Session> session;
  std::map<StreamId, StreamState> streams;
  std::map<StreamId, LastRow> earlier;
  std::int64_t next_row = 1;
  std::optional<Micros> part_day;
  bool urgent = false;  // something changed that cannot be counted again without decoding
  bool lost = false;    // a transaction failed: the next one says so in gap rows
  bool day_over = false;
  std::uint64_t since_coverage = 0;
  std::uint64_t since_checkpoint = 0;
  std::uint64_t move_again_at = 0;  // stats.commits
  Stats stats;
  Stats committed_stats;
  std::map<StreamId, Tally> tallies;  // of the ended session

  Impl(const fs::path& folder, WriterOptions how)
      : options(how), parts(folder, how.durable), encoder(how.zstd_level), repacker(how.zstd_level, how.decode) {
    if (parts.found()) {
      adopt(*parts.found());
    }
    if (!parts.has_current()) {
      next_part();
    } else {
      stats.parts = 1;
    }
  }

  PartWriter& part() { return parts.current(); }
  void adopt(const PartHead& head);
  void write_head(Connection& connection);
  void next_part();

  template <class Write>
  void write(Write rows);
  template <class Write>
  void write_polls(StreamState& state, std::uint64_t next_seq, Write rows);
  void write_lost();
  void rolled_back();
  void write_coverage();
  void commit();
  void committed();
  void coverage_written();
  void move_due();
  void checkpoint();
  [[nodiscard]] bool part_is_over();
  void turn_day(Micros t_us);

  StreamState& stream(RobotId robot, Source source);
  void insert(StreamState& state, const Answer& answer);
  void declare(const Stream& stream);
  void end_session(Micros t_end_us, bool clean);
};

void LogWriter::Impl::adopt(const PartHead& head) {
  for (const Robot& robot : head.robots) {
    robots[robot.id] = robot;
  }
  for (const Session& known : head.sessions) {
    next_session = std::max(next_session, known.id + 1);
  }
  for (const auto& [key, count] : head.counts) {
    next_session = std::max(next_session, key.session + 1);
    LastRow& last = earlier[{key.robot, key.source}];
    last = {std::max(last.session, key.session), std::max(last.t_us, count.last_us)};
    if (parts.has_current() && count.stored > 0) {
      part_day = std::min(part_day.value_or(day_of(count.first_us)), day_of(count.first_us));
    }
  }
  next_row = std::max(head.row.counted_to, head.ends.row) + 1;
  if (parts.has_current()) {
    hot.load(part().connection(), head.vocabulary);
  }
}

/// What every part carries, so that it can be read alone.
void LogWriter::Impl::write_head(Connection& connection) {
  Statement robot(connection, insert_sql("robot", "OR REPLACE"));
  Statement open_session(connection, insert_sql("session", "OR REPLACE"));
  Statement stream_row(connection, insert_sql("stream", "OR REPLACE"));
  Statement coverage(connection, insert_sql("coverage", "OR IGNORE"));
  for (const auto& [id, known] : robots) {
    store::write(robot, known);
  }
  if (session) {
    store::write(open_session, *session);
  }
  for (const auto& [id, state] : streams) {
    store::write(stream_row, state.row);
    StreamCount count;  // of nothing yet, but a kill has to know when the stream was last heard
    count.last_us = state.count.last_us;
    store::write(coverage, {session->id, id.first, id.second}, count);
  }
  for (const auto& [id, last] : earlier) {
    StreamCount count;
    count.last_us = last.t_us;
    store::write(coverage, {last.session, id.first, id.second}, count);
  }
}

/// Starts the next part. All rows are committed; when this throws, the current part goes on.
void LogWriter::Impl::next_part() {
  std::map<StreamId, std::uint64_t> seq_from;
  for (auto& [id, state] : streams) {
    seq_from[id] = std::exchange(state.row.seq_from, state.committed_seq);
  }
  try {
    parts.next([this](Connection& connection) { write_head(connection); }, options.blocks ? hot : HotLedger{});
  } catch (...) {
    for (auto& [id, state] : streams) {
      state.row.seq_from = seq_from[id];
    }
    throw;
  }
  for (auto& [id, state] : streams) {
    const Micros last_us = state.count.last_us;
    state.count = StreamCount{};
    state.count.last_us = last_us;
    state.committed = state.count;
    state.dirty = true;
    state.unknown.clear();
    state.forget_previous();
  }
  hot = HotLedger{};
  next_row = 1;
  part_day.reset();
  day_over = false;
  ++stats.parts;
}

/// Runs `rows` inside the open transaction, or begins one. When anything fails, all since the last commit is lost.
template <class Write>
void LogWriter::Impl::write(Write rows) {
  try {
    if (!part().in_transaction()) {
      part().begin();
      if (lost) {
        write_lost();
      }
    }
    rows();
  } catch (const SqliteError&) {
    rolled_back();
    throw;
  }
}

/// Writes rows that use up the polls before `next_seq`; when they cannot be written, those polls are lost.
template <class Write>
void LogWriter::Impl::write_polls(StreamState& state, std::uint64_t next_seq, Write rows) {
  try {
    rows();
  } catch (const Error&) {
    lost = true;
    state.next_seq = std::max(state.next_seq, next_seq);
    throw;
  }
  state.next_seq = std::max(state.next_seq, next_seq);
}

/// The rows of a failed transaction, and what was in memory only.
void LogWriter::Impl::write_lost() {
  write_head(part().connection());
  for (auto& [id, state] : streams) {
    if (state.next_seq > state.committed_seq) {
      Gap gap;
      gap.robot = id.first;
      gap.source = id.second;
      gap.session = session->id;
      gap.seq_from = state.committed_seq;
      gap.seq_count = state.next_seq - state.committed_seq;
      gap.t_from_us = std::max(state.count.last_us, session->t_start_us);
      gap.t_to_us = gap.t_from_us + static_cast<Micros>(gap.seq_count) * state.row.stream.period_us;
      gap.cause = Cause::disk;
      part().put(gap);
      count_gap(state, gap);
      stats.lost += gap.seq_count;
    }
  }
}

void LogWriter::Impl::rolled_back() {
  part().rollback();
  lost = true;
  urgent = true;
  hot.roll_back();
  const std::uint64_t parts_opened = stats.parts;
  stats = committed_stats;
  stats.parts = parts_opened;
  for (auto& [id, state] : streams) {
    state.count = state.committed;
    state.tally = state.committed_tally;
    state.dirty = true;
    state.unknown.clear();
    state.forget_previous();
  }
}

void LogWriter::Impl::write_coverage() {
  for (auto& [id, state] : streams) {
    if (state.dirty) {
      part().put({session->id, id.first, id.second}, state.count);
    }
  }
  part().set_counted_to(next_row - 1);
}

void LogWriter::Impl::commit() {
  if (lost) {
    write([] {});  // what was lost belongs on record, and into this part, also when no poll follows
  }
  if (part().in_transaction()) {
    const auto start = std::chrono::steady_clock::now();
    const bool coverage = urgent || since_coverage + 1 >= kCommitsPerCoverage || part_is_over();
    write([&] {
      if (coverage) {
        write_coverage();
      }
      part().commit();
    });
    ++since_coverage;
    if (coverage) {
      coverage_written();
    }
    committed();
    stats.last_commit = std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::steady_clock::now() - start);
  }
  checkpoint();
  if (part_is_over()) {
    next_part();
  } else {
    move_due();
  }
  parts.tidy(repacker, std::chrono::steady_clock::now() + kMoveBudget);
}

void LogWriter::Impl::coverage_written() {
  urgent = false;
  since_coverage = 0;
  std::for_each(streams.begin(), streams.end(), [](auto& entry) { entry.second.dirty = false; });
}

/// Moves the rows of streams that have enough of them. All rows are committed; where this fails, they stay hot and
/// nothing is lost, so nobody has to be told before the next commit fails, too.
void LogWriter::Impl::move_due() {
  const auto until = std::chrono::steady_clock::now() + kMoveBudget;
  bool time_left = options.blocks && stats.commits >= move_again_at;
  while (const std::optional<StreamKey> key = time_left ? hot.due() : std::nullopt) {
    try {
      part().begin();
      write_coverage();  // it counts hot rows, of which some are no more
      repacker.move(part(), *key, hot.rows(*key));
      part().commit();
    } catch (const SqliteError&) {
      part().rollback();
      move_again_at = stats.commits + kCommitsAfterFailedMove;
      return;
    }
    coverage_written();
    hot.forget(*key);
    if (const auto open = streams.find({key->robot, key->source}); open != streams.end()) {
      open->second.forget_previous();
    }
    time_left = std::chrono::steady_clock::now() < until;
  }
}

void LogWriter::Impl::committed() {
  lost = false;
  ++stats.commits;
  ++since_checkpoint;
  committed_stats = stats;
  hot.commit();
  for (auto& [id, state] : streams) {
    state.committed = state.count;
    state.committed_tally = state.tally;
    state.committed_seq = state.next_seq;
  }
}

void LogWriter::Impl::checkpoint() {
  Connection& connection = part().connection();
  if (since_checkpoint < kCommitsPerCheckpoint && connection.wal_pages() < kWalPagesPerCheckpoint) {
    return;
  }
  since_checkpoint = 0;
  const bool complete = connection.checkpoint_passive();
  // A reader that stays for hours must not make the WAL grow without end: the next part has a WAL of its own.
  day_over = day_over || (!complete && connection.wal_pages() >= kWalPagesPinned);
}

bool LogWriter::Impl::part_is_over() { return part_day && (day_over || part().bytes() >= options.part_bytes); }

/// A row of the next UTC day, or one from more than a day back after the clock was set, belongs into a new part. Rows
/// from just before midnight that arrive late do not.
void LogWriter::Impl::turn_day(Micros t_us) {
  const Micros day = day_of(t_us);
  if (part_day && options.part_per_day && (day > *part_day || day < *part_day - 1)) {
    day_over = true;
    commit();
  }
}

StreamState& LogWriter::Impl::stream(RobotId robot, Source source) {
  const auto found = streams.find({robot, source});
  assert(found != streams.end() && "a stream is declared before its first row");
  return found->second;
}

void LogWriter::Impl::insert(StreamState& state, const Answer& answer) {
  const bool delta = state.previous_id != 0 && state.deltas < options.keyframe_every;
  const HotEncoder::Stored stored = encoder.encode(answer.body, delta ? &state.previous : nullptr);
  HotRow row;
  row.id = next_row;
  row.source = static_cast<std::int64_t>(answer.meta.source);
  row.meta = answer.meta;
  row.base = stored.needs_base ? state.previous_id : 0;
  row.length = answer.body.size();
  row.header = answer.header;
  row.body = stored.bytes;
  part().put(row);
  part_day = part_day.value_or(day_of(answer.meta.t_send_us));
  ++next_row;
  state.previous = answer.body;
  state.previous_id = row.id;
  state.deltas = stored.needs_base ? state.deltas + 1 : 0;
  hot.add({answer.meta.session, answer.meta.robot, answer.meta.source}, row.id, answer.meta.t_send_us, row.length);
  state.count.add(answer.meta, row.length);
  ++state.tally.stored;
  state.dirty = true;
  ++stats.rows;
  stats.body_bytes += row.length;
  stats.stored_bytes += stored.bytes.size() + answer.header.size();
}

/// The interesting part of declare(): polls that were never planned because nobody recorded.
void LogWriter::Impl::declare(const Stream& declared) {
  assert(session && declared.session == session->id);
  StreamState& state = streams[{declared.robot, declared.source}];
  state.row.stream = declared;
  state.row.stream.planned.reset();
  write([&] { part().put(state.row); });
  const auto last = earlier.find({declared.robot, declared.source});
  if (last == earlier.end()) {
    return;
  }
  Gap gap;
  gap.robot = declared.robot;
  gap.source = declared.source;
  gap.session = session->id;
  gap.t_from_us = std::max(last->second.t_us, part().last_gap_end(gap.robot, gap.source, session->id));
  gap.t_to_us = std::max(gap.t_from_us, session->t_start_us);
  gap.cause = Cause::recorder_off;
  write([&] { part().put(gap); });
}

void LogWriter::Impl::end_session(Micros t_end_us, bool clean) {
  session->t_end_us = t_end_us;
  session->clean = clean;
  for (auto& [id, state] : streams) {
    state.row.stream.planned = state.planned.value_or(state.next_seq);
  }
  urgent = true;
  write([&] {
    part().put(*session);
    for (const auto& [id, state] : streams) {
      part().put(state.row);
    }
  });
  commit();
  for (const auto& [id, state] : streams) {
    tallies[id] = state.committed_tally;
    if (state.count.last_us != 0) {
      earlier[id] = {session->id, state.count.last_us};
    }
  }
  streams.clear();
  session.reset();
}

LogWriter::LogWriter(const fs::path& folder, WriterOptions options) : impl_(std::make_unique<Impl>(folder, options)) {}

LogWriter::~LogWriter() {
  try {
    impl_->urgent = true;
    impl_->commit();
    impl_->parts.close(impl_->options.blocks ? impl_->hot : HotLedger{});
    impl_->parts.tidy(impl_->repacker, kNoDeadline);
  } catch (const Error&) {
    // What was committed is safe; the next opening closes the part.
  }
}

SessionId LogWriter::begin_session(const Session& session) {
  assert(!impl_->session);
  impl_->turn_day(session.t_start_us);
  impl_->session = session;
  impl_->session->id = impl_->next_session++;
  impl_->session->t_end_us = 0;
  impl_->session->clean = false;
  impl_->tallies.clear();
  impl_->write([this] { impl_->part().put(*impl_->session); });
  return impl_->session->id;
}

void LogWriter::end_session(Micros t_end_us, bool clean) { impl_->end_session(t_end_us, clean); }

RobotId LogWriter::robot(const std::string& name, const std::string& address) {
  auto& robots = impl_->robots;
  const auto found = std::find_if(robots.begin(), robots.end(), [&](const auto& r) { return r.second.name == name; });
  const RobotId id = found != robots.end() ? found->first : robots.empty() ? 1 : robots.rbegin()->first + 1;
  Robot& robot = robots[id];
  if (robot.id == id && robot.address == address) {
    return id;
  }
  robot.id = id;
  robot.name = name;
  robot.address = address;
  impl_->write([&] { impl_->part().put(robot); });
  return id;
}

void LogWriter::identify(RobotId id, const Robot& identity) {
  Robot& robot = impl_->robots.at(id);
  const auto take = [](std::string& known, const std::string& told) { known = told.empty() ? known : told; };
  take(robot.vehicle_id, identity.vehicle_id);
  take(robot.mac, identity.mac);
  take(robot.model_md5, identity.model_md5);
  take(robot.firmware, identity.firmware);
  impl_->write([&] { impl_->part().put(robot); });
}

void LogWriter::declare(const Stream& stream) { impl_->declare(stream); }

void LogWriter::restore(const Robot& robot) {
  impl_->robots[robot.id] = robot;
  impl_->write([&] { impl_->part().put(robot); });
}

void LogWriter::restore(const Session& session) {
  assert(session.id >= impl_->next_session);
  impl_->next_session = session.id;
  begin_session(session);
}

void LogWriter::restore(const Stream& stream, std::uint64_t first_poll) {
  impl_->earlier.erase({stream.robot, stream.source});
  impl_->declare(stream);
  StreamState& state = impl_->stream(stream.robot, stream.source);
  state.row.seq_from = state.next_seq = state.committed_seq = first_poll;
  impl_->write([&] { impl_->part().put(state.row); });
}

void LogWriter::planned(RobotId robot, Source source, std::uint64_t count) {
  impl_->stream(robot, source).planned = count;
}

void LogWriter::set_word_order(RobotId robot, Source source, WordOrder order) {
  StreamState& state = impl_->stream(robot, source);
  state.row.stream.word_order = order;
  impl_->write([&] { impl_->part().put(state.row); });
}

void LogWriter::append(const Answer& answer) {
  StreamState& state = impl_->stream(answer.meta.robot, answer.meta.source);
  assert(impl_->session && answer.meta.session == impl_->session->id);
  assert(answer.meta.seq >= state.count.next_seq && "polls of a stream are appended in order, each once");
  impl_->write_polls(state, answer.meta.seq + 1, [&] {
    impl_->turn_day(answer.meta.t_send_us);
    impl_->write([&] { impl_->insert(state, answer); });
  });
}

void LogWriter::note(const Sample& sample) {
  StreamState& state = impl_->stream(sample.meta.robot, sample.meta.source);
  const FieldSet seen = state.count.seen | sample.seen();
  const FieldSet valued = state.count.valued | sample.valued();
  impl_->urgent = impl_->urgent || seen != state.count.seen || valued != state.count.valued || !sample.decodable;
  state.count.seen = seen;
  state.count.valued = valued;
  state.count.undecodable += sample.decodable ? 0 : 1;
  state.dirty = true;
  for (const std::string& key : sample.unknown_keys) {
    if (state.unknown.size() < kUnknownKeysPerStream && state.unknown.find(key) == state.unknown.end()) {
      impl_->write([&] {
        impl_->part().put(UnknownKey{sample.meta.robot, sample.meta.source, key, sample.meta.t_send_us});
      });
      state.unknown.insert(key);
    }
  }
}

void LogWriter::add(const Gap& gap) {
  const bool missed = !gap.partial && gap.seq_count > 0;
  StreamState& state = impl_->stream(gap.robot, gap.source);
  impl_->write_polls(state, missed ? gap.seq_from + gap.seq_count : 0, [&] {
    impl_->write([&] {
      impl_->part().put(gap);
      count_gap(state, gap);
    });
  });
}

void LogWriter::add(const Event& event) {
  impl_->write([&] { impl_->part().put(event); });
}

void LogWriter::add(const ClockPoint& point) {
  impl_->write([&] { impl_->part().put(point); });
}

void LogWriter::commit() { impl_->commit(); }

const LogWriter::Stats& LogWriter::stats() const { return impl_->stats; }

LogWriter::Tally LogWriter::tally(RobotId robot, Source source) const {
  if (const auto open = impl_->streams.find({robot, source}); open != impl_->streams.end()) {
    return open->second.committed_tally;
  }
  const auto ended = impl_->tallies.find({robot, source});
  return ended == impl_->tallies.end() ? Tally{} : ended->second;
}

}  // namespace tacho::store
