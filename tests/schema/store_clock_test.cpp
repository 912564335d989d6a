// A wall clock that is wrong: order and identity come from session and poll number, never from the time of day.

#include "tests/schema/store_workload.hpp"

using namespace tacho;
using namespace tacho::test;
namespace fs = std::filesystem;

namespace {

constexpr Micros kHour = 3600 * kSecond;
constexpr Micros kYear = 365 * kDay;

void record(Workload& work, int polls) {
  for (int i = 0; i < polls; ++i) {
    work.poll();
    if (i % 5 == 4) {
      work.commit();
    }
  }
}

std::uint64_t answers_between(const fs::path& folder, Micros from_us, Micros to_us) {
  store::LogReader log = open_reader(folder);
  return stored(log, 1, Source::registers, {from_us, to_us}).size();
}

}  // namespace

TEST_CASE("a wall clock that jumps by an hour or a year and back in a session loses, doubles and reorders nothing") {
  for (const Micros step : {kHour, -kHour, kYear, -kYear}) {
    INFO(step / kHour << " h");
    TempDir dir;
    Ledger ledger;
    {
      Workload work(dir.path(), ledger);
      work.begin(kT0);
      record(work, 30);
      work.step_clock(step);
      record(work, 30);
      work.step_clock(-step);
      record(work, 30);
      work.end();
    }
    const Verdict verdict = judge(dir.path(), ledger);
    CHECK(verdict.fault == "");
    CHECK(verdict.lost == 0);
    CHECK(integrity_of(dir.path()) == "");
    CHECK(answers_between(dir.path(), kT0, kT0 + kHour / 2) == 60);
    CHECK(answers_between(dir.path(), kT0 + step, kT0 + step + kHour / 2) == 30);
  }
}

TEST_CASE("sessions of a clock that was a year ahead keep their place between those of the right time") {
  TempDir dir;
  Ledger ledger;
  const auto session = [&](Micros t0_us, bool ends) {
    Workload work(dir.path(), ledger);
    work.begin(t0_us);
    record(work, 20);
    work.commit();
    if (ends) {
      work.end();
    }
    return work.session();
  };
  CHECK(session(kT0, true) == 1);
  CHECK(session(kT0 + kYear, true) == 2);
  CHECK(session(kT0 + 3600 * kSecond, false) == 3);
  CHECK(session(kT0 + kYear + kHour, false) == 4);
  CHECK(session(kT0 + 2 * 3600 * kSecond, true) == 5);
  const Verdict verdict = judge(dir.path(), ledger);
  CHECK(verdict.fault == "");
  CHECK(verdict.answers == 5 * 20 + 5 * 18);  // two of twenty status polls are misses
  std::uint32_t number = 0;
  store::LogReader log = open_reader(dir.path());
  for (const auto& part : log.parts()) {
    CHECK(part.number == ++number);
  }
  CHECK(number == part_files(dir.path()).size());
  for (const Slice& slice : slices(log)) {
    for (const Gap& gap : slice.gaps) {
      CHECK(gap.t_from_us <= gap.t_to_us);
    }
  }
}
