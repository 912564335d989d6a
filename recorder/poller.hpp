#pragma once
// One thread per robot and protocol: asks the sources of one connection when they are due, and accounts for every poll
// that was planned. stored + missed = planned holds per source when run() has returned.
//
// What a robot pushes is listened to instead: each push is due one period after the one before it, and what has not
// come half a period after it was due is missed. The period is that of the configuration until five pushes have told
// another (Pace).

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "recorder/clock.hpp"
#include "recorder/gap_tracker.hpp"
#include "recorder/link/link.hpp"
#include "recorder/pace.hpp"
#include "recorder/rates.hpp"
#include "recorder/robot_watch.hpp"
#include "recorder/schedule.hpp"

namespace tacho::recorder {

/// Where a poller puts what it got. Called from the poller's thread.
class Sink {
 public:
  virtual ~Sink() = default;
  /// `before`: the gap that this answer ends, to be written before it. False: the queue is full, both are not taken.
  [[nodiscard]] virtual bool answer(Answer answer, const std::optional<Gap>& before) = 0;
  virtual void gap(const Gap& gap) = 0;
  virtual void event(const Event& event) = 0;
  virtual void word_order(RobotId robot, Source source, WordOrder order) = 0;
};

struct PolledSource {
  Source source = Source::status;
  Rates rates = 1'000'000;
  Micros phase_us = 0;  ///< first poll after the start; keeps the sources of a connection apart; less than a period
  std::uint64_t first_seq = 0;  ///< number of the first poll: the stream goes on from an earlier poller
};

struct PollerOptions {
  RobotId robot = 0;
  SessionId session = 0;
  std::vector<PolledSource> sources;
  std::chrono::milliseconds timeout{1000};  ///< connecting included; one sweep for registers
  Micros spacing_us = 100'000;              ///< least distance between the starts of two polls on the connection
  // From the start of one attempt to the next while there is no connection; doubled after each.
  Micros backoff_min_us = 200'000;
  Micros retry_max_us = 500'000;
  Micros backoff_max_us = 5'000'000;   ///< of a robot that refuses further clients (61001)
  Micros silence_max_us = 30'000'000;  ///< of a source that is not answered while others on the connection are
  Micros gap_flush_us = 60'000'000;
  WordOrder word_order = WordOrder::cdab;  ///< until the link finds another
  RobotWatch* watch = nullptr;             ///< must outlive the poller; null: answers are not looked at
  /// Another robot has answered: called once, from the poller's thread, which polls no more.
  std::function<void(const Identity&)> stranger;
};

/// Counters of one source; written by the poller, readable from any thread.
struct SourceCounters {
  std::atomic<std::uint64_t> planned{0};  ///< by the schedule; final when run() has returned
  std::atomic<std::uint64_t> stored{0};
  std::atomic<Micros> period_us{0};  ///< in force; 0: the source was given up
  std::array<std::atomic<std::uint64_t>, kCauseCount> missed{};
  [[nodiscard]] std::uint64_t missed_total() const;
};

class Poller {
 public:
  /// `clock` and `sink` must outlive the poller.
  Poller(PollerOptions options, std::unique_ptr<Link> link, Clock& clock, Sink& sink);

  /// Polls from `start_us` until `end_us` (monotonic), or until the clock is stopped.
  void run(Micros start_us, Micros end_us);
  /// From any thread: ends a poll in progress.
  void interrupt() { link_->interrupt(); }

  [[nodiscard]] const PollerOptions& options() const { return options_; }
  /// `index`: position in options().sources.
  [[nodiscard]] const SourceCounters& counters(std::size_t index) const { return lanes_[index]->counters; }
  /// After run(): the last state.
  [[nodiscard]] bool link_up() const { return up_; }

 private:
  struct Outage {
    Cause cause = Cause::timeout;
    std::string detail;
    Micros until_us = 0;  // monotonic: what is due until then is lost by it
    Micros backoff_us = 0;
    Micros since_us = 0;  // monotonic
  };
  struct Lane {
    PolledSource plan;
    std::optional<Schedule> schedule;
    std::optional<GapTracker> gaps;
    SourceCounters counters;
    bool given_up = false;
    std::optional<Pace> pace;           ///< set: it is listened to
    std::optional<Outage> silence;      ///< of this source alone
    std::optional<Micros> tried_us;     ///< monotonic, when it was asked last
    std::optional<Micros> answered_us;  ///< ... and answered, be it with a refusal
  };

  Lane* next_lane();
  void adapt();
  void give_up(Lane& lane, const std::string& why);
  void emit_rate(Lane& lane, std::uint64_t seq, Micros period_us, const std::string& subject, const std::string& why);
  void serve(Lane& lane, Micros now_us);
  void poll(Lane& lane);
  void listen(Lane& lane);
  PollResult ask(Lane& lane, std::uint64_t seq);
  void store(Lane& lane, std::uint64_t seq, PollResult result);
  void miss(Lane& lane, std::uint64_t count, Cause cause, const std::string& detail);
  void judge_link(Lane& lane, const PollResult& result);
  void tell_link(const PollResult& result);
  [[nodiscard]] const Outage* held(const Lane& lane, Micros now_us) const;
  void follow_clock();
  void emit(const Lane& lane, std::uint64_t seq, const LinkNote& note);
  void flush_old_gaps();
  void finish(Micros end_us);
  [[nodiscard]] Micros wall_of(Micros mono_us) const;

  PollerOptions options_;
  std::unique_ptr<Link> link_;
  Clock& clock_;
  Sink& sink_;
  std::vector<std::unique_ptr<Lane>> lanes_;  // counters are atomics: not movable
  std::optional<Outage> outage_;              ///< of the connection
  /// While the last poll that failed went on; but for those of a source that is known to be silent.
  std::optional<Outage> lost_by_;
  std::atomic<bool> up_{false};
  bool announced_ = false;  // whether any link event was emitted: the first state is news, too
  Micros asked_us_ = 0;     // when the last poll began
  Micros not_before_us_ = 0;
  std::optional<Micros> wall_ahead_us_;  // of the monotonic clock
  std::optional<Identity> stranger_;
};

}  // namespace tacho::recorder
