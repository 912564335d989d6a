// How often a robot is asked: by what it is doing, on grids that never drift, and accounted for from the log alone.

#include "recorder/rates.hpp"

#include <random>
#include <thread>

#include "recorder/robot_watch.hpp"
#include "tests/recorder/fakes.hpp"
#include "tests/support/catch.hpp"

using namespace tacho;
using namespace tacho::recorder;
using namespace tacho::recorder::test;

namespace {

constexpr const char* kMoving = R"({"vx":0.8,"vy":0,"w":0,"task_status":2,"charging":false})";
constexpr const char* kIdle = R"({"vx":-0.0,"vy":0,"w":1e-4,"task_status":4,"charging":false})";
constexpr const char* kCharging = R"({"vx":0,"vy":0,"w":0,"task_status":0,"charging":true})";
const Rates kRates(200'000, kSecond, 5 * kSecond);

Activities just(Activity activity) { return Activities().set(static_cast<std::size_t>(activity)); }

/// A watch that is told bodies of status answers.
struct Told {
  AnswerReader reader;
  RobotWatch watch{RobotWatch::Options{}, reader};
  void tell(Micros at, const std::string& body, Source source = Source::status) {
    Answer answer;
    answer.meta.source = source;
    answer.body = body;
    CHECK_FALSE(watch.look(answer, WordOrder::cdab, at));
  }
};

struct Bench {
  FakeClock clock;
  VectorSink sink;
  AnswerReader reader;
  RobotWatch watch{RobotWatch::Options{}, reader};
  FakeLink* link = nullptr;
  std::unique_ptr<Poller> poller;

  Bench(std::vector<PolledSource> sources, FakeLink::Robot robot) {
    PollerOptions options;
    options.robot = options.session = 1;
    options.sources = std::move(sources);
    options.spacing_us = 0;
    options.watch = &watch;
    auto made = std::make_unique<FakeLink>(clock, std::move(robot));
    link = made.get();
    poller = std::make_unique<Poller>(std::move(options), std::move(made), clock, sink);
  }

  [[nodiscard]] std::vector<Event> rates(Source source) const {
    std::vector<Event> out;
    std::copy_if(sink.events.begin(), sink.events.end(), std::back_inserter(out),
                 [&](const Event& e) { return e.kind == EventKind::rate && e.source == source; });
    return out;
  }
  [[nodiscard]] std::uint64_t accounted(Source source) const {
    std::vector<std::uint64_t> seen;
    for (const Answer& answer : sink.answers) {
      if (answer.meta.source == source) {
        seen.push_back(answer.meta.seq);
      }
    }
    for (const Gap& gap : sink.gaps) {
      for (std::uint64_t k = 0; gap.source == source && k < gap.seq_count; ++k) {
        seen.push_back(gap.seq_from + k);
      }
    }
    std::sort(seen.begin(), seen.end());
    for (std::size_t k = 0; k < seen.size(); ++k) {
      REQUIRE(seen[k] == k);
    }
    return seen.size();
  }
};

/// What a reader of the log makes of the first period and the events: how many polls were planned until the end.
std::uint64_t planned_by_log(const std::vector<Event>& rates, Micros first_period, Micros end) {
  std::uint64_t count = 0;
  Micros period = first_period;
  Micros from = 0;
  const auto grid = [&](Micros until) { return (until - from + period - 1) / period; };  // from is on the grid
  for (const Event& rate : rates) {
    CHECK(parse_rate(rate.old_value) == period);
    count = rate.seq;
    period = *parse_rate(rate.new_value);
    from = ((rate.t_us - kWallStart) / period + 1) * period;
  }
  return period == 0 ? count : count + static_cast<std::uint64_t>(std::max<Micros>(0, grid(end)));
}

}  // namespace

TEST_CASE("polls lie on grids through one origin and keep their numbers, however often the period changes") {
  std::mt19937 random(11);
  constexpr std::array<Micros, 4> kPeriods{50'000, 70'000, 200'000, 1'000'000};
  constexpr Micros kOrigin = 13'000;
  Schedule schedule(kOrigin, kPeriods[0]);
  std::vector<std::pair<Micros, Micros>> due;  // of every poll, with its period
  Micros now = 0;
  for (int i = 0; i < 500; ++i) {
    now += static_cast<Micros>(random() % 400'000);
    const std::uint64_t overdue = schedule.planned_before(now + 1) - schedule.next();
    CHECK(schedule.overrun(now) == (overdue > 1 ? overdue - 1 : 0));
    for (std::uint64_t k = 0; k < overdue; ++k) {
      const Micros at = schedule.next_due_us();
      CHECK(at <= now);
      CHECK((due.empty() || at > due.back().first));
      due.emplace_back(at, 0);
      schedule.take();
    }
    CHECK(schedule.next_due_us() > now);
    if (random() % 3 == 0) {
      const Micros period = kPeriods[random() % kPeriods.size()];
      CHECK(schedule.change_period(period, now) == schedule.next());
      CHECK((schedule.next_due_us() - kOrigin) % period == 0);
      CHECK(schedule.next_due_us() > now);
      CHECK(schedule.next_due_us() <= std::max(now, kOrigin) + period);
    }
  }
  CHECK(schedule.next() == due.size());
}

TEST_CASE("polls that were due before a change stay planned, and the new period begins after them") {
  Schedule schedule(0, 100'000);
  schedule.take();  // poll 0; 1, 2 and 3 are overdue at 350 ms
  CHECK(schedule.change_period(1'000'000, 350'000) == 4);
  CHECK(schedule.due_us(3) == 300'000);
  CHECK(schedule.due_us(4) == 1'000'000);
  CHECK(schedule.overrun(350'000) == 2);
  CHECK(schedule.planned_before(1'000'001) == 5);
  CHECK(schedule.change_period(250'000, 360'000) == 4);  // again, before any of it was taken
  CHECK(schedule.due_us(3) == 300'000);
  CHECK(schedule.due_us(4) == 500'000);
  schedule.take(3);
  CHECK(schedule.next_due_us() == 500'000);
}

TEST_CASE("an activity is told from speed, task and charging, and what is not told is possible") {
  Told robot;
  CHECK(robot.watch.possible(0).all());
  robot.tell(0, kIdle);
  CHECK(robot.watch.possible(0).all());  // nothing is known of the time before
  robot.tell(10 * kSecond, kIdle);
  CHECK(robot.watch.possible(10 * kSecond) == just(Activity::idle));
  robot.tell(11 * kSecond, kCharging);
  robot.tell(21 * kSecond, kCharging);
  CHECK(robot.watch.possible(21 * kSecond) == just(Activity::charging));
  robot.tell(22 * kSecond, R"({"vx":0,"vy":0,"w":0,"task_status":2,"charging":true})");  // a task: about to drive off
  CHECK(robot.watch.possible(22 * kSecond).test(0));
  CHECK(activities_text(just(Activity::charging)) == "charging");
  CHECK(activities_text(Activities().set()) == "unknown");
}

TEST_CASE("a robot that does not tell its speed or its task is never asked more slowly") {
  for (const char* body : {R"({"vx":0,"w":0})", R"({"task_status":4})", R"({"x":1})", "no json"}) {
    INFO(body);
    Told robot;
    for (Micros at = 0; at <= 60 * kSecond; at += kSecond) {
      robot.tell(at, body);
    }
    CHECK(robot.watch.possible(60 * kSecond).test(0));
  }
  Told still;  // is_stop is as good as a speed
  for (Micros at = 0; at <= 60 * kSecond; at += kSecond) {
    still.tell(at, R"({"is_stop":true,"task_status":0})");
  }
  CHECK(still.watch.possible(60 * kSecond) == (just(Activity::idle) | just(Activity::charging)));
  CHECK(kRates.in(still.watch.possible(60 * kSecond)) == kSecond);
}

TEST_CASE("what was told too long ago is not known any more") {
  Told robot;
  robot.tell(0, kIdle);
  robot.tell(20 * kSecond, kIdle);
  CHECK(robot.watch.possible(49 * kSecond) == just(Activity::idle));
  CHECK(robot.watch.possible(51 * kSecond).all());
}

TEST_CASE("a robot that starts to move is announced at once, from whichever source tells it") {
  Told robot;
  int woken = 0;
  robot.watch.on_faster([&] { ++woken; });
  robot.tell(0, kIdle);
  robot.tell(20 * kSecond, kIdle);
  CHECK(woken == 0);
  robot.tell(21 * kSecond, R"({"vx":0.2})", Source::pose);
  CHECK(woken == 1);
  CHECK(robot.watch.possible(21 * kSecond).test(0));
  robot.tell(22 * kSecond, kIdle);  // patience before it is asked more slowly
  CHECK(robot.watch.possible(30 * kSecond).test(0));
  robot.tell(31 * kSecond, kIdle);
  CHECK(robot.watch.possible(31 * kSecond) == just(Activity::idle));
  CHECK(woken == 1);
}

TEST_CASE("a standing robot is asked more slowly after 10 s, a moving one faster at its first answer") {
  Bench bench({{Source::status, kRates, 0}}, [](Source, Micros now) {
    Act act;
    act.body = now < 20 * kSecond || now >= 60 * kSecond ? kMoving : kIdle;
    return act;
  });
  bench.poller->run(0, 90 * kSecond);
  const auto rates = bench.rates(Source::status);
  REQUIRE(rates.size() == 2);
  CHECK(rates[0].subject == "idle");
  CHECK(rates[0].old_value == "200 ms");
  CHECK(rates[0].new_value == "1.0 s");
  CHECK(rates[0].t_us >= kWallStart + 29'800'000);
  CHECK(rates[0].t_us <= kWallStart + 30'400'000);
  CHECK(rates[1].subject.find("moving") == 0);
  CHECK(rates[1].new_value == "200 ms");
  // The poll at 60 s shows the motion, and the next one follows on the fast grid.
  CHECK(rates[1].t_us == kWallStart + 60 * kSecond + 4'000);
  const auto& asked = bench.link->asked;
  CHECK(std::count_if(asked.begin(), asked.end(), [](const auto& a) { return a.second % 200'000 != 0; }) == 0);
  CHECK(std::any_of(asked.begin(), asked.end(), [](const auto& a) { return a.second == 60'200'000; }));
  CHECK(asked.size() < 90 * 5 - 100);
}

TEST_CASE("stored and missed polls are what the rates in the log plan, through outages and changes") {
  std::mt19937 random(5);
  Bench bench({{Source::status, kRates, 0}, {Source::io, Rates(500'000, 2 * kSecond, 10 * kSecond), 0}},
              [&](Source source, Micros now) {
                Act act;
                const Micros minute = now / (60 * kSecond) % 5;
                act.body = source == Source::io ? "{}" : minute < 2 ? kMoving : minute < 4 ? kIdle : kCharging;
                act.ok = now % (97 * kSecond) > 11 * kSecond;
                act.takes_us = random() % 50 == 0 ? 900'000 : 4'000;
                act.cause = Cause::timeout;
                return act;
              });
  constexpr Micros kEnd = 3600 * kSecond;
  bench.poller->run(0, kEnd);
  for (std::size_t lane = 0; lane < 2; ++lane) {
    const PolledSource& plan = bench.poller->options().sources[lane];
    INFO(source_name(plan.source));
    const SourceCounters& counters = bench.poller->counters(lane);
    const auto rates = bench.rates(plan.source);
    CHECK(rates.size() > 20);
    CHECK(bench.accounted(plan.source) == counters.planned);
    CHECK(counters.stored + counters.missed_total() == counters.planned);
    CHECK(planned_by_log(rates, plan.rates.fastest(), kEnd) == counters.planned);
  }
}

TEST_CASE("a source that is given up is planned no more, and the others go on") {
  int poses = 0;
  Bench bench({{Source::status, kSecond, 0}, {Source::pose, 100'000, 0}}, [&](Source source, Micros) {
    Act act;
    if (source == Source::pose && ++poses == 3) {
      act.give_up = "the controller ignores keys";
    }
    return act;
  });
  bench.poller->run(0, 60 * kSecond);
  CHECK(poses == 3);
  CHECK(bench.accounted(Source::pose) == 3);
  CHECK(bench.poller->counters(1).planned == 3);
  CHECK(bench.poller->counters(1).period_us == 0);
  CHECK(bench.poller->counters(0).stored == 60);
  const auto rates = bench.rates(Source::pose);
  REQUIRE(rates.size() == 1);
  CHECK(rates[0].seq == 3);
  CHECK(rates[0].new_value == "off");
  CHECK(rates[0].detail == "the controller ignores keys");
}

TEST_CASE("a sleeper that is woken returns before its time, and a wake between two sleeps is not lost") {
  HostClock clock;
  const Micros far = clock.mono_us() + 3600 * kSecond;
  clock.wake();
  CHECK(clock.sleep_until(far));
  std::thread other([&] { clock.wake(); });
  CHECK(clock.sleep_until(far));
  other.join();
  CHECK(clock.mono_us() < far);
}

TEST_CASE("rates in the log are read back exactly") {
  for (const Micros period : {Micros{10'000}, Micros{333'333}, Micros{200'000}, Micros{1'000'000}, Micros{1'250'000},
                              Micros{90'000'000}, Micros{86'400'000'000}}) {
    INFO(rate_text(period));
    CHECK(parse_rate(rate_text(period)) == period);
  }
  CHECK(rate_text(0) == "off");
  CHECK(parse_rate("off") == 0);
  CHECK_FALSE(parse_rate("soon"));
}
