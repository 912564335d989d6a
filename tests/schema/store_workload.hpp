#pragma once
// A recording of two sources with misses and events that knows what its log has to hold: for tests that stop it, cut
// its power or let its disk fail at any moment.

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "schema/store/sqlite.hpp"
#include "tests/schema/store_fixture.hpp"

namespace tacho::test {

inline constexpr std::array<Source, 2> kWorkloadSources{Source::status, Source::registers};

/// What happens at a poll, and what the robot answers, follows from its number: expectations need no list.
inline bool misses(Source source, std::uint64_t seq) { return source == Source::status && seq % 11 == 7; }
inline std::string answer_body(SessionId session, Source source, std::uint64_t seq) {
  return body_of(session * 1'000'003 + static_cast<std::uint64_t>(source) * 500 + seq);
}

/// Polls of one stream in one session: before `acknowledged` all are in the log, from `appended` on none is.
struct Extent {
  std::uint64_t acknowledged = 0;
  std::uint64_t appended = 0;
  std::set<std::uint64_t> lost;  ///< an Error was thrown before they were acknowledged: a gap row of cause disk will do
};

/// What the log of a workload has to hold.
struct Ledger {
  std::map<std::pair<SessionId, Source>, Extent> streams;
  std::vector<std::uint64_t> events;      ///< acknowledged; numbered from 1
  std::vector<std::uint64_t> new_events;  ///< not yet
  std::uint64_t last_event = 0;

  void acknowledge(SessionId session) {
    for (auto& [key, extent] : streams) {
      extent.acknowledged = key.first == session ? extent.appended : extent.acknowledged;
    }
    events.insert(events.end(), new_events.begin(), new_events.end());
    new_events.clear();
  }
  /// An Error was thrown: all since the last commit may be lost.
  void excuse(SessionId session) {
    for (auto& [key, extent] : streams) {
      for (std::uint64_t seq = extent.acknowledged; key.first == session && seq < extent.appended; ++seq) {
        extent.lost.insert(seq);
      }
    }
    new_events.clear();
  }
};

inline store::WriterOptions workload_options() {
  store::WriterOptions options;
  options.part_bytes = 80'000;  // an empty part has some 63 500
  options.wal_bytes = 64'000;   // several checkpoints in a part
  options.keyframe_every = 10;
  return options;
}

/// One session. Every step may throw Error; the ledger is right also then.
class Workload {
 public:
  Workload(const std::filesystem::path& folder, Ledger& ledger, store::WriterOptions options = workload_options())
      : ledger_(&ledger), writer_(folder, options) {}

  /// `t0_us`: time of poll 0; a poll every `period_us`.
  void begin(Micros t0_us, Micros period_us = kSecond) {
    t0_us_ = t0_us;
    period_us_ = period_us;
    next_ = 0;
    ledger_->new_events.clear();
    Session start;
    start.t_start_us = t0_us;
    start.software = "test";
    robot_ = writer_.robot("amr-1", "127.0.0.1:19204:502");
    session_ = writer_.begin_session(start);
    for (const Source source : kWorkloadSources) {
      ledger_->streams[{session_, source}] = {};
    }
    declare();
  }
  void declare() {
    for (const Source source : kWorkloadSources) {
      writer_.declare(stream_of(session_, robot_, source, period_us_));
    }
  }

  void poll() {
    for (const Source source : kWorkloadSources) {
      attempt([&] { poll(source); });
    }
    ++next_;
    if (next_ % 5 == 0) {
      attempt([&] { event(); });
    }
    rethrow();
  }
  void commit() {
    attempt([&] { writer_.commit(); });
    rethrow();
    ledger_->acknowledge(session_);
  }
  void end(bool clean = true) {
    attempt([&] { writer_.end_session(time(), clean); });
    rethrow();
    ledger_->acknowledge(session_);
  }

  /// Times of polls to come are that much later.
  void step_clock(Micros by_us) { t0_us_ += by_us; }

  [[nodiscard]] store::LogWriter& writer() { return writer_; }
  [[nodiscard]] SessionId session() const { return session_; }
  [[nodiscard]] std::uint64_t next() const { return next_; }
  [[nodiscard]] Micros time() const { return t0_us_ + static_cast<Micros>(next_) * period_us_; }

 private:
  Ledger* ledger_;
  store::LogWriter writer_;
  Micros t0_us_ = 0;
  Micros period_us_ = 0;
  RobotId robot_ = 0;
  SessionId session_ = 0;
  std::uint64_t next_ = 0;
  std::exception_ptr error_;

  /// All of a step is tried, as the recorder does, before its first error is thrown.
  template <class Work>
  void attempt(Work work) {
    try {
      work();
    } catch (const Error&) {
      ledger_->excuse(session_);
      error_ = std::current_exception();
    }
  }
  void rethrow() {
    if (error_) {
      std::rethrow_exception(std::exchange(error_, nullptr));
    }
  }

  void poll(Source source) {
    ledger_->streams[{session_, source}].appended = next_ + 1;
    if (misses(source, next_)) {
      writer_.add(gap_of(session_, robot_, source, next_, 1, time()));
    } else {
      writer_.append(answer_of(session_, robot_, source, next_, time(), answer_body(session_, source, next_)));
    }
  }
  void event() {
    Event mark;
    mark.robot = robot_;
    mark.session = session_;
    mark.seq = next_;
    mark.t_from_us = mark.t_us = time();
    mark.subject = std::to_string(++ledger_->last_event);
    ledger_->new_events.push_back(ledger_->last_event);
    writer_.add(mark);
  }
};

/// What came out of a log; empty `fault` when nothing speaks against the ledger.
struct Verdict {
  std::string fault;
  std::uint64_t answers = 0;
  std::uint64_t lost = 0;  ///< acknowledged or not, polls in gap rows of `disk` or `recorder_killed`
};

namespace detail {

struct Found {
  std::map<std::pair<SessionId, Source>, std::set<std::uint64_t>> answers;
  std::map<std::pair<SessionId, Source>, std::vector<Gap>> gaps;
  std::set<std::uint64_t> events;
};

inline std::string named(SessionId session, Source source, std::uint64_t seq) {
  return "session " + std::to_string(session) + " " + std::string(source_name(source)) + " poll " + std::to_string(seq);
}

inline void take_answers(store::LogReader& log, RobotId robot, Found& found, Verdict& verdict) {
  for (const Source source : kWorkloadSources) {
    std::pair<SessionId, std::uint64_t> last{0, 0};
    log.read_raw(robot, source, {}, [&](const Answer& a) {
      const std::pair<SessionId, std::uint64_t> place{a.meta.session, a.meta.seq + 1};
      if (place <= last) {
        verdict.fault = "out of order: " + named(a.meta.session, source, a.meta.seq);
      }
      if (misses(source, a.meta.seq) || a.body != answer_body(a.meta.session, source, a.meta.seq)) {
        verdict.fault = "never asked for, or not what was answered: " + named(a.meta.session, source, a.meta.seq);
      }
      last = place;
      found.answers[{a.meta.session, source}].insert(a.meta.seq);
      ++verdict.answers;
    });
  }
}

inline void take_records(store::LogReader& log, RobotId robot, Found& found) {
  Selection selection;
  for (const Source source : kWorkloadSources) {
    selection.add(source, field("x"));
  }
  log.read(robot, {}, selection, [&](const Slice& slice) {
    for (const Gap& gap : slice.gaps) {
      if (!gap.partial && gap.seq_count > 0) {
        found.gaps[{gap.session, gap.source}].push_back(gap);
      }
    }
    for (const Event& event : slice.events) {
      found.events.insert(std::stoull(event.subject));
    }
  });
}

inline std::optional<Cause> cause_of(const Found& found, SessionId session, Source source, std::uint64_t seq) {
  const auto gaps = found.gaps.find({session, source});
  if (gaps != found.gaps.end()) {
    for (const Gap& gap : gaps->second) {
      if (seq >= gap.seq_from && seq < gap.seq_from + gap.seq_count) {
        return gap.cause;
      }
    }
  }
  return std::nullopt;
}

inline void judge_poll(const Found& found, SessionId session, Source source, std::uint64_t seq, const Extent& extent,
                       Verdict& verdict) {
  const auto answers = found.answers.find({session, source});
  const bool answered = answers != found.answers.end() && answers->second.count(seq) > 0;
  const std::optional<Cause> cause = cause_of(found, session, source, seq);
  if (answered && cause) {
    verdict.fault = "answered and missed: " + named(session, source, seq);
  }
  const bool loss = cause && (*cause == Cause::disk || *cause == Cause::recorder_killed);
  verdict.lost += loss ? 1 : 0;
  const bool kept = misses(source, seq) ? cause.has_value() : answered;
  const bool excused = extent.lost.count(seq) > 0 && cause == Cause::disk;
  if (seq < extent.acknowledged && (loss || !kept) && !excused) {
    verdict.fault = "acknowledged and lost: " + named(session, source, seq);
  }
}

inline void judge_streams(store::LogReader& log, const Found& found, const Ledger& ledger, bool repaired,
                          Verdict& verdict) {
  for (const auto& [key, extent] : ledger.streams) {
    for (std::uint64_t seq = 0; seq < extent.appended; ++seq) {
      judge_poll(found, key.first, key.second, seq, extent, verdict);
    }
  }
  for (const auto& [key, answers] : found.answers) {
    const auto known = ledger.streams.find(key);
    if (known == ledger.streams.end() || *answers.rbegin() >= known->second.appended) {
      verdict.fault = "never appended: " + named(key.first, key.second, *answers.rbegin());
    }
  }
  for (const Stream& stream : log.streams()) {
    if (repaired && !stream.planned) {
      verdict.fault = "a stream without an end";
    }
    for (std::uint64_t seq = 0; repaired && seq < stream.planned.value_or(0); ++seq) {
      const auto answers = found.answers.find({stream.session, stream.source});
      const bool answered = answers != found.answers.end() && answers->second.count(seq) > 0;
      if (!answered && !cause_of(found, stream.session, stream.source, seq)) {
        verdict.fault = "neither answered nor in a gap row: " + named(stream.session, stream.source, seq);
      }
    }
  }
}

inline void judge_sums(store::LogReader& log, const Found& found, bool repaired, Verdict& verdict) {
  for (const Coverage& coverage : log.coverage()) {
    std::uint64_t answers = 0;
    for (const auto& [key, seqs] : found.answers) {
      answers += key.second == coverage.source ? seqs.size() : 0;
    }
    if (coverage.stored != answers) {
      verdict.fault = "coverage counts " + std::to_string(coverage.stored) + " of " + std::to_string(answers);
    }
    if (repaired && coverage.stored + coverage.missed != coverage.planned) {
      verdict.fault = "stored " + std::to_string(coverage.stored) + " + missed " + std::to_string(coverage.missed) +
                      " is not planned " + std::to_string(coverage.planned);
    }
  }
}

}  // namespace detail

/// Reads the log of a workload and compares it with its ledger. `repaired`: a writer has opened the log since it
/// stopped.
inline Verdict judge(const std::filesystem::path& folder, const Ledger& ledger, bool repaired = true) {
  Verdict verdict;
  store::LogReader log = open_reader(folder);
  detail::Found found;
  for (const Robot& robot : log.robots()) {
    detail::take_answers(log, robot.id, found, verdict);
    detail::take_records(log, robot.id, found);
  }
  detail::judge_streams(log, found, ledger, repaired, verdict);
  detail::judge_sums(log, found, repaired, verdict);
  for (const std::uint64_t event : ledger.events) {
    if (found.events.count(event) == 0) {
      verdict.fault = "acknowledged and lost: event " + std::to_string(event);
    }
  }
  for (const Session& session : log.sessions()) {
    if (repaired && session.t_end_us == 0) {
      verdict.fault = "session " + std::to_string(session.id) + " has no end";
    }
  }
  for (const ReadProblem& problem : log.problems()) {
    verdict.fault = problem.where + ": " + problem.what;
  }
  return verdict;
}

/// What SQLite itself says about the parts of a folder; "" when all is well.
inline std::string integrity_of(const std::filesystem::path& folder) {
  for (const std::filesystem::path& part : part_files(folder)) {
    store::Connection connection(part, store::OpenMode::write);
    const std::string answer = connection.scalar("PRAGMA integrity_check");
    if (answer != "ok") {
      return part.filename().string() + ": " + answer;
    }
  }
  return "";
}

}  // namespace tacho::test
