#include "schema/store/log_writer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "schema/store/coverage_writer.hpp"
#include "schema/store/hot_writer.hpp"
#include "schema/store/kept_parts.hpp"
#include "schema/store/move_pace.hpp"
#include "schema/store/part_end.hpp"
#include "schema/store/part_sequence.hpp"
#include "schema/store/repack.hpp"
#include "schema/store/schema_sql.hpp"
#include "schema/store/stream_state.hpp"
#include "schema/store/unsaved_rows.hpp"

namespace tacho::store {

namespace fs = std::filesystem;

namespace {

constexpr std::uint64_t kCommitsAfterFailure = 60;
constexpr std::uint64_t kPinned = 2;  // a WAL so many times larger than it should be is pinned by a reader
// Of a part that cannot be read nobody knows how many sessions and robots it had.
constexpr std::uint32_t kUnknownIds = 1000;
// Against a robot that invents keys: the answers themselves keep all of them.
constexpr std::size_t kUnknownKeysPerStream = 1000;

}  // namespace

struct LogWriter::Impl : WriterHead {
  WriterOptions options;
  Keeper keeper;
  PartSequence parts;
  HotWriter answers;
  HotLedger hot;  // of the current part
  Repacker repacker;
  SessionId next_session = 1;
  PartEnd part_end;
  CoverageWriter coverage;
  bool lost = false;                   // a transaction failed: the next one says so in gap rows
  bool removed_told = false;           // the open transaction tells of removed parts
  std::uint64_t move_again_at = 0;     // stats.commits
  std::uint64_t prepare_again_at = 0;  // stats.commits
  std::uint64_t change_again_at = 0;   // stats.commits
  bool change_fails = false;           // and that has been told
  UnsavedRows unsaved;
  MovePace pace;
  Stats stats;
  Stats committed_stats;
  std::map<StreamId, Tally> tallies;  // of the ended session

  Impl(const fs::path& folder, WriterOptions how)
      : options(std::move(how)),
        keeper(options.retention),
        parts(folder, options.durable, options.zstd_level, options.decode),
        answers(options.keyframe_every),
        repacker(options.zstd_level, options.decode),
        part_end(options.part_bytes, options.part_per_day) {
    open_newest();
    if (parts.found()) {
      adopt(*parts.found());
    }
    if (!parts.knows_ids()) {
      next_session += kUnknownIds;
      new_robots_from = kUnknownIds + (robots.empty() ? 1 : robots.rbegin()->first);
    }
    stats.parts = parts.has_current() ? 1 : 0;
    if (!parts.has_current() && parts.skip_to(options.first_part)) {
      next_part();
    }
  }

  PartWriter& part() { return parts.current(); }
  void open_newest();
  void adopt(const PartHead& head);
  void next_part();
  bool change_part();

  template <class Write>
  void write(Write rows);
  template <class Write>
  void write_polls(StreamState& state, std::uint64_t next_seq, Write rows);
  void write_lost();
  void write_removed();
  void rolled_back();
  void commit();
  void commit_all();
  void commit_rows();
  void committed();
  void prepare_next();
  void move_due(Deadline until);
  void checkpoint();
  void turn_day(Micros t_us);

  StreamState& stream(RobotId robot, Source source);
  void keep(StreamState& state, const Answer& answer);
  void pack_kept();
  void insert_packed();
  void declare(const Stream& stream);
  void end_session(Micros t_end_us, bool clean);
};

/// What the rules no longer want goes first: opening needs room on the disk.
void LogWriter::Impl::open_newest() {
  while (keeper.remove_one(parts, Keeper::When::as_usual)) {
  }
  try {
    parts.open();
  } catch (const SqliteError& error) {
    if (!error.full() || !keeper.remove_one(parts, Keeper::When::disk_full)) {
      throw;
    }
    parts.open();
  }
}

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
      part_end.had(count.first_us);
    }
  }
  answers.set_next_place(head.ends.row + 1);
  if (parts.has_current()) {
    hot.load(part().connection(), head.vocabulary);
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
    state.begin_part();
  }
  hot = HotLedger{};
  repacker.drop();
  answers.set_next_place(1);
  part_end.restart();
  ++stats.parts;
}

/// When that fails, the current part goes on, also into the next day: no poll is lost to it, and it is tried again.
bool LogWriter::Impl::change_part() {
  if (stats.commits < change_again_at) {
    return false;
  }
  try {
    next_part();
    change_fails = false;
    return true;
  } catch (const Error& error) {
    const auto* failed = dynamic_cast<const SqliteError*>(&error);
    if (failed != nullptr && failed->full() && keeper.remove_one(parts, Keeper::When::disk_full)) {
      return change_part();
    }
    change_again_at = stats.commits + kCommitsAfterFailure;
    if (!std::exchange(change_fails, true) && options.retention.tell) {
      options.retention.tell(fmt::format("the next part cannot be begun, the one before goes on: {}", error.what()));
    }
    return false;
  }
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
      write_removed();
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
    if (const std::optional<Gap> gap = session ? state.lost(id, *session) : std::nullopt) {
      part().put(*gap);
      state.add(*gap);
      stats.lost += gap->seq_count;
    }
  }
  unsaved.put(part());
}

/// Parts that are gone: the log says so in the session that goes on.
void LogWriter::Impl::write_removed() {
  if (session) {
    for (Event event : keeper.untold()) {
      event.session = session->id;
      part().put(event);
    }
    removed_told = true;
  }
}

void LogWriter::Impl::rolled_back() {
  part().rollback();
  lost = true;
  removed_told = false;
  coverage.demand();
  hot.roll_back();
  answers.rolled_back();
  committed_stats.parts = stats.parts;
  stats = committed_stats;
  for (auto& [id, state] : streams) {
    state.roll_back();
  }
}

void LogWriter::Impl::commit_rows() {
  if (lost || (session && !keeper.untold().empty())) {
    write([] {});  // what was lost belongs on record, and into this part, also when no poll follows
  }
  if (!part().in_transaction()) {
    return;
  }
  pack_kept();
  const auto start = std::chrono::steady_clock::now();
  write([this] { insert_packed(); });
  const bool all = coverage.due() || part_end.over(part().bytes());
  write([&] {
    all ? CoverageWriter::put_all(part(), *this, answers.last_place()) : CoverageWriter::put_news(part(), *this);
    part().commit();
  });
  coverage.committed(*this, all);
  committed();
  stats.last_commit = std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::steady_clock::now() - start);
}

/// What follows is done when the rows are safe.
void LogWriter::Impl::commit_all() {
  commit_rows();
  checkpoint();
  const Deadline until = pace.until();
  if (!part_end.over(part().bytes()) || !change_part()) {
    move_due(until);
    prepare_next();
  }
  const bool room = parts.tidy(until, keeper.now());
  if (keeper.remove_one(parts, room ? Keeper::When::as_usual : Keeper::When::disk_full)) {
    commit_rows();
  }
}

void LogWriter::Impl::commit() {
  try {
    commit_all();
  } catch (const SqliteError& error) {
    if (!error.full() || !keeper.remove_one(parts, Keeper::When::disk_full)) {
      throw;
    }
    commit_all();
  }
}

/// Where this fails, next_part() does all of it.
void LogWriter::Impl::prepare_next() {
  if (parts.prepared() || stats.commits < prepare_again_at || !part_end.near(part().bytes())) {
    return;
  }
  try {
    parts.prepare();
  } catch (const Error&) {
    prepare_again_at = stats.commits + kCommitsAfterFailure;
  }
}

/// Moves the rows of streams that have enough of them. All rows are committed; where this fails, they stay hot and
/// nothing is lost, so nobody has to be told before the next commit fails, too.
void LogWriter::Impl::move_due(Deadline until) {
  if (!options.blocks || stats.commits < move_again_at) {
    return;
  }
  if (!repacker.busy()) {
    const std::vector<StreamKey> due = hot.due();
    repacker.begin(hot, due);
    for (const StreamKey& key : due) {
      if (const auto open = streams.find({key.robot, key.source}); open != streams.end()) {
        open->second.forget_previous();
      }
    }
  }
  try {
    if (!repacker.busy() || !repacker.pack(part().connection(), until)) {
      return;
    }
    part().begin();
    CoverageWriter::put_all(part(), *this, answers.last_place());  // some of the hot rows it counts are no more
    repacker.store(part());
    part().commit();
  } catch (const SqliteError&) {
    part().rollback();
    repacker.drop();
    move_again_at = stats.commits + kCommitsAfterFailure;
    return;
  }
  coverage.committed(*this, true);
  repacker.stored(hot);
}

void LogWriter::Impl::committed() {
  lost = false;
  unsaved.clear();
  ++stats.commits;
  committed_stats = stats;
  hot.commit();
  for (auto& [id, state] : streams) {
    state.commit();
  }
  if (std::exchange(removed_told, false)) {
    keeper.told();
  }
}

void LogWriter::Impl::checkpoint() {
  if (part().wal_bytes() < options.wal_bytes) {
    return;
  }
  const bool complete = part().connection().checkpoint_passive();
  // A reader that stays for hours must not make the WAL grow without end: the next part has a WAL of its own.
  if (!complete && part().wal_bytes() >= kPinned * options.wal_bytes) {
    part_end.demand();
  }
}

void LogWriter::Impl::turn_day(Micros t_us) {
  if (part_end.excludes(t_us) && stats.commits >= change_again_at) {
    part_end.demand();
    commit();
  }
}

StreamState& LogWriter::Impl::stream(RobotId robot, Source source) {
  const auto found = streams.find({robot, source});
  assert(found != streams.end() && "a stream is declared before its first row");
  return found->second;
}

void LogWriter::Impl::keep(StreamState& state, const Answer& answer) {
  const bool full = answers.keep(state, answer);
  part_end.add(answer.meta.t_send_us);
  pace.see(answer.meta.t_send_us);
  state.count.add(answer.meta, answer.body.size());
  ++state.tally.stored;
  state.dirty = true;
  ++stats.rows;
  stats.body_bytes += answer.body.size();
  if (full) {
    pack_kept();
    insert_packed();
  }
}

void LogWriter::Impl::pack_kept() {
  if (session) {
    answers.pack(session->id, streams, hot);
  }
}

void LogWriter::Impl::insert_packed() { stats.stored_bytes += answers.insert(part()); }

void LogWriter::Impl::declare(const Stream& declared) {
  assert(session && declared.session == session->id);
  StreamState& state = streams[{declared.robot, declared.source}];
  state.row.stream = declared;
  state.row.stream.planned.reset();
  write([&] { part().put(state.row); });
  const auto last = earlier.find({declared.robot, declared.source});
  if (last == earlier.end() || declared.source == Source::ring) {  // of which only windows are recorded
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
  coverage.demand();
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

LogWriter::LogWriter(const fs::path& folder, WriterOptions options)
    : impl_(std::make_unique<Impl>(folder, std::move(options))) {}

LogWriter::~LogWriter() {
  try {
    impl_->coverage.demand();
    impl_->commit();
    impl_->parts.close(impl_->options.blocks ? impl_->hot : HotLedger{});
    impl_->parts.tidy(kNoDeadline, impl_->keeper.now());
  } catch (const Error&) {
    // What was committed is safe; the next opening closes the part.
  }
}

SessionId LogWriter::begin_session(const Session& session) {
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
  const RobotId id = impl_->id_of(name);
  Robot& robot = impl_->robots[id];
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
  const Robot& robot = impl_->learn(id, identity);
  impl_->write([&] { impl_->part().put(robot); });
}

void LogWriter::declare(const Stream& stream) { impl_->declare(stream); }
void LogWriter::restore_part(std::uint32_t number) {
  if (impl_->parts.skip_to(number)) {
    impl_->commit();
    impl_->next_part();
  }
}
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
    impl_->write([&] { impl_->keep(state, answer); });
  });
}

void LogWriter::note(const Sample& sample) {
  StreamState& state = impl_->stream(sample.meta.robot, sample.meta.source);
  const FieldSet seen = state.count.seen | sample.seen();
  const FieldSet valued = state.count.valued | sample.valued();
  state.news = state.news || seen != state.count.seen || valued != state.count.valued || !sample.decodable;
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
      state.add(gap);
    });
  });
}

void LogWriter::add(const Event& event) {
  impl_->unsaved.keep(event, [&] { impl_->write([&] { impl_->part().put(event); }); });
}

void LogWriter::add(const ClockPoint& point) {
  impl_->keeper.see(point);
  impl_->unsaved.keep(point, [&] { impl_->write([&] { impl_->part().put(point); }); });
}

void LogWriter::commit() { impl_->commit(); }
const LogWriter::Stats& LogWriter::stats() const { return impl_->stats; }
Forecast LogWriter::forecast() const { return impl_->keeper.forecast(impl_->parts.folder()); }

LogWriter::Tally LogWriter::tally(RobotId robot, Source source) const {
  if (const auto open = impl_->streams.find({robot, source}); open != impl_->streams.end()) {
    return open->second.committed_tally;
  }
  const auto ended = impl_->tallies.find({robot, source});
  return ended == impl_->tallies.end() ? Tally{} : ended->second;
}

}  // namespace tacho::store
