// One source of a connection is not answered, others are: what that costs, in virtual time.

#include <random>

#include "recorder/poller.hpp"
#include "tests/recorder/fakes.hpp"
#include "tests/support/catch.hpp"

using namespace tacho;
using namespace tacho::recorder;
using namespace tacho::recorder::test;

namespace {

constexpr Micros kMinute = 60 * kSecond;

/// Silence as links tell it: the whole timeout, and the connection is closed.
Act silent() { return Act{false, kSecond, Cause::timeout, false, {}}; }

}  // namespace

TEST_CASE("a source that is never answered costs the others its few tries, and the connection is up") {
  for (const Cause cause : {Cause::timeout, Cause::closed, Cause::malformed}) {
    PollerBench bench({{Source::status, 200'000, 0}, {Source::io, 500'000, 100'000}}, [&](Source source, Micros) {
      return source == Source::status ? Act{} : Act{false, cause == Cause::timeout ? kSecond : 5'000, cause, false, {}};
    });
    bench.run(10 * kMinute);
    INFO(cause_name(cause));
    check_accounts(bench);
    const SourceCounters& status = bench.poller->counters(0);
    CHECK(status.planned.load() - status.stored.load() < status.planned.load() / 20);  // 26 tries of 5 polls
    CHECK(bench.poller->counters(1).stored.load() == 0);
    CHECK(bench.poller->counters(1).missed[static_cast<std::size_t>(cause)] > 1000);
    CHECK(bench.events(EventKind::link_down) == 0);
    CHECK(bench.events(EventKind::link_up) == 1);
  }
}

TEST_CASE("a source that is answered again is heard within half a minute, and asked as planned from then on") {
  const Micros back = 20 * kMinute;
  PollerBench bench({{Source::status, kSecond, 0}, {Source::io, 500'000, 250'000}}, [&](Source source, Micros now) {
    return source == Source::status || now >= back ? Act{} : silent();
  });
  bench.run(back + kMinute);
  const auto first = std::find_if(bench.sink.answers.begin(), bench.sink.answers.end(),
                                  [](const Answer& a) { return a.meta.source == Source::io; });
  REQUIRE(first != bench.sink.answers.end());
  CHECK(first->meta.t_send_us - kWallStart - back <= 30 * kSecond);
  const Micros left = back + kMinute - (first->meta.t_send_us - kWallStart);
  CHECK(static_cast<Micros>(bench.poller->counters(1).stored.load()) >= left / 500'000);
  check_accounts(bench);
}

TEST_CASE(
    "law: a robot with several sources that goes and comes back is down, and heard within a second of its return") {
  std::mt19937 random(5);
  const auto between = [&](Micros a, Micros b) { return std::uniform_int_distribution<Micros>(a, b)(random); };
  for (int run = 0; run < 300; ++run) {
    const Micros often = between(50'000, 400'000);
    const Micros seldom = between(1, 40) * often;
    const Micros back = 10 * kSecond + between(5 * kSecond, 300 * kSecond);
    // What asking takes while the robot is away: the try that is going on when it returns is lost, too.
    const Micros takes = between(0, 1) == 0 ? between(0, 5'000) : 400'000;
    PollerBench bench({{Source::status, often, 0}, {Source::io, seldom, seldom / 3}}, [&](Source, Micros now) {
      return now < 10 * kSecond || now >= back ? Act{} : Act{false, takes, Cause::timeout, false, {}};
    });
    bench.run(back + 5 * kSecond);
    const auto first = std::find_if(bench.sink.answers.begin(), bench.sink.answers.end(),
                                    [&](const Answer& a) { return a.meta.t_send_us - kWallStart >= back; });
    INFO("run " << run << ": " << often << " and " << seldom << " us, " << takes << " us a try");
    REQUIRE(first != bench.sink.answers.end());
    CHECK(first->meta.t_recv_us - kWallStart - back <= kSecond);
    CHECK(bench.events(EventKind::link_down) == 1);
    CHECK(bench.events(EventKind::link_up) == 2);
    check_accounts(bench);
  }
}

TEST_CASE("a source that is answered in part is asked as often as planned, whatever closes the connection") {
  PollerBench bench({{Source::inputs, 500'000, 0}, {Source::registers, 500'000, 250'000}}, [](Source source, Micros) {
    Act act;
    act.missing = source == Source::registers ? "missing [3x]120-140" : "";
    act.drops_connection = source == Source::registers;
    act.cause = Cause::closed;
    return act;
  });
  bench.run(kMinute);
  CHECK(bench.poller->counters(0).stored.load() == 120);
  CHECK(bench.poller->counters(1).stored.load() == 120);
  CHECK(bench.events(EventKind::link_down) == 0);
  check_accounts(bench);
}

TEST_CASE("law: whichever source fails, however fast and in whatever order, the others are asked as planned") {
  std::mt19937 random(7);
  const auto between = [&](Micros a, Micros b) { return std::uniform_int_distribution<Micros>(a, b)(random); };
  for (int run = 0; run < 200; ++run) {
    const Micros bad = between(2, 10) * 100'000;
    const Micros good = between(2, 10) * 100'000;
    const bool in_part = run % 3 == 0;
    const std::vector<PolledSource> sources{{Source::registers, bad, between(0, 5) * 13'000},
                                            {Source::inputs, good, between(0, 1) * good / 2}};
    PollerBench bench(sources, [&](Source source, Micros) {
      Act act;
      if (source == Source::registers) {
        act = Act{in_part, 5'000, Cause::closed, false, in_part ? "missing [3x]120-140" : "", true};
      }
      return act;
    });
    bench.run(10 * kMinute);
    INFO("run " << run << ": " << bad << " and " << good << " us" << (in_part ? ", in part" : ""));
    const SourceCounters& healthy = bench.poller->counters(1);
    CHECK(healthy.planned.load() - healthy.stored.load() <= 3);
    CHECK(bench.events(EventKind::link_down) <= 6);  // until the others have told often enough
    CHECK((!in_part || bench.poller->counters(0).stored.load() * 2 >= bench.poller->counters(0).planned.load()));
    check_accounts(bench);
  }
}

TEST_CASE("an outage is what it is from its first poll on, of every source") {
  PollerBench bench({{Source::registers, 200'000, 0}, {Source::inputs, 200'000, 100'000}},
                    [](Source, Micros now) { return now < 10 * kSecond || now >= 40 * kSecond ? Act{} : silent(); });
  bench.run(50 * kSecond);
  for (const Gap& gap : bench.sink.gaps) {
    CHECK(gap.cause != Cause::overrun);
  }
  CHECK(bench.events(EventKind::link_down) == 1);
  check_accounts(bench);
}

TEST_CASE("of a robot whose slow source alone is answered, the quick one is soon asked seldom, and the link stays up") {
  PollerBench bench({{Source::status, 10 * kSecond, 0}, {Source::io, 500'000, 250'000}},
                    [](Source source, Micros) { return source == Source::status ? Act{} : silent(); });
  bench.run(30 * kMinute);
  CHECK(bench.poller->counters(0).missed_total() <= 2);
  const auto downs = [&](Micros from) {
    return std::count_if(bench.sink.events.begin(), bench.sink.events.end(),
                         [&](const Event& e) { return e.kind == EventKind::link_down && e.t_us - kWallStart >= from; });
  };
  CHECK(downs(0) <= 12);
  CHECK(downs(3 * kMinute) == 0);
  check_accounts(bench);
}

TEST_CASE("law: whoever is answered or not, what is asked on one connection keeps its distance") {
  std::mt19937 random(7);
  const auto between = [&](Micros a, Micros b) { return std::uniform_int_distribution<Micros>(a, b)(random); };
  for (int run = 0; run < 300; ++run) {
    const std::vector<PolledSource> sources{{Source::status, between(200'000, 400'000), 0},
                                            {Source::io, between(300'000, 2'000'000), between(0, 200'000)}};
    PollerBench bench(
        sources,
        [&](Source source, Micros) {
          return source == Source::status ? Act{true, between(1'000, 90'000), Cause::timeout, true, {}}
                                          : Act{false, between(1'000, 90'000), Cause::closed, false, {}};
        },
        100'000);
    bench.run(kMinute);
    INFO("run " << run);
    for (std::size_t i = 0; i + 1 < bench.link->asked.size(); ++i) {
      REQUIRE(bench.link->asked[i + 1].second - bench.link->asked[i].second >= 100'000);
    }
    check_accounts(bench);
  }
}

TEST_CASE("a connection on which everything fails now and then leaves no source waiting for long") {
  std::mt19937 random(11);
  const auto between = [&](Micros a, Micros b) { return std::uniform_int_distribution<Micros>(a, b)(random); };
  const Micros calm = 30 * kSecond;
  std::vector<double> waited_s;
  for (int run = 0; run < 300; ++run) {
    bool good = true;
    Micros until = 0;
    PollerBench bench({{Source::status, 50'000, 0}, {Source::io, 50'000, 12'500}, {Source::pose, 50'000, 25'000}},
                      [&](Source, Micros now) {
                        for (; until <= now && until < calm; until += between(40'000, 200'000)) {
                          good = between(0, 3) == 0;
                        }
                        return good || now >= calm ? Act{true, 1'000, Cause::timeout, true, {}}
                                                   : Act{false, 60'000, Cause::timeout, false, {}};
                      });
    bench.run(calm + kMinute);
    for (const Source source : {Source::status, Source::io, Source::pose}) {
      const auto first = std::find_if(bench.sink.answers.begin(), bench.sink.answers.end(), [&](const Answer& a) {
        return a.meta.source == source && a.meta.t_send_us - kWallStart >= calm;
      });
      REQUIRE(first != bench.sink.answers.end());
      waited_s.push_back(static_cast<double>(first->meta.t_send_us - kWallStart - calm) * 1e-6);
    }
    check_accounts(bench);
  }
  CHECK(*std::max_element(waited_s.begin(), waited_s.end()) <= 1.0);
}
