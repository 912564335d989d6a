#pragma once
// Twins of clock, link and sink: time is a number, the robot is a function, rows land in vectors; and a poller among
// them.

#include <algorithm>
#include <chrono>
#include <functional>
#include <iterator>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "recorder/clock.hpp"
#include "recorder/link/link.hpp"
#include "recorder/poller.hpp"
#include "tests/support/catch.hpp"

namespace tacho::recorder::test {

inline constexpr Micros kSecond = 1'000'000;
inline constexpr Micros kWallStart = 1'767'225'600'000'000;

/// Sleeping moves it. Single-threaded.
class FakeClock final : public Clock {
 public:
  [[nodiscard]] Micros mono_us() const override { return now_; }
  [[nodiscard]] Micros wall_us() const override { return kWallStart + now_ + wall_step_; }
  bool sleep_until(Micros t) override {
    if (stop_at_ && std::max(now_, t) >= *stop_at_) {
      now_ = std::max(now_, *stop_at_);
      stopped_ = *stop_at_;
      return false;
    }
    now_ = std::max(now_, t);
    return true;
  }
  [[nodiscard]] std::optional<Micros> stopped_at() const override { return stopped_; }

  void pass(Micros us) {
    now_ += us;
    if (stop_at_ && now_ >= *stop_at_) {
      stopped_ = *stop_at_;
    }
  }
  void stop_at(Micros t) { stop_at_ = t; }
  void step_wall(Micros us) { wall_step_ += us; }

 private:
  Micros now_ = 0;
  Micros wall_step_ = 0;
  std::optional<Micros> stop_at_;
  std::optional<Micros> stopped_;
};

/// What a robot does with one poll.
struct Act {
  bool ok = true;
  Micros takes_us = 4'000;
  Cause cause = Cause::timeout;
  bool keeps_connection = false;  ///< of a failure
  std::string missing;            ///< non-empty: partial
  bool drops_connection = false;  ///< of a success
  std::string body = "{}";
  std::string give_up = "";
};

class FakeLink final : public Link {
 public:
  using Robot = std::function<Act(Source, Micros now)>;
  FakeLink(FakeClock& clock, Robot robot) : clock_(clock), robot_(std::move(robot)) {}

  PollResult poll(Source source, std::chrono::milliseconds timeout) override {
    const Act act = robot_(source, clock_.mono_us());
    asked.emplace_back(source, clock_.mono_us());
    PollResult result;
    result.t_send_us = clock_.wall_us();
    clock_.pass(std::min<Micros>(act.takes_us, std::chrono::microseconds(timeout).count()));
    result.t_recv_us = clock_.wall_us();
    result.ok = act.ok;
    result.cause = act.cause;
    result.detail = act.ok ? act.missing : "because";
    result.partial = act.ok && !act.missing.empty();
    result.body = act.ok ? act.body : "";
    result.give_up = act.give_up;
    connected_ = act.ok ? !act.drops_connection : act.keeps_connection;
    return result;
  }
  [[nodiscard]] bool connected() const override { return connected_; }
  void close() override { connected_ = false; }
  void interrupt() override {}

  std::vector<std::pair<Source, Micros>> asked;

 private:
  FakeClock& clock_;
  Robot robot_;
  bool connected_ = false;
};

class VectorSink final : public Sink {
 public:
  [[nodiscard]] bool answer(Answer a, const std::optional<Gap>& before) override {
    if (full && full()) {
      return false;
    }
    if (before) {
      gaps.push_back(*before);
    }
    answers.push_back(std::move(a));
    return true;
  }
  void gap(const Gap& g) override { gaps.push_back(g); }
  void event(const Event& e) override { events.push_back(e); }
  void word_order(RobotId, Source, WordOrder order) override { orders.push_back(order); }

  std::function<bool()> full;
  std::vector<Answer> answers;
  std::vector<Gap> gaps;
  std::vector<Event> events;
  std::vector<WordOrder> orders;
};

/// One poller with its world.
struct PollerBench {
  FakeClock clock;
  VectorSink sink;
  FakeLink* link = nullptr;
  std::unique_ptr<Poller> poller;

  PollerBench(std::vector<PolledSource> sources, FakeLink::Robot robot, Micros spacing_us = 0,
              std::chrono::milliseconds timeout = std::chrono::seconds(1)) {
    PollerOptions options;
    options.timeout = timeout;
    options.robot = 1;
    options.session = 1;
    options.sources = std::move(sources);
    options.spacing_us = spacing_us;
    auto made = std::make_unique<FakeLink>(clock, std::move(robot));
    link = made.get();
    poller = std::make_unique<Poller>(std::move(options), std::move(made), clock, sink);
  }

  void run(Micros until) { poller->run(0, until); }

  [[nodiscard]] std::vector<Gap> gaps(Source source, bool partial = false) const {
    std::vector<Gap> out;
    std::copy_if(sink.gaps.begin(), sink.gaps.end(), std::back_inserter(out),
                 [&](const Gap& g) { return g.source == source && g.partial == partial; });
    return out;
  }
  [[nodiscard]] std::size_t events(EventKind kind) const {
    return static_cast<std::size_t>(
        std::count_if(sink.events.begin(), sink.events.end(), [&](const Event& e) { return e.kind == kind; }));
  }
};

/// Counts from the rows alone how often each poll number occurs; all must be once.
inline void check_accounts(const PollerBench& bench) {
  for (std::size_t s = 0; s < bench.poller->options().sources.size(); ++s) {
    const Source source = bench.poller->options().sources[s].source;
    const SourceCounters& counters = bench.poller->counters(s);
    std::vector<int> seen(counters.planned.load(), 0);
    std::uint64_t stored = 0;
    std::uint64_t missed = 0;
    for (const Answer& a : bench.sink.answers) {
      if (a.meta.source == source) {
        ++seen.at(a.meta.seq);
        ++stored;
      }
    }
    for (const Gap& g : bench.sink.gaps) {
      for (std::uint64_t k = 0; g.source == source && !g.partial && k < g.seq_count; ++k) {
        ++seen.at(g.seq_from + k);
        ++missed;
      }
    }
    CHECK(std::all_of(seen.begin(), seen.end(), [](int n) { return n == 1; }));
    CHECK(stored == counters.stored.load());
    CHECK(missed == counters.missed_total());
    CHECK(stored + missed == counters.planned.load());
  }
}

}  // namespace tacho::recorder::test
