// The poller in virtual time: schedule, accounting, gaps.

#include <random>

#include "recorder/poller.hpp"
#include "tests/recorder/fakes.hpp"
#include "tests/support/catch.hpp"

using namespace tacho;
using namespace tacho::recorder;
using namespace tacho::recorder::test;

namespace {

using Bench = PollerBench;

Act good(Source, Micros) { return {}; }

}  // namespace

TEST_CASE("polls are due at start plus k periods, however long each one takes") {
  std::mt19937 random(7);
  std::uniform_int_distribution<Micros> takes(0, 150'000);
  Bench bench({{Source::registers, 200'000, 0}}, [&](Source, Micros) {
    return Act{true, takes(random), {}, false, {}};
  });
  bench.run(100 * kSecond);
  REQUIRE(bench.link->asked.size() == 500);
  for (std::size_t k = 0; k < bench.link->asked.size(); ++k) {
    CHECK(bench.link->asked[k].second == static_cast<Micros>(k) * 200'000);
  }
  check_accounts(bench);
}

TEST_CASE("the issue's rates give exactly the planned counts of a minute") {
  Bench status({{Source::status, kSecond, 0}, {Source::io, 500'000, 250'000}}, good, 100'000);
  status.run(60 * kSecond);
  CHECK(status.poller->counters(0).planned.load() == 60);
  CHECK(status.poller->counters(0).stored.load() == 60);
  CHECK(status.poller->counters(1).planned.load() == 120);
  CHECK(status.poller->counters(1).stored.load() == 120);
  check_accounts(status);
  Bench modbus({{Source::registers, 200'000, 0}, {Source::inputs, 200'000, 100'000}}, good, 20'000);
  modbus.run(60 * kSecond);
  CHECK(modbus.poller->counters(0).stored.load() == 300);
  CHECK(modbus.poller->counters(1).stored.load() == 300);
}

TEST_CASE("one slow answer costs the polls it covered and delays none of the later ones") {
  const auto slow_once = [](Source, Micros now) {
    Act act;
    act.takes_us = now == 3 * kSecond ? 2'700'000 : 4'000;
    return act;
  };
  Bench bench({{Source::status, kSecond, 0}}, slow_once, 0, std::chrono::seconds(5));
  bench.run(10 * kSecond);
  const auto gaps = bench.gaps(Source::status);
  REQUIRE(gaps.size() == 1);
  CHECK(gaps[0].cause == Cause::overrun);
  CHECK(gaps[0].seq_from == 4);
  CHECK(gaps[0].seq_count == 1);
  // Poll 5 was due at 5 s, is asked at 5.7 s, and 6 is on the grid again.
  CHECK(bench.link->asked[4].second == 5'700'000);
  CHECK(bench.link->asked[5].second == 6 * kSecond);
  check_accounts(bench);
}

TEST_CASE("an outage is one gap row per source with its cause, from the last answer to the next") {
  Bench bench({{Source::status, kSecond, 0}, {Source::io, 500'000, 250'000}}, [](Source, Micros now) {
    const bool dead = now >= 10 * kSecond && now < 30 * kSecond;
    return Act{!dead, 4'000, Cause::connect_refused, false, {}};
  });
  bench.run(60 * kSecond);
  const auto gaps = bench.gaps(Source::status);
  REQUIRE(gaps.size() == 1);
  CHECK(gaps[0].cause == Cause::connect_refused);
  CHECK(gaps[0].detail == "because");
  CHECK(gaps[0].seq_from == 10);
  CHECK(gaps[0].seq_count >= 20);
  CHECK(gaps[0].seq_count <= 26);
  CHECK(gaps[0].t_from_us == kWallStart + 9 * kSecond + 4'000);
  CHECK(gaps[0].t_to_us == kWallStart + static_cast<Micros>(gaps[0].seq_from + gaps[0].seq_count) * kSecond);
  CHECK(bench.gaps(Source::io).size() == 1);
  CHECK(bench.events(EventKind::link_down) == 1);
  CHECK(bench.events(EventKind::link_up) == 2);
  check_accounts(bench);
}

TEST_CASE("a dead robot is tried after 0.2 s, then 0.4 s, then twice a second for as long as it takes") {
  Bench bench({{Source::registers, 50'000, 0}}, [](Source, Micros) {
    return Act{false, 0, Cause::connect_refused, false, {}};
  });
  bench.run(600 * kSecond);
  REQUIRE(bench.link->asked.size() > 1000);
  const auto wait = [&](std::size_t i) { return bench.link->asked[i + 1].second - bench.link->asked[i].second; };
  CHECK(wait(0) == 200'000);
  CHECK(wait(1) == 400'000);
  for (std::size_t i = 2; i + 1 < bench.link->asked.size(); ++i) {
    CHECK(wait(i) == 500'000);
  }
  CHECK(bench.events(EventKind::link_down) == 1);
  CHECK(bench.events(EventKind::link_up) == 0);
  check_accounts(bench);
}

TEST_CASE("a robot with too many clients is tried less and less often, at least every 5 s") {
  Bench bench({{Source::status, 50'000, 0}}, [](Source, Micros) {
    return Act{false, 0, Cause::client_limit, false, {}};
  });
  bench.run(60 * kSecond);
  REQUIRE(bench.link->asked.size() > 10);
  const auto wait = [&](std::size_t i) { return bench.link->asked[i + 1].second - bench.link->asked[i].second; };
  CHECK(wait(0) == 200'000);
  CHECK(wait(2) == 800'000);
  CHECK(wait(bench.link->asked.size() - 2) == 5 * kSecond);
  check_accounts(bench);
}

TEST_CASE("law: whenever a robot comes back it is heard within a second") {
  constexpr std::array kCauses{Cause::connect_refused, Cause::connect_timeout, Cause::unreachable,   Cause::timeout,
                               Cause::closed,          Cause::malformed,       Cause::wrong_sequence};
  std::mt19937 random(11);
  const auto between = [&](Micros a, Micros b) { return std::uniform_int_distribution<Micros>(a, b)(random); };
  for (int run = 0; run < 200; ++run) {
    const Micros period = between(20'000, 400'000);
    const Micros back = 10 * kSecond + between(0, 300 * kSecond);
    const Cause cause = kCauses[static_cast<std::size_t>(between(0, kCauses.size() - 1))];
    const Micros takes = cause == Cause::timeout || cause == Cause::connect_timeout ? 400'000 : between(0, 20'000);
    Bench bench({{Source::registers, period, 0}}, [&](Source, Micros now) {
      return now < 10 * kSecond || now >= back ? Act{} : Act{false, takes, cause, false, {}};
    });
    bench.run(back + 3 * kSecond);
    const auto first = std::find_if(bench.sink.answers.begin(), bench.sink.answers.end(),
                                    [&](const Answer& a) { return a.meta.t_send_us - kWallStart >= back; });
    INFO("period " << period << " cause " << cause_name(cause));
    REQUIRE(first != bench.sink.answers.end());
    CHECK(first->meta.t_recv_us - kWallStart - back <= kSecond);
    check_accounts(bench);
  }
}

TEST_CASE("a whole answer whose connection had to be closed is no outage") {
  Bench bench({{Source::registers, 100'000, 0}}, [](Source, Micros) {
    Act act;
    act.drops_connection = true;
    return act;
  });
  bench.run(10 * kSecond);
  CHECK(bench.poller->counters(0).stored.load() == 100);
  CHECK(bench.events(EventKind::link_down) == 0);
  check_accounts(bench);
}

TEST_CASE("a long outage is written at least once a minute while it lasts") {
  Bench bench({{Source::status, kSecond, 0}}, [](Source, Micros) { return Act{false, 0, Cause::timeout, false, {}}; });
  bench.run(600 * kSecond);
  const auto gaps = bench.gaps(Source::status);
  CHECK(gaps.size() >= 9);
  CHECK(gaps.size() <= 11);
  for (std::size_t i = 0; i + 1 < gaps.size(); ++i) {
    CHECK(gaps[i].seq_from + gaps[i].seq_count == gaps[i + 1].seq_from);
    CHECK(gaps[i].t_to_us - gaps[i].t_from_us <= 60 * kSecond);
  }
  check_accounts(bench);
}

TEST_CASE("a full queue is a gap with cause queue_full") {
  Bench bench({{Source::inputs, 200'000, 0}}, good);
  bench.sink.full = [&] { return bench.clock.mono_us() > 4 * kSecond && bench.clock.mono_us() < 6 * kSecond; };
  bench.run(10 * kSecond);
  const auto gaps = bench.gaps(Source::inputs);
  REQUIRE(gaps.size() == 1);
  CHECK(gaps[0].cause == Cause::queue_full);
  CHECK(gaps[0].seq_count == 10);
  check_accounts(bench);
}

TEST_CASE("sweeps that lack the same ranges share one partial gap and count as stored") {
  Bench bench({{Source::registers, 200'000, 0}}, [](Source, Micros now) {
    Act act;
    act.missing = now >= 2 * kSecond && now < 4 * kSecond ? "missing [3x]120-140" : "";
    act.cause = Cause::modbus_exception;
    return act;
  });
  bench.run(6 * kSecond);
  const auto partial = bench.gaps(Source::registers, true);
  REQUIRE(partial.size() == 1);
  CHECK(partial[0].seq_from == 10);
  CHECK(partial[0].seq_count == 10);
  CHECK(partial[0].cause == Cause::modbus_exception);
  CHECK(bench.gaps(Source::registers).empty());
  CHECK(bench.poller->counters(0).stored.load() == 30);
  check_accounts(bench);
}

TEST_CASE("a refusal that leaves the connection open costs the refused source only") {
  Bench bench({{Source::status, kSecond, 0}, {Source::io, 500'000, 250'000}}, [](Source source, Micros) {
    return Act{source == Source::status, 4'000, Cause::error_frame, true, {}};
  });
  bench.run(30 * kSecond);
  CHECK(bench.poller->counters(0).stored.load() == 30);
  CHECK(bench.poller->counters(1).stored.load() == 0);
  CHECK(bench.gaps(Source::io).size() == 1);
  CHECK(bench.events(EventKind::link_down) == 0);
  check_accounts(bench);
}

TEST_CASE("requests on one connection keep their distance") {
  Bench bench({{Source::status, kSecond, 0}, {Source::io, 500'000, 0}}, good, 100'000);
  bench.run(20 * kSecond);
  for (std::size_t i = 0; i + 1 < bench.link->asked.size(); ++i) {
    CHECK(bench.link->asked[i + 1].second - bench.link->asked[i].second >= 100'000);
  }
  CHECK(bench.poller->counters(0).stored.load() == 20);
  CHECK(bench.poller->counters(1).stored.load() == 40);
}

TEST_CASE("a stop ends the plan there: what was due and unasked is missed by shutdown") {
  Bench bench({{Source::status, kSecond, 0}}, [](Source, Micros now) {
    return Act{now < 5 * kSecond, now < 5 * kSecond ? 4'000 : 900'000, Cause::timeout, false, {}};
  });
  bench.clock.stop_at(5'500'000);
  bench.run(60 * kSecond);
  CHECK(bench.poller->counters(0).planned.load() == 6);
  CHECK(bench.poller->counters(0).stored.load() == 5);
  const auto gaps = bench.gaps(Source::status);
  REQUIRE(gaps.size() == 1);
  CHECK(gaps[0].cause == Cause::shutdown);
  check_accounts(bench);
}

TEST_CASE("a wall clock that jumps by a year disturbs neither schedule nor accounts") {
  bool jumped = false;
  FakeClock* clock = nullptr;
  Bench bench({{Source::status, kSecond, 0}}, [&](Source, Micros now) {
    if (now >= 10 * kSecond && !jumped) {
      jumped = true;
      clock->step_wall(-Micros{365} * 86'400 * kSecond);
    }
    return Act{now < 12 * kSecond || now > 15 * kSecond, 1'000, Cause::closed, false, {}};
  });
  clock = &bench.clock;
  bench.run(30 * kSecond);
  CHECK(bench.poller->counters(0).planned.load() == 30);
  CHECK(bench.gaps(Source::status).size() == 1);
  check_accounts(bench);
}

TEST_CASE("a gap during which the clock is set ends before it begins nowhere, and is as long as it was") {
  for (const Micros step : {-kSecond * 3600, kSecond * 3600, -Micros{365} * 86'400 * kSecond}) {
    for (const Micros at : {10 * kSecond, 14 * kSecond}) {  // before the outage, in the middle of it
      bool jumped = false;
      FakeClock* clock = nullptr;
      Bench bench({{Source::status, kSecond, 0}}, [&](Source, Micros now) {
        if (now >= at && !std::exchange(jumped, true)) {
          clock->step_wall(step);
        }
        return Act{now < 12 * kSecond || now > 18 * kSecond, 1'000, Cause::closed, false, {}};
      });
      clock = &bench.clock;
      bench.run(30 * kSecond);
      INFO("step " << step << " at " << at);
      Micros length_us = 0;
      for (const Gap& gap : bench.gaps(Source::status)) {
        CHECK(gap.t_from_us <= gap.t_to_us);
        length_us += gap.t_to_us - gap.t_from_us;
      }
      CHECK(length_us >= 5 * kSecond);
      CHECK(length_us <= 9 * kSecond);
      check_accounts(bench);
    }
  }
}

TEST_CASE("law: whatever robot, network and queue do, stored plus missed is planned and every poll occurs once") {
  constexpr std::array kCauses{Cause::connect_refused, Cause::timeout,     Cause::closed,          Cause::malformed,
                               Cause::wrong_sequence,  Cause::error_frame, Cause::modbus_exception};
  for (unsigned seed = 1; seed <= 150; ++seed) {
    std::mt19937 random(seed);
    const auto chance = [&](double p) { return std::uniform_real_distribution<>(0, 1)(random) < p; };
    const auto between = [&](Micros a, Micros b) { return std::uniform_int_distribution<Micros>(a, b)(random); };
    const double p_fail = std::uniform_real_distribution<>(0, 0.6)(random);
    std::vector<PolledSource> sources;
    for (const Source source : {Source::registers, Source::inputs}) {
      const Micros period = between(20'000, 2'000'000);
      sources.push_back({source, period, between(0, period - 1)});
    }
    Bench bench(
        sources,
        [&](Source, Micros) {
          Act act;
          act.ok = !chance(p_fail);
          act.takes_us = chance(0.1) ? between(0, 3'000'000) : between(0, 20'000);
          act.cause = kCauses[static_cast<std::size_t>(between(0, kCauses.size() - 1))];
          act.keeps_connection = chance(0.3);
          act.missing = chance(0.1) ? "missing [3x]7-7" : "";
          return act;
        },
        between(0, 100'000));
    const double p_full = chance(0.3) ? 0.3 : 0.0;
    bench.sink.full = [&] { return chance(p_full); };
    if (chance(0.5)) {
      bench.clock.stop_at(between(0, 100 * kSecond));
    }
    const Micros end = between(0, 90 * kSecond);
    bench.run(end);
    INFO("seed " << seed);
    check_accounts(bench);
    const Micros stopped = std::min(end, bench.clock.stopped_at().value_or(end));
    for (std::size_t s = 0; s < sources.size(); ++s) {
      const Schedule schedule(sources[s].phase_us, sources[s].rates.fastest());
      CHECK(bench.poller->counters(s).planned.load() >= schedule.planned_before(stopped));
      CHECK(bench.poller->counters(s).planned.load() <= schedule.planned_before(stopped) + 1);
    }
    for (std::size_t i = 0; i + 1 < bench.sink.answers.size(); ++i) {
      const AnswerMeta& a = bench.sink.answers[i].meta;
      const AnswerMeta& b = bench.sink.answers[i + 1].meta;
      CHECK((a.source != b.source || a.seq < b.seq));
    }
  }
}

TEST_CASE("pushes are stored as they come, and one that does not come is missed") {
  int pushes = 0;
  Bench bench(
      {{Source::push, 500'000, 0}},
      [&](Source, Micros) {
        Act act;
        act.takes_us = ++pushes == 11 ? 1'500'000 : 500'000;  // two are left out before the eleventh
        return act;
      },
      0, std::chrono::seconds(5));
  bench.run(20 * kSecond);
  check_accounts(bench);
  CHECK(bench.poller->counters(0).stored.load() == 38);
  const auto gaps = bench.gaps(Source::push);
  REQUIRE(!gaps.empty());
  CHECK(gaps[0].seq_from == 10);
  CHECK(gaps[0].seq_count == 2);
  CHECK(gaps[0].cause == Cause::timeout);
  CHECK(bench.events(EventKind::rate) == 0);
}

TEST_CASE("pushes that come faster than questions may be asked are stored as they come") {
  Bench bench(
      {{Source::push, 50'000, 0}},
      [](Source, Micros now) {
        Act act;
        act.takes_us = 50'000 - now % 50'000;
        return act;
      },
      100'000);
  bench.run(10 * kSecond);
  CHECK(bench.poller->counters(0).stored.load() >= 199);
  check_accounts(bench);
}

TEST_CASE("a robot that pushes at a pace of its own is followed") {
  Bench bench({{Source::push, 500'000, 0}}, [](Source, Micros now) {
    Act act;
    act.takes_us = now % 100'000 == 0 ? 100'000 : 100'000 - now % 100'000;
    return act;
  });
  bench.run(10 * kSecond);
  check_accounts(bench);
  CHECK(bench.poller->counters(0).stored.load() == 100);
  CHECK(bench.poller->counters(0).missed_total() == 0);
  REQUIRE(bench.events(EventKind::rate) == 1);
  const auto rate = std::find_if(bench.sink.events.begin(), bench.sink.events.end(),
                                 [](const Event& e) { return e.kind == EventKind::rate; });
  CHECK(rate->new_value == "100 ms");
}

TEST_CASE("silence of the push port is missed push by push, and a lost connection is tried again") {
  const auto robot = [](Source, Micros now) {
    Act act;
    act.takes_us = 500'000;
    act.ok = now < 5 * kSecond || now >= 12 * kSecond;
    act.cause = now < 8 * kSecond ? Cause::timeout : Cause::connect_refused;
    act.keeps_connection = now < 8 * kSecond;
    return act;
  };
  Bench bench({{Source::push, 500'000, 0}}, robot);
  bench.run(20 * kSecond);
  check_accounts(bench);
  const auto planned = bench.poller->counters(0).planned.load();
  CHECK((planned >= 38 && planned <= 40));
  CHECK(bench.poller->counters(0).missed[static_cast<std::size_t>(Cause::timeout)] >= 5);
  CHECK(bench.poller->counters(0).missed[static_cast<std::size_t>(Cause::connect_refused)] >= 6);
  CHECK(bench.events(EventKind::link_down) == 1);
  CHECK(bench.events(EventKind::link_up) == 2);
}
