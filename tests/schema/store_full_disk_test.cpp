// A disk that is full: the oldest part makes room where the rules allow it; else recording waits for space and goes on.

#include <random>
#include <set>

#include "schema/store/unsaved_rows.hpp"
#include "tests/schema/store_workload.hpp"
#include "tests/support/faulty_vfs.hpp"

using namespace tacho;
using namespace tacho::test;
namespace fs = std::filesystem;

namespace {

store::WriterOptions options_of(store::RetentionRules rules, FaultyDisk& disk, std::uint64_t capacity) {
  store::WriterOptions options = workload_options();
  options.retention.rules = rules;
  options.retention.free_bytes = [&disk, capacity](const fs::path&) {
    const std::uint64_t used = disk.used();
    return std::optional<std::uint64_t>(capacity > used ? capacity - used : 0);
  };
  return options;
}

/// Commits of twenty polls; how many of them were refused, with or without some of their polls.
int record(Recording& recording, int commits) {
  int refused = 0;
  for (int i = 0; i < commits; ++i) {
    bool good = true;
    const auto attempt = [&](const auto& step) {
      try {
        step();
        return true;
      } catch (const Error&) {
        return good = false;
      }
    };
    for (int n = 0; n < 20; ++n) {
      recording.next += attempt([&] { recording.polls(1); }) ? 0U : 1U;
    }
    attempt([&] { recording.writer.commit(); });
    refused += good ? 0 : 1;
  }
  return refused;
}

struct Rest {
  std::uint64_t first = 0;  ///< poll of the first part that is left
  std::uint64_t missed = 0;
  std::set<std::string> reasons;  ///< of removals
};

/// What is left of a log of polls 0 .. `end` - 1: every poll from the first one on is stored or in a gap of cause disk.
Rest rest_of(const fs::path& folder, std::uint64_t end) {
  store::LogReader log = open_reader(folder);
  Rest rest;
  rest.first = log.first_poll(log.streams().at(0));
  std::vector<int> seen(end, 0);
  for (const Stored& answer : stored(log)) {
    ++seen.at(answer.seq);
  }
  for (const Slice& slice : slices(log)) {
    for (const Gap& gap : slice.gaps) {
      CHECK(gap.cause == Cause::disk);
      rest.missed += gap.seq_count;
      for (std::uint64_t seq = gap.seq_from; seq < gap.seq_from + gap.seq_count; ++seq) {
        ++seen.at(seq);
      }
    }
  }
  for (std::uint64_t seq = 0; seq < end; ++seq) {
    REQUIRE(seen[seq] == (seq < rest.first ? 0 : 1));
  }
  const Coverage coverage = coverage_of(log);
  CHECK(coverage.stored + coverage.missed == coverage.planned);
  for (std::size_t part = 0; part < log.parts().size(); ++part) {
    for (const Event& event : log.part_records(part, 0).events) {
      rest.reasons.insert(event.new_value);
    }
  }
  CHECK(log.problems().empty());
  return rest;
}

}  // namespace

TEST_CASE("a disk that is full loses its oldest closed part, and recording goes on") {
  TempDir dir(memory_folder());
  FaultyDisk disk(dir / "log");
  constexpr std::uint64_t kCapacity = 500'000;
  store::WriterOptions options = options_of({0, 0, 1}, disk, kCapacity);
  options.retention.free_bytes = [](const fs::path&) { return std::nullopt; };  // a quota that nobody tells of
  std::uint64_t polls = 0;
  {
    Recording recording(dir / "log", options);
    disk.set_capacity(kCapacity);
    CHECK(record(recording, 100) < 5);
    disk.set_capacity(disk.used());  // somebody else takes the rest, between two commits
    CHECK(record(recording, 50) < 5);
    disk.set_capacity(std::nullopt);
    recording.end();
    polls = recording.next;
  }
  const Rest rest = rest_of(dir / "log", polls);
  CHECK(rest.first > 1000);
  // Only a write that failed gives this reason; what it costs is at most the polls of its commit, or none when it was
  // one of closing a part or of opening the next one ahead.
  CHECK(rest.reasons == std::set<std::string>{"disk_full"});
}

TEST_CASE("a reserve is kept before the disk is full, and costs no poll") {
  TempDir dir(memory_folder());
  FaultyDisk disk(dir / "log");
  constexpr std::uint64_t kCapacity = 1'000'000;
  std::uint64_t polls = 0;
  {
    Recording recording(dir / "log", options_of({0, 0, 300'000}, disk, kCapacity));
    disk.set_capacity(kCapacity);
    CHECK(record(recording, 150) == 0);
    polls = recording.next;
    recording.end();
  }
  const Rest rest = rest_of(dir / "log", polls);
  CHECK(rest.first > 500);
  CHECK(rest.missed == 0);
  CHECK(rest.reasons == std::set<std::string>{"reserve"});
}

TEST_CASE("with nothing to remove, recording waits for space, goes on by itself and says what is lost") {
  for (const std::uint64_t reserve : {0U, 1U}) {
    TempDir dir(memory_folder());
    FaultyDisk disk(dir / "log");
    store::WriterOptions options = options_of({0, 0, reserve}, disk, 1u << 30);
    options.part_bytes = 1u << 30;  // one part
    std::uint64_t polls = 0;
    {
      Recording recording(dir / "log", options);
      CHECK(record(recording, 20) == 0);
      disk.set_capacity(disk.used() + 20'000);
      CHECK(record(recording, 60) > 20);
      disk.set_capacity(std::nullopt);
      CHECK(record(recording, 20) == 0);
      recording.end();
      polls = recording.next;
    }
    const Rest rest = rest_of(dir / "log", polls);
    CHECK(rest.first == 0);
    CHECK(rest.missed > 20);
    CHECK(rest.reasons.empty());
  }
}

TEST_CASE("events and clock points that a failing disk refused are written once it works, each once") {
  TempDir dir(memory_folder());
  FaultyDisk disk(dir / "log");
  store::WriterOptions options = options_of({}, disk, 1u << 30);
  options.part_bytes = 1u << 30;
  {
    Recording recording(dir / "log", options);
    const auto note = [&] {
      Event event;
      event.robot = recording.robot;
      event.session = recording.session;
      event.t_us = event.t_from_us = recording.time();
      event.subject = std::to_string(recording.next);
      recording.writer.add(event);
      recording.writer.add(ClockPoint{recording.robot, recording.session, recording.time(), 1, {}});
    };
    std::size_t refused = 0;
    for (int i = 0; i < 100; ++i) {
      if (i == 20) {
        disk.set_capacity(disk.used() + 2'000);
      } else if (i == 80) {
        disk.set_capacity(std::nullopt);
      }
      const std::uint64_t next = recording.next;
      for (const std::function<void()>& step : std::initializer_list<std::function<void()>>{
               [&] { recording.polls(1); }, note, [&] { recording.writer.commit(); }}) {
        try {
          step();
        } catch (const Error&) {
          ++refused;
        }
      }
      recording.next = next + 1;
    }
    CHECK(refused > 20);
    recording.end();
  }
  store::LogReader log = open_reader(dir / "log");
  CHECK(coverage_of(log).missed > 20);
  const store::LogReader::Records records = log.part_records(0, 1);
  std::vector<std::string> subjects;
  for (const Event& event : records.events) {
    subjects.push_back(event.subject);
  }
  CHECK(subjects.size() == 100);
  CHECK(std::set<std::string>(subjects.begin(), subjects.end()).size() == 100);
  CHECK(records.clock.size() == 100);
}

TEST_CASE("of the events of a disk that fails for very long the log keeps the first, and says how many it lost") {
  constexpr std::size_t kLost = 7;
  TempDir dir(memory_folder());
  FaultyDisk disk(dir / "log");
  {
    Recording recording(dir / "log", options_of({}, disk, 1u << 30));
    CHECK(record(recording, 1) == 0);
    disk.set_capacity(disk.used());
    Event event;
    event.robot = recording.robot;
    event.session = recording.session;
    event.t_us = event.t_from_us = recording.time();
    for (std::size_t i = 0; i < store::UnsavedRows::kMost + kLost; ++i) {
      try {
        recording.writer.add(event);
      } catch (const Error&) {
        continue;
      }
    }
    CHECK(record(recording, 1) == 1);
    disk.set_capacity(std::nullopt);
    recording.end();
  }
  store::LogReader log = open_reader(dir / "log");
  CHECK(log.part_records(0, 1).events.size() == store::UnsavedRows::kMost);
  std::vector<std::string> told;
  for (const Event& event : log.part_records(0, 0).events) {
    told.push_back(event.kind == EventKind::mark ? event.detail : "");
  }
  REQUIRE(told.size() == 1);
  CHECK(told[0].starts_with("7 events"));
}

TEST_CASE("without a reserve a full disk costs polls and no part") {
  TempDir dir(memory_folder());
  FaultyDisk disk(dir / "log");
  std::uint64_t polls = 0;
  {
    Recording recording(dir / "log", options_of({}, disk, 1u << 30));
    CHECK(record(recording, 40) == 0);
    const std::size_t parts = part_files(dir / "log").size();
    CHECK(parts > 2);
    disk.set_capacity(disk.used() + 2'000);
    CHECK(record(recording, 40) > 20);
    CHECK(part_files(dir / "log").size() >= parts);
    disk.set_capacity(std::nullopt);
    CHECK(record(recording, 5) == 0);
    recording.end();
    polls = recording.next;
  }
  CHECK(rest_of(dir / "log", polls).first == 0);
}

TEST_CASE("a recorder that starts on a full disk makes room first") {
  TempDir dir(memory_folder());
  FaultyDisk disk(dir / "log");
  {
    Recording recording(dir / "log", options_of({}, disk, 1u << 30));
    CHECK(record(recording, 60) == 0);
    recording.end();
  }
  const std::size_t parts = part_files(dir / "log").size();
  REQUIRE(parts > 3);
  disk.set_capacity(disk.used());
  {
    store::WriterOptions options = options_of({0, 0, 1}, disk, 1u << 30);
    options.retention.free_bytes = {};
    Recording recording(dir / "log", options, kT0 + 2000 * kSecond);
    CHECK(record(recording, 5) < 5);
    disk.set_capacity(std::nullopt);
    recording.end();
  }
  CHECK(part_files(dir / "log").size() < parts + 1);
  store::LogReader log = open_reader(dir / "log");
  CHECK(log.problems().empty());
  CHECK(log.sessions().size() == 2);
  CHECK(coverage_of(log).stored + coverage_of(log).missed == coverage_of(log).planned);
}

TEST_CASE("whenever the power fails while parts are removed, the newest part of the log is left, without a hole") {
  std::mt19937 random(20260102);
  TempDir dir(memory_folder());
  struct Cut {
    FaultyDisk::Image image;
    std::uint64_t acknowledged;
  };
  std::vector<Cut> cuts;
  {
    FaultyDisk disk(dir / "log");
    std::uint64_t acknowledged = 0;
    Recording recording(dir / "log", options_of({0, 300'000, 0}, disk, 1u << 30));
    bool removing = false;
    disk.before_each_call([&](Call call) {
      removing = removing || call == Call::remove;  // before, while and after a part goes
      if (random() % (removing ? 20 : 200) == 0) {
        cuts.push_back({disk.after_power_cut(random), acknowledged});
        removing = false;
      }
    });
    for (int i = 0; i < 100; ++i) {
      recording.polls(20);
      recording.writer.commit();
      acknowledged = recording.next;
    }
  }
  CHECK(cuts.size() > 20);
  for (const Cut& cut : cuts) {
    INFO(cut.acknowledged << " polls acknowledged");
    write_image(cut.image, dir / "cut");
    const FaultyDisk without_real_syncs(dir / "cut");
    { store::LogWriter writer(dir / "cut"); }
    REQUIRE(integrity_of(dir / "cut") == "");
    store::LogReader log = open_reader(dir / "cut");
    const std::vector<Stored> answers = stored(log);
    REQUIRE((cut.acknowledged == 0 || !answers.empty()));
    for (std::size_t i = 1; i < answers.size(); ++i) {
      REQUIRE(answers[i].seq == answers[0].seq + i);
    }
    REQUIRE((answers.empty() || answers.back().seq + 1 >= cut.acknowledged));
    REQUIRE(coverage_of(log).stored + coverage_of(log).missed == coverage_of(log).planned);
    REQUIRE(log.problems().empty());
  }
}
