// SIGKILL at any moment: a child records, its parent kills it. What the child said it had committed is there.

#include <poll.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <random>
#include <thread>

#include "tests/schema/store_workload.hpp"

using namespace tacho;
using namespace tacho::test;
namespace fs = std::filesystem;

namespace {

/// What the child reports after each step: how far it went, and how far it committed.
struct Progress {
  SessionId session = 0;
  std::uint64_t appended = 0;
  std::uint64_t acknowledged = 0;
  std::uint64_t events = 0;  ///< acknowledged
};

/// Never returns; records until it is killed.
[[noreturn]] void record_for_ever(const fs::path& folder, Ledger ledger, int pipe, int round) {
  try {
    Workload work(folder, ledger);
    work.begin(kT0 + (round * 2 + 1) * kDay - 40 * kSecond);
    Progress progress;
    progress.session = work.session();
    const auto report = [&] {
      if (write(pipe, &progress, sizeof progress) != static_cast<ssize_t>(sizeof progress)) {
        _exit(2);
      }
    };
    for (;;) {
      progress.appended = work.next() + 2;
      report();
      work.poll();
      work.poll();
      work.commit();
      progress.acknowledged = progress.appended;
      progress.events = ledger.last_event;
      report();
    }
  } catch (const std::exception& error) {
    std::fprintf(stderr, "child: %s\n", error.what());
    _exit(1);
  }
}

/// Lets a child record for some time, kills it, and books what it reported. `records`: the time begins with its first
/// poll, however long it takes to get there on this machine, else with the child.
void record_and_kill(const fs::path& folder, Ledger& ledger, int round, bool records, std::chrono::microseconds life) {
  std::array<int, 2> ends{};
  REQUIRE(pipe(ends.data()) == 0);
  const pid_t child = fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    close(ends[0]);
    record_for_ever(folder, ledger, ends[1], round);
  }
  close(ends[1]);
  if (records) {
    constexpr int kLongestStartMs = 60'000;
    pollfd report{ends[0], POLLIN, 0};
    REQUIRE(poll(&report, 1, kLongestStartMs) == 1);
  }
  std::this_thread::sleep_for(life);
  kill(child, SIGKILL);
  const std::uint64_t events_before = ledger.last_event;
  Progress last;
  Progress progress;
  while (read(ends[0], &progress, sizeof progress) == static_cast<ssize_t>(sizeof progress)) {
    last = progress;
  }
  close(ends[0]);
  int status = 0;
  waitpid(child, &status, 0);
  REQUIRE(WIFSIGNALED(status));
  if (last.session != 0) {
    for (const Source source : kWorkloadSources) {
      ledger.streams[{last.session, source}] = {last.acknowledged, last.appended, {}};
    }
    for (std::uint64_t event = events_before + 1; event <= last.events; ++event) {
      ledger.events.push_back(event);
    }
    // Numbers that were not acknowledged are never used again.
    ledger.last_event = std::max(last.events, events_before) + 2;
  }
}

/// A kill before the first part has its name leaves nothing to read.
Verdict judge_if_any(const fs::path& folder, const Ledger& ledger, bool repaired) {
  if (fs::exists(folder) && !part_files(folder).empty()) {
    return judge(folder, ledger, repaired);
  }
  Verdict verdict;
  for (const auto& [key, extent] : ledger.streams) {
    verdict.fault = extent.acknowledged > 0 ? "no part is left" : "";
  }
  return verdict;
}

}  // namespace

TEST_CASE("a recording that is killed at any moment keeps every acknowledged answer and opens again") {
  const int kills = std::getenv("TACHO_LONG") != nullptr ? 10'000 : 200;
  constexpr int kKillsPerLog = 5;
#ifdef __SANITIZE_THREAD__
  constexpr unsigned kLongestLifeUs = 600'000;  // everything takes ten times as long
#else
  constexpr unsigned kLongestLifeUs = 60'000;
#endif
  std::mt19937 random(std::random_device{}());
  std::uint64_t answers = 0;
  for (int killed = 0; killed < kills;) {
    TempDir dir(memory_folder());
    Ledger ledger;
    for (int round = 0; round < kKillsPerLog; ++round, ++killed) {
      const std::chrono::microseconds life(1000 + random() % kLongestLifeUs);
      record_and_kill(dir / "log", ledger, round, random() % 2 == 0, life);
      INFO("kill " << killed << " after " << life.count() << " us");
      Verdict verdict = judge_if_any(dir / "log", ledger, false);
      REQUIRE(verdict.fault == "");
      if (round % 2 == 1) {  // else the next child finds it as it is
        { store::LogWriter writer(dir / "log"); }
        REQUIRE(integrity_of(dir / "log") == "");
        verdict = judge(dir / "log", ledger);
        REQUIRE(verdict.fault == "");
      }
      answers += verdict.answers;
    }
  }
  CHECK(answers > 0);
}
