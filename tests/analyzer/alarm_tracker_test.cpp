#include "analyzer/analyses/alarm_tracker.hpp"

#include <initializer_list>
#include <random>

#include "analyzer/analyses/alarm_measures.hpp"
#include "tests/support/catch.hpp"

using namespace tacho;

namespace {

constexpr Micros kSecond = 1'000'000;
constexpr Micros kLimit = 3 * kSecond;  // of a 1 s period
constexpr auto kWarning = static_cast<std::size_t>(AlarmLevel::warning);

/// Polls of the warning level at whole seconds, round trip 10 ms.
class Polls {
 public:
  AlarmTracker tracker;

  void at(double t_s, std::initializer_list<AlarmPoll::Item> items, bool full = false) {
    AlarmPoll poll = empty_at(t_s);
    poll.levels[kWarning] = {true, full, items};
    tracker.poll(poll, kLimit);
  }
  /// The array is not in the answer.
  void missing(double t_s) { tracker.poll(empty_at(t_s), kLimit); }
  [[nodiscard]] const AlarmInterval& only() const {
    REQUIRE(tracker.intervals().size() == 1);
    return tracker.intervals().front();
  }

 private:
  static AlarmPoll empty_at(double t_s) {
    AlarmPoll poll;
    poll.t_send_us = static_cast<Micros>(t_s * 1e6);
    poll.t_recv_us = poll.t_send_us + 10'000;
    return poll;
  }
};

AlarmPoll::Item item(std::int64_t code, std::int64_t stamp = 0, std::int64_t times = 0) { return {code, stamp, times}; }

Raise raise_at(double t_s, double half_s = 0.0, std::int64_t code = 1) {
  return {static_cast<Micros>((t_s - half_s) * 1e6),
          static_cast<Micros>((t_s + half_s) * 1e6),
          {AlarmLevel::warning, code},
          0};
}

}  // namespace

TEST_CASE("onset and end lie between the poll without and the poll with the alarm") {
  Polls polls;
  polls.at(0, {});
  polls.at(1, {item(54018)});
  polls.at(2, {item(54018)});
  polls.at(3, {});
  const AlarmInterval& a = polls.only();
  CHECK(a.onset_lo_us == 0);
  CHECK(a.onset_hi_us == 1 * kSecond + 10'000);
  CHECK(a.clear_lo_us == 2 * kSecond);
  CHECK(a.clear_hi_us == 3 * kSecond + 10'000);
  CHECK(a.onset == Onset::seen);
  CHECK(a.clear == Clear::seen);
  CHECK(a.duration_lo_s() == Approx(0.99));
  CHECK(a.duration_hi_s().value() == Approx(3.01));
}

TEST_CASE("a missing array says nothing and an empty one says none") {
  Polls missing;
  missing.at(0, {item(1)});
  missing.missing(1);
  missing.at(2, {item(1)});
  CHECK(missing.only().clear == Clear::open);

  Polls empty;
  empty.at(0, {item(1)});
  empty.at(1, {});
  empty.at(2, {item(1)});
  CHECK(empty.tracker.intervals().size() == 2);
}

TEST_CASE("an alarm that stood in the first poll has no lower bound and is not counted") {
  Polls polls;
  polls.at(0, {item(1)});
  polls.at(1, {});
  CHECK(polls.only().onset == Onset::before_record);
  CHECK_FALSE(polls.only().onset_lo_us.has_value());
  CHECK_FALSE(polls.only().counts());
}

TEST_CASE("after a gap the same stamp proves one alarm and another stamp two") {
  Polls same;
  same.at(0, {});
  same.at(1, {item(1, 500, 1)});
  same.at(60, {item(1, 500, 1)});
  CHECK(same.only().over_gap);
  CHECK(same.only().clear == Clear::open);

  Polls other;
  other.at(0, {});
  other.at(1, {item(1, 500, 1)});
  other.at(60, {item(1, 540, 1)});
  REQUIRE(other.tracker.intervals().size() == 2);
  const AlarmInterval& old = other.tracker.intervals()[0];
  CHECK(old.clear == Clear::censored);
  CHECK(old.clear_lo_us == 1 * kSecond);
  CHECK(other.tracker.intervals()[1].onset == Onset::in_gap);
  CHECK_FALSE(other.tracker.intervals()[1].counts());

  Polls none;
  none.at(0, {});
  none.at(1, {item(1)});
  none.at(60, {item(1)});
  CHECK(none.only().assumed_one);
}

TEST_CASE("an alarm that is gone after a gap ended somewhere in it") {
  Polls polls;
  polls.at(0, {});
  polls.at(1, {item(1)});
  polls.at(60, {});
  CHECK(polls.only().clear == Clear::in_gap);
  CHECK(polls.only().clear_lo_us == 1 * kSecond);
  CHECK(polls.only().clear_hi_us == 60 * kSecond + 10'000);
}

TEST_CASE("growing times are repetitions, restarted times with a new stamp are a hidden raise") {
  Polls repeated;
  repeated.at(0, {});
  repeated.at(1, {item(1, 500, 1)});
  repeated.at(2, {item(1, 501, 3)});
  repeated.at(3, {item(1, 502, 4)});
  CHECK(repeated.only().repeats == 3);
  CHECK(repeated.tracker.stamps().last_moves == 2);

  Polls hidden;
  hidden.at(0, {});
  hidden.at(1, {item(1, 500, 2)});
  hidden.at(2, {item(1, 501, 1)});
  REQUIRE(hidden.tracker.intervals().size() == 2);
  const AlarmInterval& old = hidden.tracker.intervals()[0];
  const AlarmInterval& fresh = hidden.tracker.intervals()[1];
  CHECK(old.clear == Clear::inferred);
  CHECK(old.clear_hi_us == 2 * kSecond + 10'000);
  CHECK(fresh.onset == Onset::inferred);
  CHECK(fresh.onset_lo_us == 1 * kSecond);
  CHECK(fresh.counts());

  Polls first;
  first.at(0, {});
  first.at(1, {item(1, 500, 1)});
  first.at(2, {item(1, 500, 2)});
  CHECK(first.tracker.stamps().first_stays == 1);
  CHECK(first.only().repeats == 1);
}

TEST_CASE("an alarm that stands twice in one answer is one alarm") {
  Polls polls;
  polls.at(0, {});
  polls.at(1, {item(1, 500, 1), item(1, 500, 1)});
  CHECK(polls.tracker.intervals().size() == 1);
}

TEST_CASE("in a full register set a missing code is no clear and a new one may be old") {
  Polls polls;
  polls.at(0, {});
  polls.at(1, {item(1)}, true);
  polls.at(2, {item(2)}, true);  // 1 may stand behind 2
  polls.at(3, {item(1)}, true);
  polls.at(4, {});
  REQUIRE(polls.tracker.intervals().size() == 2);
  const AlarmInterval& one = polls.tracker.intervals()[0];
  const AlarmInterval& two = polls.tracker.intervals()[1];
  CHECK(one.censored_set);
  CHECK(one.clear_lo_us == 3 * kSecond);
  CHECK(one.clear_hi_us == 4 * kSecond + 10'000);
  CHECK(two.censored_set);
  CHECK(two.onset_lo_us == 0);  // the last set with room was at 0
  CHECK(two.clear_lo_us == 2 * kSecond);
  CHECK(two.clear_hi_us == 4 * kSecond + 10'000);
}

TEST_CASE("the robot's stamp narrows the onset only where both agree") {
  Polls polls;
  polls.at(0, {});
  polls.at(10, {item(1, 103, 1)});  // a gap; the robot's clock is 100 s ahead
  polls.tracker.tighten(0, {-100 * kSecond - 50'000, -100 * kSecond + 50'000});
  CHECK(polls.only().onset_lo_us == 3 * kSecond - 50'000);
  CHECK(polls.only().onset_hi_us == 4 * kSecond + 50'000);
  CHECK(polls.only().stamped);

  Polls wrong;
  wrong.at(0, {});
  wrong.at(1, {item(1, 103, 1)});
  wrong.tracker.tighten(0, {-50'000, 50'000});
  CHECK(wrong.only().onset_lo_us == 0);
  CHECK(wrong.tracker.stamps().conflicts == 1);

  Polls repeated;  // the stamp may tell the last repetition: it bounds from above only
  repeated.at(0, {});
  repeated.at(10, {item(1, 5, 4)});
  repeated.tracker.tighten(0, {0, 0});
  CHECK(repeated.only().onset_lo_us == 0);
  CHECK(repeated.only().onset_hi_us == 6 * kSecond);
}

TEST_CASE("truth lies inside every interval, however polls and alarms fall") {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  for (int run = 0; run < 200; ++run) {
    // One code, on and off at random times; polls at random times with some lost.
    std::vector<double> edges;
    for (double t = 2.0 + 8.0 * uniform(random); t < 100.0; t += 0.4 + 8.0 * uniform(random)) {
      edges.push_back(t);
    }
    Polls polls;
    std::size_t long_enough = 0;
    for (std::size_t e = 0; e + 1 < edges.size(); e += 2) {
      long_enough += edges[e + 1] - edges[e] > 1.0 && (e == 0 || edges[e] - edges[e - 1] > 1.0) ? 1u : 0u;
    }
    for (double t = 0.0; t < 100.0; t += 0.2 + 0.8 * uniform(random)) {
      const auto passed = std::upper_bound(edges.begin(), edges.end(), t + 0.005) - edges.begin();
      if (passed % 2 == 1) {
        polls.at(t, {item(1)});
      } else {
        polls.at(t, {});
      }
    }
    for (const AlarmInterval& a : polls.tracker.intervals()) {
      bool onset = false;
      bool clear = a.clear == Clear::open;
      for (std::size_t e = 0; e < edges.size(); ++e) {
        const double t = edges[e] * 1e6;
        onset = onset ||
                (e % 2 == 0 && t >= static_cast<double>(*a.onset_lo_us) && t <= static_cast<double>(a.onset_hi_us));
        clear = clear ||
                (e % 2 == 1 && t >= static_cast<double>(a.clear_lo_us) && t <= static_cast<double>(*a.clear_hi_us));
      }
      CHECK(onset);
      CHECK(clear);
    }
    CHECK(polls.tracker.intervals().size() + 1 >= long_enough);
  }
}

TEST_CASE("a flood starts with the eleventh alarm in ten minutes and ends when fewer than five are left") {
  std::vector<Raise> raises;
  for (int i = 0; i < 12; ++i) {
    raises.push_back(raise_at(100.0 + 10.0 * i, 0.0, i));
  }
  const std::vector<Flood> floods = find_floods(raises, {}, 10'000 * kSecond);
  REQUIRE(floods.size() == 1);
  CHECK(floods[0].from_us == 200 * kSecond);
  CHECK(floods[0].to_us == (170 + 600) * kSecond);  // the eighth of twelve leaves, four stay
  CHECK(floods[0].peak == 12);
  CHECK(floods[0].raises == 12);
  CHECK(floods[0].first_out.key.code == 0);
  raises.resize(10);
  CHECK(find_floods(raises, {}, 10'000 * kSecond).empty());
}

TEST_CASE("three raises within a minute are chattering, surely only when the bounds allow nothing else") {
  const std::vector<Raise> fast{raise_at(0), raise_at(10), raise_at(30)};
  const Chatter c = chattering(fast, {});
  CHECK(c.sure);
  CHECK(c.runs == 1);
  CHECK(c.most == 3);
  CHECK(c.index == Approx((1.0 / 10 + 1.0 / 20) / 2));
  const std::vector<Raise> vague{raise_at(0, 5), raise_at(25, 5), raise_at(56, 5)};
  CHECK_FALSE(chattering(vague, {}).sure);
  CHECK(chattering(vague, {}).possible);
  CHECK(chattering(vague, {}).index_lo < chattering(vague, {}).index);
  CHECK(chattering(vague, {}).index < chattering(vague, {}).index_hi);
  const std::vector<Raise> slow{raise_at(0), raise_at(40), raise_at(80)};
  CHECK_FALSE(chattering(slow, {}).possible);
  CHECK(chattering(slow, {}).runs == 0);
}

TEST_CASE("evenly spread days have a dispersion near one and bursts a large one") {
  const std::vector<double> even{4, 5, 3, 6, 4, 5, 3};
  const std::vector<double> bursts{0, 0, 28, 0, 0, 2, 0};
  const std::vector<double> exposures(7, 86'400.0);
  CHECK(dispersion(even, exposures).value() < 1.0);
  CHECK(dispersion(bursts, exposures).value() > 10.0);
  CHECK_FALSE(dispersion(std::vector<double>{1, 2}, std::vector<double>{1, 1}).has_value());
}
