// The incident ring: what it keeps, what sets it off, and that every poll is accounted for.

#include "recorder/ring.hpp"

#include <random>

#include "tests/recorder/fakes.hpp"
#include "tests/support/catch.hpp"

using namespace tacho;
using namespace tacho::recorder;
using namespace tacho::recorder::test;

namespace {

constexpr Micros kPeriod = 200'000;

struct Bench {
  std::vector<Ring::Row> written;
  std::vector<Event> announced;
  std::uint64_t next = 0;  // of the poller
  Ring ring;

  explicit Bench(RingSettings settings = {})
      : ring(
            settings, [this](const Ring::Row& row) { written.push_back(row); },
            [this](const Event& event) { announced.push_back(event); }) {}

  void poll(RobotId robot, Micros now_us, std::size_t bytes = 1000, std::uint64_t missed = 0) {
    Ring::Row row;
    if (missed > 0) {
      row.gap = Gap{robot, Source::ring, 1, next, missed, 0, 0, Cause::timeout, false, {}};
      next += missed;
    }
    row.answer.emplace();
    row.answer->meta = {robot, Source::ring, 1, next++, kWallStart + now_us, kWallStart + now_us};
    row.answer->body.assign(bytes, 'x');
    ring.add(robot, std::move(row), now_us);
  }
  void polls(Micros from_us, Micros to_us) {
    for (Micros t = from_us; t < to_us; t += kPeriod) {
      poll(1, t);
    }
  }
};

Event event_of(EventKind kind, const std::string& subject, const std::string& from, const std::string& to,
               RobotId robot = 1) {
  Event event;
  event.robot = robot;
  event.kind = kind;
  event.subject = subject;
  event.old_value = from;
  event.new_value = to;
  return event;
}

const Event kBlocked = event_of(EventKind::blocked, "", "false", "true");

}  // namespace

TEST_CASE("what sets the ring off: errors, blocked, emergency, pose jumps and marks, when they begin") {
  const auto why = [](EventKind kind, const std::string& subject, const std::string& from, const std::string& to) {
    return ring_trigger(event_of(kind, subject, from, to));
  };
  CHECK(why(EventKind::alarm_raised, "error 52201", "0", "1") == "alarm_raised error 52201");
  CHECK(why(EventKind::alarm_raised, "fatal 50101", "0", "1") == "alarm_raised fatal 50101");
  CHECK(why(EventKind::alarm_raised, "warning 54001", "0", "1") == "");
  CHECK(why(EventKind::alarm_raised, "error 52201", "", "1") == "");  // stands already
  CHECK(why(EventKind::alarm_cleared, "error 52201", "1", "0") == "");
  CHECK(why(EventKind::blocked, "", "false", "true") == "blocked");
  CHECK(why(EventKind::blocked, "", "true", "false") == "");
  CHECK(why(EventKind::emergency, "software", "false", "true") == "emergency software");
  CHECK(why(EventKind::driver_emergency, "", "false", "true") == "driver_emergency");
  CHECK(why(EventKind::pose_jump, "", "0 0 0", "1 1 1") == "pose_jump");
  CHECK(why(EventKind::mark, "", "", "") == "mark");
  CHECK(why(EventKind::slowed, "", "false", "true") == "");
}

TEST_CASE("nothing is written while nothing happens, and what ages out is counted") {
  Bench bench({10 * kSecond, 5 * kSecond, 1u << 20, 1u << 30});
  bench.polls(0, 60 * kSecond);
  CHECK(bench.written.empty());
  CHECK(bench.announced.empty());
  CHECK(bench.ring.counts(1).aged_out == 300 - 51);
  bench.ring.end();
  CHECK(bench.ring.counts(1).aged_out == 300);
  CHECK(bench.ring.bytes() == 0);
}

TEST_CASE("a trigger writes the window before and after it, without a hole, numbered from where the log stands") {
  Bench bench({10 * kSecond, 5 * kSecond, 1u << 20, 1u << 30});
  bench.polls(0, 30 * kSecond);
  bench.ring.trigger(kBlocked, "blocked", 30 * kSecond);
  bench.polls(30 * kSecond, 60 * kSecond);
  REQUIRE(bench.written.size() == 50 + 25);
  for (std::size_t i = 0; i < bench.written.size(); ++i) {
    CHECK(bench.written[i].answer->meta.seq == i);
    CHECK(bench.written[i].answer->meta.t_recv_us == kWallStart + 20 * kSecond + static_cast<Micros>(i) * kPeriod);
  }
  REQUIRE(bench.announced.size() == 1);
  CHECK(bench.announced[0].kind == EventKind::ring_kept);
  CHECK(bench.announced[0].subject == "blocked");
  CHECK(bench.announced[0].old_value == "100");
  CHECK(bench.announced[0].new_value == "50");
  CHECK(bench.announced[0].seq == 0);

  bench.ring.trigger(kBlocked, "blocked", 60 * kSecond);
  REQUIRE(bench.announced.size() == 2);
  CHECK(bench.announced[1].seq == 75);
  CHECK(bench.announced[1].old_value == "75");  // of the 125 after the first window
  CHECK(bench.written.back().answer->meta.seq == 124);
}

TEST_CASE("another trigger in an open window makes it longer and is not announced") {
  Bench bench({2 * kSecond, 5 * kSecond, 1u << 20, 1u << 30});
  bench.polls(0, 10 * kSecond);
  bench.ring.trigger(kBlocked, "blocked", 10 * kSecond);
  bench.polls(10 * kSecond, 14 * kSecond);
  bench.ring.trigger(kBlocked, "blocked", 14 * kSecond);
  bench.polls(14 * kSecond, 30 * kSecond);
  CHECK(bench.announced.size() == 1);
  CHECK(bench.written.size() == 10 + 20 + 25);
}

TEST_CASE("the budget holds for all robots together, the oldest answers go first") {
  Bench bench({60 * kSecond, 5 * kSecond, 50'000, 1u << 30});
  for (Micros t = 0; t < 20 * kSecond; t += kPeriod) {
    bench.poll(1, t);
    bench.poll(2, t);
    CHECK(bench.ring.bytes() <= 50'000);
  }
  bench.poll(3, 20 * kSecond, 200'000);  // one answer that is larger than the budget
  CHECK(bench.ring.bytes() == 0);
  CHECK(bench.ring.counts(1).aged_out + bench.ring.counts(2).aged_out == 200);
  CHECK(bench.ring.counts(3).aged_out == 1);
}

TEST_CASE("what a day may cost is the end of it until the next one, told once") {
  Bench bench({10 * kSecond, 5 * kSecond, 1u << 20, 40'000});
  for (Micros t = 0; t < 100 * kSecond; t += 10 * kSecond) {
    bench.polls(t, t + 10 * kSecond);
    bench.ring.trigger(kBlocked, "blocked", t + 10 * kSecond);
  }
  CHECK(bench.written.size() >= 40);
  CHECK(bench.written.size() < 110);
  CHECK(bench.announced.back().new_value == "0");
  CHECK(std::count_if(bench.announced.begin(), bench.announced.end(),
                      [](const Event& e) { return e.new_value == "0"; }) == 1);
  const std::size_t before = bench.written.size();
  const Micros tomorrow = Micros{90'000} * kSecond;
  bench.polls(tomorrow, tomorrow + 10 * kSecond);
  bench.ring.trigger(kBlocked, "blocked", tomorrow + 10 * kSecond);
  CHECK(bench.written.size() == before + 50);
}

TEST_CASE("a window that the day's budget cuts off says so, where it ends") {
  Bench bench({10 * kSecond, 50 * kSecond, 1u << 20, 40'000});
  bench.polls(0, 10 * kSecond);
  bench.ring.trigger(kBlocked, "blocked", 10 * kSecond);
  bench.polls(10 * kSecond, 60 * kSecond);
  REQUIRE(bench.announced.size() == 2);
  CHECK(bench.announced[1].kind == EventKind::ring_kept);
  CHECK(bench.announced[1].subject == "blocked");
  CHECK(bench.announced[1].new_value == "0");
  CHECK(bench.announced[1].detail.find("cut off") != std::string::npos);
  CHECK(bench.announced[1].seq == bench.written.size());
  CHECK(bench.announced[1].t_us > bench.announced[0].t_us);
  CHECK(bench.written.size() < 300);

  Bench again({10 * kSecond, 50 * kSecond, 1u << 20, 40'000});
  again.polls(0, 10 * kSecond);
  again.ring.trigger(kBlocked, "blocked", 10 * kSecond);
  Micros t = 10 * kSecond;
  for (std::size_t before = 0; before != again.written.size(); t += kPeriod) {  // until nothing more would be written
    before = again.written.size();
    again.poll(1, t);
  }
  CHECK(again.announced.size() == 2);
}

TEST_CASE("a trigger of a robot without a ring, or of another one, opens nothing") {
  Bench bench;
  bench.polls(0, 10 * kSecond);
  bench.ring.trigger(event_of(EventKind::mark, "", "", "", 2), "mark", 10 * kSecond);
  bench.polls(10 * kSecond, 12 * kSecond);
  CHECK(bench.written.empty());
}

TEST_CASE("every poll is written, kept or aged out, whatever happens when") {
  std::mt19937 random(3);
  for (int round = 0; round < 20; ++round) {
    Bench bench({static_cast<Micros>(1 + random() % 20) * kSecond, static_cast<Micros>(1 + random() % 9) * kSecond,
                 20'000 + random() % 100'000, 1u << 30});
    for (Micros t = 0; t < 200 * kSecond; t += kPeriod) {
      bench.poll(1, t, random() % 3000, random() % 10 == 0 ? 1 + random() % 5 : 0);
      if (random() % 50 == 0) {
        bench.ring.trigger(kBlocked, "blocked", t);
      }
    }
    bench.ring.end();
    std::uint64_t polls = 0;
    for (const Ring::Row& row : bench.written) {
      CHECK((!row.gap || row.gap->seq_from == polls));
      polls += row.polls();
      CHECK(row.answer->meta.seq == polls - 1);
    }
    CHECK(polls == bench.ring.counts(1).written);
    CHECK(polls + bench.ring.counts(1).aged_out == bench.next);
  }
}
