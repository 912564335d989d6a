// A kill at any moment: what was committed is there, what is missing is a gap row.

#include <fstream>

#include "schema/store/part.hpp"
#include "tests/schema/store_fixture.hpp"

using namespace tacho;
using namespace tacho::test;
namespace fs = std::filesystem;

namespace {

std::vector<Gap> all_gaps(store::LogReader& log) {
  std::vector<Gap> gaps;
  for (const Slice& slice : slices(log)) {
    gaps.insert(gaps.end(), slice.gaps.begin(), slice.gaps.end());
  }
  return gaps;
}

}  // namespace

TEST_CASE("nothing that was committed is lost by a kill, before and after the log is opened again") {
  TempDir dir;
  const fs::path log_dir = dir / "log";
  Recording recording(log_dir);
  std::uint64_t committed = 0;
  for (int step = 0; step < 30; ++step) {
    recording.polls(7);
    if (step % 3 != 2) {
      recording.writer.commit();
      committed = recording.next;
    }
    const fs::path copy = dir / ("copy" + std::to_string(step));
    copy_as_killed(log_dir, copy);
    {
      store::LogReader log = open_reader(copy);
      INFO("step " << step << ", before repair");
      CHECK(stored(log).size() == committed);
      CHECK(coverage_of(log).stored == committed);
      CHECK(coverage_of(log).planned == committed);
      CHECK(log.sessions().at(0).t_end_us == 0);
      CHECK(log.problems().empty());
    }
    { store::LogWriter writer(copy); }
    store::LogReader log = open_reader(copy);
    INFO("step " << step << ", after repair");
    CHECK(stored(log).size() == committed);
    CHECK(coverage_of(log).stored == committed);
    CHECK(coverage_of(log).planned == committed);
    CHECK(log.sessions().at(0).t_end_us != 0);
    CHECK_FALSE(log.sessions().at(0).clean);
    CHECK(log.streams().at(0).planned == committed);
  }
}

TEST_CASE("polls without a trace become gap rows of cause recorder_killed") {
  TempDir dir;
  const fs::path copy = dir / "copy";
  {
    Recording recording(dir / "log");
    recording.polls(10);
    recording.next += 5;  // missed, but the gap row was not written yet
    recording.polls(10);
    recording.miss(3);
    recording.next += 2;
    recording.miss(1);
    recording.writer.commit();
    copy_as_killed(dir / "log", copy);
    recording.end();
  }
  { store::LogWriter writer(copy); }
  store::LogReader log = open_reader(copy);
  std::vector<std::pair<std::uint64_t, std::uint64_t>> killed;
  for (const Gap& gap : all_gaps(log)) {
    if (gap.cause == Cause::recorder_killed) {
      killed.emplace_back(gap.seq_from, gap.seq_count);
      CHECK(gap.t_from_us <= gap.t_to_us);
      CHECK(gap.t_from_us >= kT0);
    }
  }
  CHECK(killed == std::vector<std::pair<std::uint64_t, std::uint64_t>>{{10, 5}, {28, 2}});
  const Coverage coverage = coverage_of(log);
  CHECK(coverage.stored + coverage.missed == coverage.planned);
  CHECK(coverage.planned == 31);
}

TEST_CASE("opening again after a kill goes on with the next session and names the time between") {
  TempDir dir;
  const fs::path copy = dir / "copy";
  {
    Recording recording(dir / "log");
    recording.polls(10);
    recording.writer.commit();
    copy_as_killed(dir / "log", copy);
  }
  {
    Recording again(copy, {}, kT0 + 100 * kSecond);
    CHECK(again.session == 2);
    again.polls(5);
    again.end();
  }
  store::LogReader log = open_reader(copy);
  CHECK(stored(log).size() == 15);
  const std::vector<Gap> gaps = all_gaps(log);
  REQUIRE(gaps.size() == 1);
  CHECK(gaps[0].cause == Cause::recorder_off);
  CHECK(gaps[0].t_from_us == kT0 + 9 * kSecond);
  CHECK(gaps[0].t_to_us == kT0 + 100 * kSecond);
  CHECK(coverage_of(log).planned == 15);
}

TEST_CASE("a killed session ends with the last poll that left a trace, stored or missed, in whatever part") {
  TempDir dir;
  const fs::path missed_last = dir / "missed";
  const fs::path new_part = dir / "new";
  store::WriterOptions options;
  options.part_bytes = 1;  // a part per commit
  {
    Recording recording(dir / "log", options);
    recording.polls(10);
    recording.miss(5);
    recording.writer.commit();
    copy_as_killed(dir / "log", new_part);
    recording.end();
  }
  {
    Recording recording(dir / "log2");
    recording.polls(10);
    recording.miss(5);
    recording.writer.commit();
    copy_as_killed(dir / "log2", missed_last);
    recording.end();
  }
  { store::LogWriter writer(missed_last); }
  CHECK(open_reader(missed_last).sessions().at(0).t_end_us == kT0 + 15 * kSecond);
  { store::LogWriter writer(new_part); }
  CHECK(open_reader(new_part).sessions().at(0).t_end_us == kT0 + 9 * kSecond);
}

TEST_CASE("what was seen, had a value, was undecodable or unknown is exact after a kill") {
  TempDir dir;
  const fs::path copy = dir / "copy";
  {
    Recording recording(dir / "log");
    Sample sample;
    sample.clear();
    const auto poll = [&] {
      sample.meta = {recording.robot, Source::status, recording.session, recording.next, recording.time(), 0};
      recording.poll("{}");
      recording.writer.note(sample);
    };
    poll();
    recording.writer.commit();
    sample.cells[field("x")].state = State::null;
    sample.cells[field("battery_level")].state = State::null;
    sample.unknown_keys = {"shiny", "shiny.deep"};
    poll();
    sample.decodable = false;
    poll();
    recording.writer.commit();
    sample.decodable = true;
    sample.cells[field("x")].state = State::present;  // nothing new but a value
    poll();
    recording.writer.commit();
    for (int i = 0; i < 310; ++i) {  // all counts are written on the way
      poll();
      recording.writer.commit();
    }
    sample.cells[field("y")].state = State::null;
    poll();
    recording.writer.commit();
    copy_as_killed(dir / "log", copy);
    recording.end();
  }
  store::LogReader log = open_reader(copy);
  const Coverage coverage = coverage_of(log);
  CHECK(coverage.seen.count() == 3);
  CHECK(coverage.seen[field("x")]);
  CHECK(coverage.seen[field("y")]);
  CHECK(coverage.seen[field("battery_level")]);
  CHECK(coverage.valued == FieldSet().set(field("x")));
  CHECK(coverage.undecodable == 1);
  CHECK(coverage.stored == 315);
  CHECK(coverage.bytes == 315 * 2);
  CHECK(coverage.first_us == kT0);
  CHECK(coverage.last_us == kT0 + 314 * kSecond);
  REQUIRE(log.unknown_keys().size() == 2);
  CHECK(log.unknown_keys()[0].key == "shiny");
  CHECK(log.unknown_keys()[0].first_us == kT0 + kSecond);
}

TEST_CASE("a kill between two parts loses nothing") {
  TempDir dir;
  store::WriterOptions options;
  options.part_bytes = 77'000;
  Recording recording(dir / "log", options);
  std::size_t parts = 1;
  int copies = 0;
  for (int step = 0; step < 60; ++step) {
    recording.polls(20);
    recording.writer.commit();
    if (part_files(dir / "log").size() != parts) {
      parts = part_files(dir / "log").size();
      const fs::path copy = dir / ("copy" + std::to_string(++copies));
      copy_as_killed(dir / "log", copy);
      std::ofstream(copy / ".unfinished-part-000099.db") << "killed while making a part";
      { store::LogWriter writer(copy); }
      CHECK_FALSE(fs::exists(copy / ".unfinished-part-000099.db"));
      store::LogReader log = open_reader(copy);
      CHECK(stored(log).size() == recording.next);
      CHECK(coverage_of(log).planned == recording.next);
      for (const auto& part : log.parts()) {
        CHECK(part.closed);
      }
    }
  }
  CHECK(copies > 2);
}

TEST_CASE("a writer that is destroyed without ending its session leaves a log that is complete") {
  TempDir dir;
  {
    Recording recording(dir.path());
    recording.polls(10);
  }
  {
    store::LogReader log = open_reader(dir.path());
    CHECK(stored(log).size() == 10);
    CHECK(log.sessions().at(0).t_end_us == 0);
  }
  { store::LogWriter writer(dir.path()); }
  store::LogReader log = open_reader(dir.path());
  CHECK(log.sessions().at(0).t_end_us == kT0 + 9 * kSecond);
  CHECK_FALSE(log.sessions().at(0).clean);
}

TEST_CASE("a damaged newest part is left alone and a new one is begun") {
  TempDir dir;
  {
    store::WriterOptions options;
    options.blocks = false;
    Recording recording(dir.path(), options);
    recording.polls(3000);
    recording.end();
  }
  const fs::path part = part_files(dir.path())[0];
  fs::resize_file(part, fs::file_size(part) - 8192);
  const auto left = fs::file_size(part);
  {
    Recording recording(dir.path(), {}, kT0 + 1000 * kSecond);
    CHECK(recording.session > 1000);
    recording.polls(5);
    recording.end();
  }
  CHECK(part_files(dir.path()).size() == 2);
  CHECK(fs::file_size(part) == left);
  store::LogReader log = open_reader(dir.path());
  const std::vector<Stored> out = stored(log);
  CHECK(out.size() > 100);
  CHECK(out.size() < 3005);
  CHECK(out.back().session > 1000);
  CHECK_FALSE(log.problems().empty());
}
