// What retention decides: by example, and by laws that hold for any parts, rules and surroundings.

#include "schema/store/retention.hpp"

#include <random>

#include "schema/store/clock_trust.hpp"
#include "tests/support/catch.hpp"

using namespace tacho;
using namespace tacho::store;

namespace {

constexpr Micros kHour = 3'600'000'000;
constexpr Micros kDay = 24 * kHour;
constexpr Micros kNow = 1'767'225'600'000'000;  // 2026-01-01
constexpr std::uint64_t kMB = 1u << 20;

/// Parts 1, 2, ... of 100 MB, a day each, the last one open; the one before it ended an hour ago.
std::vector<KeptPart> days(std::uint32_t count) {
  std::vector<KeptPart> parts;
  for (std::uint32_t i = 0; i < count; ++i) {
    KeptPart part;
    part.number = i + 1;
    part.bytes = 100 * kMB;
    part.closed = i + 1 < count;
    if (part.closed) {
      part.ended_us = kNow - kHour - static_cast<Micros>(count - 2 - i) * kDay;
    }
    part.recorded_us = kDay;
    parts.push_back(part);
  }
  return parts;
}

std::string text_of(const std::vector<Removal>& removals) {
  std::string out;
  for (const Removal& removal : removals) {
    out += (out.empty() ? "" : " ") + std::to_string(removal.number) + ":" +
           std::string(removal_reason_name(removal.reason));
  }
  return out;
}

Surroundings around(std::optional<Micros> now, std::optional<std::uint64_t> free = {}, bool full = false) {
  return {now, free, full};
}

}  // namespace

TEST_CASE("parts go by age, size and free space, the oldest first, and the rules say which") {
  const std::vector<KeptPart> five = days(5);  // ended 3 d 1 h, 2 d 1 h, 1 d 1 h, 1 h ago
  struct Row {
    RetentionRules rules;
    Surroundings around;
    const char* removed;
  };
  const std::vector<Row> rows{
      {{}, around(kNow, 0, true), ""},
      {{2 * kDay, 0, 0}, around(kNow), "1:age 2:age"},
      {{2 * kDay, 0, 0}, around({}), ""},
      {{4 * kDay, 0, 0}, around(kNow), ""},
      {{1, 0, 0}, around(kNow), "1:age 2:age 3:age 4:age"},
      {{0, 300 * kMB, 0}, around({}), "1:size 2:size"},
      {{0, 500 * kMB, 0}, around({}), ""},
      {{0, 1, 0}, around({}), "1:size 2:size 3:size 4:size"},
      {{0, 0, 150 * kMB}, around({}, 0), "1:reserve 2:reserve"},
      {{0, 0, 150 * kMB}, around({}, 50 * kMB), "1:reserve"},
      {{0, 0, 450 * kMB}, around({}, 50 * kMB), "1:reserve 2:reserve 3:reserve 4:reserve"},
      {{0, 0, 451 * kMB}, around({}, 50 * kMB), ""},  // all of them would not be enough
      {{0, 0, 451 * kMB}, around({}, 0, true), "1:disk_full"},
      {{0, 0, 150 * kMB}, around({}, 150 * kMB), ""},
      {{0, 0, 150 * kMB}, around({}, {}), ""},
      {{0, 0, 150 * kMB}, around({}, 900 * kMB, true), "1:disk_full"},
      {{0, 0, 0}, around({}, 0, true), ""},
      {{3 * kDay, 300 * kMB, 0}, around(kNow), "1:age 2:size"},
  };
  for (std::size_t i = 0; i < rows.size(); ++i) {
    INFO("row " << i);
    CHECK(text_of(parts_to_remove(rows[i].rules, five, rows[i].around)) == rows[i].removed);
  }
}

TEST_CASE("a part that is not closed yet stays, and with it all that are newer") {
  std::vector<KeptPart> parts = days(5);
  parts[1].closed = false;
  CHECK(text_of(parts_to_remove({kHour, 1, 1}, parts, around(kNow, 0, true))) == "1:age");
  parts[0].closed = false;
  CHECK(text_of(parts_to_remove({kHour, 1, 1}, parts, around(kNow, 0, true))).empty());
}

TEST_CASE("a part that no confirmed clock has seen end is as old as the first later one") {
  std::vector<KeptPart> parts = days(5);
  parts[0].ended_us.reset();
  CHECK(text_of(parts_to_remove({3 * kDay, 0, 0}, parts, around(kNow))).empty());
  CHECK(text_of(parts_to_remove({2 * kDay, 0, 0}, parts, around(kNow))) == "1:age 2:age");
  for (KeptPart& part : parts) {
    part.ended_us.reset();
  }
  CHECK(text_of(parts_to_remove({kHour, 0, 0}, parts, around(kNow))).empty());
}

TEST_CASE("an end that is still to come counts as unknown: it protects nothing for ever and ages nothing") {
  std::vector<KeptPart> parts = days(5);
  parts[0].ended_us = kNow + 365 * kDay;
  CHECK(text_of(parts_to_remove({3 * kDay, 0, 0}, parts, around(kNow))).empty());
  CHECK(text_of(parts_to_remove({2 * kDay, 0, 0}, parts, around(kNow))) == "1:age 2:age");
}

TEST_CASE("whatever the parts, the rules and the world: the laws of removal") {
  std::mt19937_64 random(20260101);
  const auto below = [&](std::uint64_t n) { return random() % n; };
  std::uint64_t removed_in_all = 0;
  for (int round = 0; round < 20'000; ++round) {
    std::vector<KeptPart> parts;
    std::uint32_t number = 0;
    std::uint64_t used = 0;
    for (auto n = below(8); n > 0; --n) {
      KeptPart part;
      part.number = number += 1 + static_cast<std::uint32_t>(below(3));
      part.bytes = below(300) * kMB;
      part.closed = below(6) != 0;
      if (below(4) != 0) {
        part.ended_us = kNow + kDay - static_cast<Micros>(below(20)) * kDay;
      }
      used += part.bytes;
      parts.push_back(part);
    }
    const RetentionRules rules{static_cast<Micros>(below(3) * below(10)) * kDay, below(2) * below(1500) * kMB,
                               below(2) * below(1000) * kMB};
    const Surroundings world{below(2) == 0 ? std::optional<Micros>() : kNow, below(1000) * kMB, below(4) == 0};
    const std::vector<Removal> removed = parts_to_remove(rules, parts, world);
    removed_in_all += removed.size();
    REQUIRE((parts.empty() ? removed.empty() : removed.size() < parts.size()));  // never the newest
    std::uint64_t most = *world.free_bytes;
    for (std::size_t i = 0; i + 1 < parts.size() && parts[i].closed; ++i) {
      most += parts[i].bytes;
    }
    std::uint64_t freed = 0;
    for (std::size_t i = 0; i < removed.size(); ++i) {
      REQUIRE(removed[i].number == parts[i].number);  // a prefix, the oldest first
      REQUIRE(parts[i].closed);
      REQUIRE((removed[i].reason != RemovalReason::age || world.now_us));
      REQUIRE((removed[i].reason != RemovalReason::size || used - freed > rules.size_bytes));
      REQUIRE((removed[i].reason != RemovalReason::reserve || *world.free_bytes + freed < rules.reserve_bytes));
      freed += parts[i].bytes;
    }
    const bool more = removed.size() + 1 < parts.size() && parts[removed.size()].closed;
    REQUIRE((!more || rules.size_bytes == 0 || used - freed <= rules.size_bytes));
    REQUIRE((!more || rules.reserve_bytes == 0 || most < rules.reserve_bytes ||
             *world.free_bytes + freed >= rules.reserve_bytes));
  }
  CHECK(removed_in_all > 10'000);
}

TEST_CASE("the forecast goes by what was written in the time that was recorded, at least an hour of it") {
  std::vector<KeptPart> parts = days(5);  // 100 MB a day, 500 MB
  const auto left = [&](RetentionRules rules, std::uint64_t free) { return forecast(rules, parts, free).days_left; };
  CHECK(*forecast({}, parts, 0).bytes_per_day == Approx(100.0 * kMB));
  CHECK(*left({}, 1000 * kMB) == Approx(10));
  CHECK(*left({0, 0, 200 * kMB}, 1000 * kMB) == Approx(8));
  CHECK(*left({0, 700 * kMB, 0}, 1000 * kMB) == Approx(2));
  CHECK(*left({0, 400 * kMB, 0}, 1000 * kMB) == Approx(0).margin(1e-9));
  CHECK(*forecast({0, 700 * kMB, 0}, parts, 1000 * kMB).days_kept == Approx(7));
  CHECK(*forecast({0, 0, 200 * kMB}, parts, 1000 * kMB).days_kept == Approx(13));
  const Forecast by_age = forecast({9 * kDay, 0, 100 * kMB}, parts, 1000 * kMB);
  CHECK_FALSE(by_age.days_left);
  CHECK(*by_age.days_kept == Approx(9));
  CHECK_FALSE(forecast({}, parts, 0).days_kept);
  for (KeptPart& part : parts) {
    part.recorded_us = kHour / 6;
  }
  CHECK_FALSE(forecast({}, parts, 1000 * kMB).bytes_per_day);
  CHECK(forecast_text(forecast({}, parts, 1000 * kMB), {}).find("after an hour") != std::string::npos);
}

TEST_CASE("a clock is confirmed by the kernel, or by more robots than contradict it, until it is set by an hour") {
  const auto at = [](Micros mono, Micros step, bool synchronised = false) {
    return HostTime{kNow + step + mono, mono, synchronised};
  };
  const auto robot = [](RobotId id, Micros mono, Micros step, Micros off) {
    return ClockPoint{id, 1, kNow + step + mono, mono, kNow + step + mono + off};
  };
  ClockTrust trust;
  CHECK_FALSE(trust.now(at(0, 0)));
  CHECK(*trust.now(at(1, 0, true)) == kNow + 1);
  CHECK(trust.now(at(kHour, 0)));                        // the network went, the clock is as good as before
  CHECK(trust.now(at(kHour, kHour / 2)));                // a small step
  CHECK_FALSE(trust.now(at(kHour, kHour + kHour / 2)));  // with a second one more than an hour
  trust.see(robot(1, kHour, 365 * kDay, -365 * kDay));
  CHECK_FALSE(trust.now(at(kHour, 365 * kDay)));
  trust.see(robot(2, kHour, 365 * kDay, kHour / 2));  // one against one
  CHECK_FALSE(trust.now(at(kHour, 365 * kDay)));
  trust.see(robot(3, kHour, 365 * kDay, 0));
  CHECK(trust.now(at(kHour, 365 * kDay)));
  CHECK_FALSE(trust.now(at(kHour, 0)));        // what robots said before the step is of no use after it
  trust.see({0, 1, kNow + kHour, kHour, {}});  // a point of the host alone says nothing
  CHECK_FALSE(trust.now(at(kHour, 0)));
}
