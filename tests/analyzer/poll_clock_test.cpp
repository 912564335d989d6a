// Which pauses between two answers are gaps, when the rate of a source changes while it is recorded.

#include "analyzer/analyses/poll_clock.hpp"

#include "tests/support/catch.hpp"

using namespace tacho;

namespace {

constexpr Micros kSecond = 1'000'000;

Event rate(std::uint64_t seq, Micros t_us, const std::string& period, const std::string& doing) {
  Event event;
  event.kind = EventKind::rate;
  event.seq = seq;
  event.t_us = event.t_from_us = t_us;
  event.subject = doing;
  event.new_value = period;
  return event;
}

/// Polls of one session, by number and time.
struct Rows {
  PollClock clock;
  std::uint64_t seq = 0;
  Micros t_us = 0;
  std::size_t gaps = 0;

  explicit Rows(Micros planned_us) : clock({planned_us, Source::status}, 3.0) {}
  void changed(const Event& event) {
    Slice slice;
    slice.session = 1;
    slice.events.push_back(event);
    clock.open(slice);
  }
  void polls(int count, Micros period_us) {
    for (int i = 0; i < count; ++i) {
      gaps += clock.step(1, seq, t_us) == PollClock::Step::gap ? 1U : 0U;
      ++seq;
      t_us += period_us;
    }
  }
};

}  // namespace

TEST_CASE("slower polling of a standing robot is no gap, in both directions") {
  Rows rows(200'000);
  rows.polls(100, 200'000);
  rows.changed(rate(rows.seq, rows.t_us, "5.0 s", "idle"));
  rows.t_us += 4 * kSecond;  // to the slow grid
  rows.polls(20, 5 * kSecond);
  CHECK(rows.clock.period_us() == 5 * kSecond);
  rows.changed(rate(rows.seq, rows.t_us, "200 ms", "moving"));
  rows.polls(100, 200'000);
  CHECK(rows.gaps == 0);
  CHECK(rows.clock.period_us() == 200'000);
}

TEST_CASE("a hole is a gap at once at the rate that is in force, not at the one before") {
  Rows rows(200'000);
  rows.polls(50, 200'000);
  rows.changed(rate(rows.seq, rows.t_us, "5.0 s", "idle"));
  rows.polls(20, 5 * kSecond);
  rows.changed(rate(rows.seq, rows.t_us, "200 ms", "moving"));
  rows.polls(2, 200'000);
  rows.seq += 9;
  rows.t_us += 9 * 200'000;
  rows.polls(2, 200'000);
  CHECK(rows.gaps == 1);
}

TEST_CASE("without an event the same pauses are gaps until the period is known") {
  Rows rows(200'000);
  rows.polls(50, 200'000);
  rows.polls(5, 5 * kSecond);
  CHECK(rows.gaps > 0);
}

TEST_CASE("rows that begin while the robot stands are no gaps") {
  Rows rows(200'000);  // the first rate of the session; its change lies before the first row
  rows.seq = 1000;
  rows.polls(20, 5 * kSecond);
  CHECK(rows.gaps == 0);
}
