// Parts: when they change, what they carry, who may write them.

#include <sys/resource.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <csignal>
#include <fstream>
#include <thread>

#include "schema/store/part.hpp"
#include "schema/store/schema_sql.hpp"
#include "tests/schema/store_fixture.hpp"

using namespace tacho;
using namespace tacho::test;
namespace fs = std::filesystem;

namespace {

store::WriterOptions small_parts() {
  store::WriterOptions options;
  options.part_bytes = 80'000;  // an empty part has 68 608
  options.durable = false;
  return options;
}

/// Commits of twenty polls each, with so many missed ones before each commit.
void record(Recording& recording, int commits, std::uint64_t missed = 0) {
  for (int i = 0; i < commits; ++i) {
    recording.polls(20);
    if (missed > 0) {
      recording.miss(missed);
    }
    recording.writer.commit();
  }
}

std::string sql_text(const fs::path& part, const std::string& sql) {
  store::Connection connection(part, store::OpenMode::read);
  return connection.scalar(sql);
}

}  // namespace

TEST_CASE("changing the part by size loses nothing and keeps the order") {
  TempDir dir;
  {
    Recording recording(dir.path(), small_parts());
    record(recording, 60, 2);
    recording.end();
    CHECK(recording.writer.stats().parts > 3);
    CHECK(recording.writer.stats().rows == 1200);
  }
  CHECK(part_files(dir.path()).size() > 3);
  store::LogReader log = open_reader(dir.path());
  const std::vector<Stored> out = stored(log);
  REQUIRE(out.size() == 1200);
  bool same = true;
  for (std::size_t i = 0; i < out.size(); ++i) {
    same = same && out[i].seq == i + i / 20 * 2 && out[i].body == body_of(out[i].seq);
  }
  CHECK(same);
  const Coverage coverage = coverage_of(log);
  CHECK(coverage.stored == 1200);
  CHECK(coverage.missed == 120);
  CHECK(coverage.planned == 1320);
  CHECK(log.sessions().size() == 1);
  CHECK(log.sessions()[0].clean);
}

TEST_CASE("stored and missed polls are the planned ones also when the oldest parts were removed") {
  TempDir dir;
  {
    Recording recording(dir.path(), small_parts());
    record(recording, 60, 2);
    recording.end();
  }
  const std::vector<fs::path> parts = part_files(dir.path());
  fs::remove(parts[0]);
  fs::remove(parts[1]);
  store::LogReader log = open_reader(dir.path());
  const Coverage coverage = coverage_of(log);
  CHECK(coverage.stored < 1200);
  CHECK(coverage.stored == stored(log).size());
  CHECK(coverage.stored + coverage.missed == coverage.planned);
  CHECK(log.robots().at(0).name == "amr-1");
  CHECK(log.problems().empty());
}

TEST_CASE("every part can be read alone") {
  TempDir dir;
  {
    Recording recording(dir.path(), small_parts());
    record(recording, 30);
    recording.end();
  }
  std::uint64_t rows = 0;
  for (const fs::path& part : part_files(dir.path())) {
    store::LogReader log = open_reader(part);
    INFO(part);
    CHECK(log.robots().at(0).name == "amr-1");
    CHECK(log.streams().at(0).period_us == kSecond);
    const std::uint64_t here = stored(log).size();
    CHECK(coverage_of(log).stored == here);
    CHECK(coverage_of(log).planned == here);
    rows += here;
  }
  CHECK(rows == 600);
}

TEST_CASE("a new UTC day begins a new part with its first row") {
  TempDir dir;
  {
    Recording recording(dir.path(), {}, kT0 + kDay - 10 * kSecond);
    recording.polls(20);
    recording.end();
  }
  const std::vector<fs::path> parts = part_files(dir.path());
  REQUIRE(parts.size() == 2);
  store::LogReader first = open_reader(parts[0]);
  store::LogReader second = open_reader(parts[1]);
  CHECK(stored(first).size() == 10);
  CHECK(stored(second).size() == 10);
  CHECK(stored(second).front().t_us == kT0 + kDay);
}

TEST_CASE("rows around midnight that arrive late, and small steps of the clock, do not change the part") {
  TempDir dir;
  {
    Recording recording(dir.path());
    const auto at = [&](std::uint64_t seq, Micros t) {
      recording.writer.append(answer_of(1, 1, Source::status, seq, t, "{}"));
    };
    at(0, kT0 + kDay - 1);
    at(1, kT0 + kDay + 1);
    at(2, kT0 + kDay - 2);
    at(3, kT0 + kDay + 2);
    recording.end();
  }
  CHECK(part_files(dir.path()).size() == 2);
  store::LogReader log = open_reader(dir.path());
  const std::vector<Stored> out = stored(log);
  REQUIRE(out.size() == 4);
  CHECK(out[2].seq == 2);
  CHECK(out[2].t_us == kT0 + kDay - 2);
}

TEST_CASE("a clock that was a year ahead does not keep the day from turning") {
  TempDir dir;
  {
    Recording recording(dir.path());
    recording.writer.append(answer_of(1, 1, Source::status, 0, kT0 + 365 * kDay, "{}"));
    recording.writer.append(answer_of(1, 1, Source::status, 1, kT0, "{}"));
    recording.writer.append(answer_of(1, 1, Source::status, 2, kT0 + kDay, "{}"));
    recording.end();
  }
  CHECK(part_files(dir.path()).size() == 3);
  store::LogReader log = open_reader(dir.path());
  const std::vector<Stored> out = stored(log);
  REQUIRE(out.size() == 3);
  CHECK(out[0].seq == 0);
  CHECK(out[2].seq == 2);
}

TEST_CASE("a closed part needs no WAL and says so") {
  TempDir dir;
  {
    Recording recording(dir.path(), small_parts());
    record(recording, 30);
    const store::LogReader running = open_reader(dir.path());
    CHECK(running.parts().front().closed);
    CHECK_FALSE(running.parts().back().closed);
    recording.end();
  }
  for (const fs::path& part : part_files(dir.path())) {
    CHECK(sql_text(part, "PRAGMA journal_mode") == "delete");
    CHECK_FALSE(fs::exists(part.string() + "-wal"));
  }
  const store::LogReader log = open_reader(dir.path());
  for (const auto& part : log.parts()) {
    CHECK(part.closed);
    CHECK(part.first_us <= part.last_us);
    CHECK(part.bytes == fs::file_size(part.path));
  }
}

TEST_CASE("a closed part is read from a read-only folder") {
  TempDir dir;
  {
    Recording recording(dir.path());
    recording.polls(5);
    recording.end();
  }
  fs::permissions(part_files(dir.path())[0], fs::perms::owner_read);
  fs::permissions(dir.path(), fs::perms::owner_read | fs::perms::owner_exec);
  {
    store::LogReader log = open_reader(dir.path());
    CHECK(stored(log).size() == 5);
    CHECK(log.problems().empty());
  }
  fs::permissions(dir.path(), fs::perms::owner_all);
}

TEST_CASE("the next recording goes on in the same part and numbers its session") {
  TempDir dir;
  for (int run = 0; run < 3; ++run) {
    Recording recording(dir.path(), {}, kT0 + run * 1000 * kSecond);
    CHECK(recording.session == static_cast<SessionId>(run + 1));
    CHECK(recording.robot == 1);
    recording.polls(10);
    recording.end();
  }
  CHECK(part_files(dir.path()).size() == 1);
  store::LogReader log = open_reader(dir.path());
  const std::vector<Stored> out = stored(log);
  REQUIRE(out.size() == 30);
  CHECK(out[10].session == 2);
  CHECK(out[10].seq == 0);
  CHECK(log.sessions().size() == 3);
  CHECK(coverage_of(log).planned == 30);
}

TEST_CASE("the time between two recordings is a recorder_off gap without polls") {
  TempDir dir;
  {
    Recording recording(dir.path());
    recording.polls(10);
    recording.end();
  }
  {
    Recording recording(dir.path(), {}, kT0 + 5 * kDay);  // also a new part
    recording.polls(10);
    recording.end();
  }
  store::LogReader log = open_reader(dir.path());
  std::vector<Gap> gaps;
  for (const Slice& slice : slices(log)) {
    gaps.insert(gaps.end(), slice.gaps.begin(), slice.gaps.end());
  }
  REQUIRE(gaps.size() == 1);
  CHECK(gaps[0].cause == Cause::recorder_off);
  CHECK(gaps[0].seq_count == 0);
  CHECK(gaps[0].session == 2);
  CHECK(gaps[0].t_from_us == kT0 + 9 * kSecond);
  CHECK(gaps[0].t_to_us == kT0 + 5 * kDay);
  CHECK(coverage_of(log).missed == 0);
}

TEST_CASE("a robot that was absent for many parts still gets its recorder_off gap") {
  TempDir dir;
  {
    Recording recording(dir.path());
    recording.polls(3);
    recording.end();
  }
  for (int day = 1; day < 4; ++day) {  // another robot meanwhile
    store::LogWriter writer(dir.path());
    Session session;
    session.t_start_us = kT0 + day * kDay;
    const RobotId other = writer.robot("amr-2", "b");
    const SessionId id = writer.begin_session(session);
    writer.declare(stream_of(id, other, Source::status));
    writer.append(answer_of(id, other, Source::status, 0, session.t_start_us, "{}"));
    writer.end_session(session.t_start_us + 1, true);
  }
  {
    Recording recording(dir.path(), {}, kT0 + 10 * kDay);
    recording.polls(1);
    recording.end();
  }
  store::LogReader log = open_reader(dir.path());
  std::vector<Gap> gaps;
  for (const Slice& slice : slices(log)) {
    gaps.insert(gaps.end(), slice.gaps.begin(), slice.gaps.end());
  }
  REQUIRE(gaps.size() == 1);
  CHECK(gaps[0].t_from_us == kT0 + 2 * kSecond);
  CHECK(gaps[0].t_to_us == kT0 + 10 * kDay);
}

TEST_CASE("two writers of one log are refused, and the message says who has it") {
  TempDir dir;
  store::LogWriter writer(dir.path());
  try {
    store::LogWriter second(dir.path());
    FAIL("the second writer was let in");
  } catch (const Error& error) {
    const std::string what = error.what();
    CHECK(what.find("being recorded by process " + std::to_string(getpid())) != std::string::npos);
    CHECK(what.find("stop it first") != std::string::npos);
  }
}

TEST_CASE("a lock file that a killed process left does not lock") {
  TempDir dir;
  std::ofstream(dir / "recorder.lock") << "process 1 on elsewhere";
  store::LogWriter writer(dir.path());
  CHECK(part_files(dir.path()).size() == 1);
}

TEST_CASE("a folder that cannot be written to is refused with its name") {
  TempDir dir;
  if (geteuid() == 0) {
    // Root may write everywhere; a file in the way is refused for everybody.
    std::ofstream(dir / "log") << "a file";
    CHECK_THROWS_WITH(store::LogWriter(dir / "log"), Catch::Contains((dir / "log").string()));
    return;
  }
  fs::permissions(dir.path(), fs::perms::owner_read | fs::perms::owner_exec);
  CHECK_THROWS_WITH(store::LogWriter(dir.path()), Catch::Contains(dir.path().string()));
  fs::permissions(dir.path(), fs::perms::owner_all);
}

TEST_CASE("a part of a newer version is refused by writer and reader with what to do") {
  TempDir dir;
  {
    Recording recording(dir.path());
    recording.polls(1);
    recording.end();
  }
  {
    store::Connection connection(part_files(dir.path())[0], store::OpenMode::write);
    connection.exec("PRAGMA user_version = " + std::to_string(store::kSchemaVersion + 1));
  }
  CHECK_THROWS_WITH(open_reader(dir.path()), Catch::Contains("newer") && Catch::Contains("update tachograph"));
  CHECK_THROWS_WITH(store::LogWriter(dir.path()), Catch::Contains("newer"));
}

TEST_CASE("a part says what it is made of: pragmas, field table, code lists") {
  TempDir dir;
  { store::LogWriter writer(dir.path()); }
  const fs::path part = part_files(dir.path())[0];
  CHECK(sql_text(part, "PRAGMA application_id") == std::to_string(store::kApplicationId));
  CHECK(sql_text(part, "PRAGMA user_version") == std::to_string(store::kSchemaVersion));
  CHECK(sql_text(part, "PRAGMA page_size") == "1024");
  CHECK(sql_text(part, "SELECT count(*) FROM field") == std::to_string(kFieldCount));
  CHECK(sql_text(part, "SELECT unit FROM field WHERE name = 'battery_temp'") ==
        std::string(field_at(field("battery_temp")).unit));
  CHECK(sql_text(part, "SELECT name FROM code WHERE list = 'obstacle' AND value = 1") == "laser");
  CHECK(sql_text(part, "SELECT name FROM code WHERE list = 'cause' AND value = 15") == "recorder_killed");
  CHECK(sql_text(part, "SELECT count(*) FROM code WHERE list = 'source'") == std::to_string(kSourceCount));
  CHECK(sql_text(part, "SELECT count(*) FROM sqlite_schema WHERE type = 'table' AND sql NOT LIKE '%STRICT%'") == "0");
  CHECK(sql_text(part, "SELECT count(*) FROM sqlite_schema WHERE type = 'index' AND tbl_name IN ('hot', 'event')") ==
        "0");
}

TEST_CASE("a failing disk loses what was not committed, and says so in gap rows") {
  TempDir dir;
  const auto fail_writes = [&](bool fail) {
    rlimit limit{};
    getrlimit(RLIMIT_FSIZE, &limit);
    limit.rlim_cur = fail ? 120'000 : limit.rlim_max;
    setrlimit(RLIMIT_FSIZE, &limit);
  };
  std::signal(SIGXFSZ, SIG_IGN);
  std::uint64_t refused = 0;
  {
    Recording recording(dir.path());
    recording.polls(10);
    recording.writer.commit();
    fail_writes(true);
    for (int i = 0; i < 200; ++i) {
      try {
        recording.polls(10);
        recording.writer.commit();
      } catch (const Error&) {
        ++refused;
        recording.next += 1;  // whether the append or the commit failed, this number is used up
      }
    }
    fail_writes(false);
    recording.miss(3);
    recording.polls(10);
    recording.end();
  }
  std::signal(SIGXFSZ, SIG_DFL);
  CHECK(refused > 0);
  store::LogReader log = open_reader(dir.path());
  const Coverage coverage = coverage_of(log);
  CHECK(coverage.stored == stored(log).size());
  CHECK(coverage.stored >= 20);
  CHECK(coverage.missed > 3);
  bool disk = false;
  for (const Slice& slice : slices(log)) {
    for (const Gap& gap : slice.gaps) {
      disk = disk || gap.cause == Cause::disk;
    }
  }
  CHECK(disk);
  CHECK(log.problems().empty());
}

TEST_CASE("a log is read while it is written, and the writer never waits") {
  TempDir dir;
  store::WriterOptions options = small_parts();
  options.part_bytes = 107'000;
  Recording recording(dir.path(), options);
  recording.polls(10);
  recording.writer.commit();
  bool good = true;
  std::uint64_t reads = 0;
  std::atomic<bool> stop{false};
  std::thread reader([&] {
    while (!stop) {
      store::LogReader log = open_reader(dir.path());
      const std::vector<Stored> out = stored(log);
      good = good && out.size() == coverage_of(log).stored && log.problems().empty();
      for (std::size_t i = 0; i < out.size(); ++i) {
        good = good && out[i].seq == i && out[i].body == body_of(i);
      }
      ++reads;
    }
  });
  for (int i = 0; i < 200; ++i) {
    recording.polls(10);
    recording.writer.commit();
  }
  stop = true;
  reader.join();
  recording.end();
  CHECK(good);
  CHECK(reads > 0);
  store::LogReader log = open_reader(dir.path());
  CHECK(stored(log).size() == 2010);
}

TEST_CASE("several readers read at once") {
  TempDir dir;
  {
    Recording recording(dir.path());
    recording.polls(500);
    recording.end();
  }
  std::array<std::size_t, 3> rows{};
  std::vector<std::thread> threads;
  for (std::size_t& count : rows) {
    threads.emplace_back([&] {
      store::LogReader log = open_reader(dir.path());
      count = stored(log).size();
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  CHECK(rows == std::array<std::size_t, 3>{500, 500, 500});
}

TEST_CASE("a part whose finishing was cut off is finished by the next start, whether it still has a WAL or not") {
  TempDir dir;
  store::WriterOptions options;
  options.part_bytes = 100'000;
  {
    Recording recording(dir.path(), options);
    for (int i = 0; i < 20; ++i) {
      recording.polls(100);
      recording.writer.commit();
    }
    recording.end();
  }
  const std::vector<std::filesystem::path> parts = part_files(dir.path());
  REQUIRE(parts.size() > 1);
  {
    store::Connection part(parts[0], store::OpenMode::write);
    part.exec("UPDATE part SET closed = 0; DELETE FROM seal");
  }
  REQUIRE_FALSE(open_reader(dir.path()).parts().at(0).closed);
  {
    Recording recording(dir.path(), options, kT0 + 3000 * kSecond);
    recording.polls(1);
    recording.writer.commit();
    recording.end();
  }
  CHECK(open_reader(dir.path()).parts().at(0).closed);
}
