#pragma once
// Twins of clock, link and sink: time is a number, the robot is a function, rows land in vectors.

#include <functional>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "recorder/clock.hpp"
#include "recorder/link/link.hpp"
#include "recorder/poller.hpp"

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

}  // namespace tacho::recorder::test
