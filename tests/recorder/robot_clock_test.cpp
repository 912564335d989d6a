// What a robot's answers say of its clock, against the simulator, which knows.

#include <fmt/format.h>

#include <cmath>
#include <random>

#include "recorder/robot_clock.hpp"
#include "samples/simulator/answers.hpp"
#include "samples/simulator/robot.hpp"
#include "schema/log.hpp"
#include "tests/support/catch.hpp"

using namespace tacho;
using recorder::RobotClock;

namespace {

constexpr Micros kStart = 1'767'225'600'000'000;
constexpr Micros kSecond = 1'000'000;

/// A robot whose clock is off, asked over a network with a jitter of its own.
class Site {
 public:
  explicit Site(double clock_offset_s, std::uint64_t seed = 1) : random_(seed), scenario_(scenario(clock_offset_s)) {}

  /// Asks at `t_us` by the host's clock, which is `host_ahead_us` ahead of the true time.
  void ask(Source source, Micros t_us, Micros host_ahead_us = 0) {
    const Micros there = 1000 + static_cast<Micros>(random_() % 4000);
    const Micros back = 1000 + static_cast<Micros>(random_() % 4000);
    const sim::RobotState& state = robot_.at(t_us + there);
    Answer answer;
    answer.meta.source = source;
    answer.meta.t_send_us = t_us + host_ahead_us;
    answer.meta.t_recv_us = t_us + there + back + host_ahead_us;
    answer.body = answers_.body(source, state);
    Sample sample;
    Gates gates;
    decode_(answer, Stream{}, FieldSet().set(), gates, sample);
    clock.see(sample);
  }
  /// For `seconds` at `hz`, each poll up to 2 ms late.
  void ask_for(Source source, Micros from_us, int seconds, int hz, Micros host_ahead_us = 0) {
    for (int i = 0; i < seconds * hz; ++i) {
      ask(source, from_us + i * (kSecond / hz) + static_cast<Micros>(random_() % 2000), host_ahead_us);
    }
  }

  RobotClock clock;

 private:
  static sim::Scenario scenario(double clock_offset_s) {
    sim::Scenario out = sim::busy_day(1);
    out.clock_offset_s = clock_offset_s;
    return out;
  }
  std::mt19937_64 random_;
  sim::Scenario scenario_;
  sim::Robot robot_{scenario_, kStart};
  sim::AnswerMaker answers_{scenario_};
  store::Decode decode_ = answer_decode();
};

double seconds(std::optional<Micros> us) {
  REQUIRE(us);
  return static_cast<double>(*us) / 1e6;
}

}  // namespace

TEST_CASE("a robot's clock is known to 50 ms from one stamp of its answers") {
  double worst = 0;
  for (const double truth : {0.0, 0.4, -3.217, 61.0, -3599.5, 86'400.0, 31'536'000.25}) {
    Site site(truth);
    for (int i = 0; i < 50; ++i) {
      site.ask(Source::status, kStart + kSecond * i);
      worst = std::max(worst, std::abs(seconds(site.clock.offset_us()) - truth));
    }
  }
  fmt::print("create_on: {:.1f} ms at most beside the truth\n", worst * 1e3);
  CHECK(worst <= 0.050);
}

TEST_CASE("a robot's clock is known to 0.15 s from registers of whole seconds, whenever in a second they are asked") {
  double worst = 0;
  for (const double truth : {0.0, 0.4, -3.217, 61.0, -440.0, 440.0}) {
    for (int phase = 0; phase < 10; ++phase) {
      Site site(truth, static_cast<std::uint64_t>(phase) + 1);
      site.ask_for(Source::registers, kStart + phase * 20'000, 3, 5);
      worst = std::max(worst, std::abs(seconds(site.clock.offset_us()) - truth));
    }
  }
  fmt::print("registers at 5 Hz: {:.1f} ms at most beside the truth\n", worst * 1e3);
  CHECK(worst <= 0.150);
}

TEST_CASE("registers that were asked before the second changed tell nothing yet") {
  Site site(0.0);
  site.ask(Source::registers, kStart + 500'000);
  CHECK_FALSE(site.clock.offset_us());
}

TEST_CASE("registers asked once a second tell the clock when the polls wander through the second, else nothing") {
  Site fixed(0.25);
  for (int i = 0; i < 50; ++i) {
    fixed.ask(Source::registers, kStart + i * kSecond);
  }
  CHECK_FALSE(fixed.clock.offset_us());
  Site wandering(0.25);
  for (int i = 0; i < 50; ++i) {
    wandering.ask(Source::registers, kStart + i * 1'030'000);
  }
  CHECK(std::abs(seconds(wandering.clock.offset_us()) - 0.25) <= 0.150);
}

TEST_CASE("a clock that is set, the robot's or the host's, is known anew within seconds") {
  for (const Micros step : {3'600 * kSecond + 2'400'000, -3'600 * kSecond - 2'400'000, kSecond / 2}) {
    Site site(1.0);
    site.ask_for(Source::registers, kStart, 30, 5);
    site.ask_for(Source::registers, kStart + 30 * kSecond, 3, 5, step);
    const double expected = 1.0 - static_cast<double>(step % (900 * kSecond)) / 1e6;
    CHECK(std::abs(seconds(site.clock.offset_us()) - expected) <= 0.150);
  }
}

TEST_CASE("registers, which know neither zone nor milliseconds, do not replace what a stamp has told") {
  Site site(1800.0);
  site.ask_for(Source::registers, kStart, 3, 5);
  CHECK(std::abs(seconds(site.clock.offset_us())) <= 0.150);  // two quarters of an hour could be a zone
  site.ask(Source::status, kStart + 4 * kSecond);
  site.ask_for(Source::registers, kStart + 5 * kSecond, 20, 5);
  CHECK(std::abs(seconds(site.clock.offset_us()) - 1800.0) <= 0.050);
}
