// Foreign, truncated and damaged files: what can be read is read, the rest is named, nothing is made up.

#include <fstream>

#include "schema/store/sqlite.hpp"
#include "tests/schema/flip_sweep.hpp"
#include "tests/schema/store_fixture.hpp"
#include "tests/support/golden.hpp"

using namespace tacho;
using namespace tacho::test;
namespace fs = std::filesystem;

namespace {

/// Three parts of some 300 rows each; returns the number of rows.
std::uint64_t write_parts(const fs::path& folder) {
  store::WriterOptions options;
  options.part_bytes = 107'000;
  options.keyframe_every = 10;
  options.blocks = false;
  options.durable = false;
  Recording recording(folder, options);
  while (part_files(folder).size() < 3) {
    recording.polls(10);
    recording.writer.commit();
  }
  recording.polls(50);
  recording.end();
  return recording.next;
}

/// Every row that comes out is a row that went in, in order, each once.
std::uint64_t check_honest(store::LogReader& log) {
  const std::vector<Stored> out = stored(log);
  bool honest = true;
  for (std::size_t i = 0; i < out.size(); ++i) {
    honest = honest && out[i].body == body_of(out[i].seq) && (i == 0 || out[i].seq > out[i - 1].seq);
  }
  CHECK(honest);
  return out.size();
}

bool names(const store::LogReader& log, const fs::path& path, const std::string& what) {
  for (const ReadProblem& problem : log.problems()) {
    if (problem.where == fs::canonical(path).string() && problem.what.find(what) != std::string::npos) {
      return true;
    }
  }
  return false;
}

void flip(const fs::path& path, std::uint64_t offset, unsigned char mask) {
  std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
  file.seekg(static_cast<std::streamoff>(offset));
  const int byte = file.get();
  file.seekp(static_cast<std::streamoff>(offset));
  file.put(static_cast<char>(static_cast<unsigned>(byte) ^ mask));
}

}  // namespace

TEST_CASE("foreign files are skipped and named, the log is read") {
  TempDir dir;
  const std::uint64_t rows = write_parts(dir.path());
  std::ofstream(dir / "notes.db") << "this is no database, but it is long enough to look like a file of some sort";
  std::ofstream(dir / "empty.db").flush();
  std::ofstream(dir / "truth.json") << "{}";
  {
    store::Connection other(dir / "other.db", store::OpenMode::create);
    other.exec("CREATE TABLE t(x); INSERT INTO t VALUES(1)");
  }
  fs::create_directory(dir / "folder.db");
  store::LogReader log = open_reader(dir.path());
  CHECK(names(log, dir / "notes.db", "not an SQLite database"));
  CHECK(names(log, dir / "empty.db", "empty"));
  CHECK(names(log, dir / "other.db", "another program"));
  CHECK(log.problems().size() == 3);
  for (const ReadProblem& problem : log.problems()) {
    CHECK(problem.what.find("move it out of the folder") != std::string::npos);
  }
  CHECK(check_honest(log) == rows);
}

TEST_CASE("a foreign file with a part's name does not stop a recording") {
  TempDir dir;
  fs::create_directories(dir.path());
  std::ofstream(dir / "part-000001.db") << "not a part";
  RobotId robot = 0;
  {
    Recording recording(dir.path());
    robot = recording.robot;
    recording.polls(3);
    recording.end();
  }
  store::LogReader log = open_reader(dir.path());
  CHECK(stored(log, robot).size() == 3);
  CHECK(names(log, dir / "part-000001.db", "not an SQLite database"));
  CHECK(read_file(dir / "part-000001.db") == "not a part");
}

TEST_CASE("nothing to read is an error that says what to give instead") {
  TempDir dir;
  CHECK_THROWS_WITH(open_reader(dir.path()), Catch::Contains("no part of a log"));
  CHECK_THROWS_WITH(open_reader(dir / "nowhere"), Catch::Contains("nowhere") && Catch::Contains("does not exist"));
  std::ofstream(dir / "robot.txt") << "hello";
  CHECK_THROWS_WITH(open_reader(dir / "robot.txt"), Catch::Contains("not an SQLite database"));
  std::ofstream(dir / "zero.db").flush();
  CHECK_THROWS_WITH(open_reader(dir.path()), Catch::Contains("empty"));
}

TEST_CASE("parts of different logs are refused, copies of a part are read once") {
  TempDir dir;
  const std::uint64_t rows = write_parts(dir / "a");
  write_parts(dir / "b");
  const std::vector<fs::path> both{dir / "a", dir / "b"};
  CHECK_THROWS_WITH(store::LogReader(both, {decode_x, {}}), Catch::Contains("different logs"));

  const fs::path part = part_files(dir / "a")[1];
  for (const char* name : {"part-000002 (copy).db", "before.db"}) {
    fs::copy_file(part, dir / "a" / name);
    const std::vector<fs::path> twice{dir / "a", part_files(dir / "a")[0]};
    store::LogReader log(twice, {decode_x, {}});
    CHECK(check_honest(log) == rows);
    CHECK(coverage_of(log).stored == rows);
    REQUIRE(log.problems().size() == 1);
    CHECK(log.problems()[0].where.ends_with(name));
    CHECK(log.problems()[0].what.find("is a copy of " + part.string()) != std::string::npos);
    fs::remove(dir / "a" / name);
  }
}

TEST_CASE("a truncated part yields what is left, and reading goes on with the next part") {
  TempDir dir;
  const std::uint64_t rows = write_parts(dir / "log");
  const std::vector<fs::path> parts = part_files(dir / "log");
  const std::uint64_t size = fs::file_size(parts[1]);
  std::uint64_t others = 0;
  for (const fs::path& part : {parts[0], parts[2]}) {
    store::LogReader log = open_reader(part);
    others += stored(log).size();
  }
  std::uint64_t best = 0;
  for (int step = 0; step <= 24; ++step) {
    const std::uint64_t length = size * static_cast<std::uint64_t>(step) / 25 + (step % 3 == 0 ? 0 : 1);
    const fs::path copy = dir / ("cut" + std::to_string(step));
    fs::copy(dir / "log", copy);
    const fs::path part = copy / parts[1].filename();
    fs::resize_file(part, length);
    store::LogReader log = open_reader(copy);
    INFO("cut to " << length << " of " << size << " bytes");
    const std::uint64_t found = check_honest(log);
    CHECK(found >= others);
    CHECK(found < rows);
    CHECK(coverage_of(log).stored == found);
    CHECK(names(log, part, ""));
    CHECK(slices(log).size() > 0);
    best = std::max(best, found);
    fs::remove_all(copy);
  }
  CHECK(best > others + (rows - others) / 2);
}

TEST_CASE("a part cut to nothing but a few bytes is named") {
  for (const std::uint64_t length : {0U, 1U, 15U, 16U, 99U, 100U, 511U, 512U, 4095U, 4096U, 8192U}) {
    TempDir dir;
    const std::uint64_t rows = write_parts(dir.path());
    const fs::path part = part_files(dir.path())[0];
    fs::resize_file(part, length);
    store::LogReader log = open_reader(dir.path());
    INFO("cut to " << length);
    CHECK(names(log, part, ""));
    const std::uint64_t found = check_honest(log);
    CHECK(found > 0);
    CHECK(found < rows);
  }
}

TEST_CASE("flipped bits never change an answer: it is right or it is left out and named") {
  TempDir dir;
  const std::uint64_t rows = write_parts(dir / "log");
  const std::vector<fs::path> parts = part_files(dir / "log");
  const std::uint64_t size = fs::file_size(parts[1]);
  int harmed = 0;
  for (std::uint64_t step = 0; step < 60; ++step) {
    const fs::path copy = dir / "copy";
    fs::copy(dir / "log", copy);
    const fs::path part = copy / parts[1].filename();
    flip(part, (step * 7919 * 31 + 4096) % size, static_cast<unsigned char>(1U << (step % 8)));
    store::LogReader log = open_reader(copy);
    INFO("step " << step);
    const std::uint64_t found = check_honest(log);
    slices(log);
    CHECK(found + 400 > rows - rows / 3);
    if (found < rows) {
      ++harmed;
      CHECK_FALSE(log.problems().empty());
    }
    fs::remove_all(copy);
  }
  CHECK(harmed > 5);
}

TEST_CASE("a zeroed page in the middle costs its rows and their deltas only") {
  TempDir dir;
  std::uint64_t rows = 0;
  {
    store::WriterOptions options;
    options.keyframe_every = 10;
    options.blocks = false;
    options.durable = false;
    Recording recording(dir.path(), options);
    for (int i = 0; i < 1500; ++i) {
      recording.polls(2);
      recording.writer.commit();
    }
    recording.end();
    rows = recording.next;
  }
  const fs::path part = part_files(dir.path())[0];
  {
    // A leaf of a table, from three quarters of the file on: a page above it would cost all leaves below it.
    const std::uint64_t page = page_bytes_of(read_file(part));
    constexpr int kLeaf = 0x0D;
    std::fstream file(part, std::ios::in | std::ios::out | std::ios::binary);
    std::uint64_t at = fs::file_size(part) / page * 3 / 4 * page;
    for (file.seekg(static_cast<std::streamoff>(at)); file.peek() != kLeaf;) {
      at += page;
      file.seekg(static_cast<std::streamoff>(at));
    }
    file.seekp(static_cast<std::streamoff>(at));
    file << std::string(page, '\0');
  }
  store::LogReader log = open_reader(dir.path());
  const std::uint64_t found = check_honest(log);
  CHECK(found < rows);
  CHECK(found + 100 > rows);
  CHECK(stored(log).back().seq == rows - 1);
  CHECK(names(log, part, "lost"));
}

TEST_CASE("a row that fails its checksum breaks its chain up to the next keyframe, with the range named") {
  const std::vector<std::string> harms{"t_send_us = t_send_us + 1", "rows = 1",
                                       "data = CAST(x'ff' || substr(data, 2) AS BLOB)",
                                       "data = CAST(substr(data, 1, length(data) - 1) || x'ff' AS BLOB)"};
  for (const std::string& harm : harms) {
    TempDir dir;
    {
      store::WriterOptions options;
      options.keyframe_every = 10;
      options.blocks = false;
      Recording recording(dir.path(), options);
      for (int i = 0; i < 25; ++i) {
        recording.polls(2);
        recording.writer.commit();
      }
      recording.end();
    }
    const fs::path part = part_files(dir.path())[0];
    {
      store::Connection connection(part, store::OpenMode::write);
      CHECK(connection.scalar("SELECT group_concat(seq) FROM hot WHERE base IS NULL") == "0,12,24,36,48");
      connection.exec("UPDATE hot SET " + harm + " WHERE seq = 14");
    }
    store::LogReader log = open_reader(dir.path());
    const std::vector<Stored> out = stored(log);
    INFO(harm);
    CHECK(out.size() == 40);  // a keyframe and five rows that depend on it; polls 14 to 23 are gone
    CHECK(names(log, part, "checksum"));
    CHECK(names(log, part, "(poll 16 to 23)"));
    check_honest(log);
  }
}

TEST_CASE("damaged gap and event rows are left out and counted") {
  TempDir dir;
  {
    Recording recording(dir.path());
    recording.polls(2);
    recording.miss(4);
    Event event;
    event.robot = recording.robot;
    event.session = recording.session;
    event.t_from_us = event.t_us = kT0;
    event.subject = "one";
    recording.writer.add(event);
    event.subject = "two";
    recording.writer.add(event);
    recording.end();
  }
  const fs::path part = part_files(dir.path())[0];
  {
    store::Connection connection(part, store::OpenMode::write);
    connection.exec("UPDATE gap SET seq_count = 5");
    connection.exec("UPDATE event SET subject = 'three' WHERE subject = 'two'");
  }
  store::LogReader log = open_reader(dir.path());
  const std::vector<Slice> out = slices(log);
  REQUIRE(out.size() == 1);
  CHECK(out[0].gaps.empty());
  REQUIRE(out[0].events.size() == 1);
  CHECK(out[0].events[0].subject == "one");
  CHECK(names(log, part, "1 rows of table event"));
  CHECK(names(log, part, "1 gap rows are damaged"));
  CHECK(coverage_of(log).missed == 0);
}

TEST_CASE("a part from before seals is read, continued and closed without one") {
  TempDir dir;
  { Recording(dir.path()).polls(10); }
  const fs::path part = part_files(dir.path())[0];
  {
    store::Connection connection(part, store::OpenMode::write);
    connection.exec("DROP TABLE seal; DELETE FROM summary");  // older than both
  }
  CHECK(open_reader(dir.path()).problems().empty());
  {
    Recording recording(dir.path(), {}, kT0 + 100 * kSecond);
    recording.polls(5);
    recording.end();
  }
  CHECK(part_files(dir.path()).size() == 1);
  store::LogReader log = open_reader(dir.path());
  CHECK(stored(log).size() == 15);
  CHECK(log.problems().empty());
  CHECK(log.parts().at(0).closed);
}

TEST_CASE("a part that has forgotten which log it is of costs its own rows only, also when recording goes on") {
  for (const std::size_t harmed : {1U, 2U}) {
    TempDir dir;
    const std::uint64_t rows = write_parts(dir.path());
    const fs::path part = part_files(dir.path())[harmed];
    store::LogReader alone = open_reader(part);
    const std::uint64_t here = stored(alone).size();
    {
      store::Connection connection(part, store::OpenMode::write);
      connection.exec("UPDATE part SET log = 'x' || substr(log, 2)");  // no hexadecimal digit
    }
    {
      Recording recording(dir.path(), {}, kT0 + kDay);
      recording.polls(5);
      recording.end();
    }
    store::LogReader log = open_reader(dir.path());
    INFO("part " << harmed + 1);
    CHECK(stored(log).size() == rows - here + 5);
    CHECK(names(log, part, "another log"));
    CHECK(log.sessions().back().id == (harmed == 1 ? 2 : 1002));
  }
}

TEST_CASE("rows that repeat or go back are left out and named") {
  TempDir dir;
  {
    Recording recording(dir.path());
    recording.polls(10);
    recording.end();
  }
  const fs::path part = part_files(dir.path())[0];
  {
    // The same log and number of rows in a second part: as if somebody had renumbered a copy.
    fs::copy_file(part, dir / "part-000002.db");
    store::Connection connection(dir / "part-000002.db", store::OpenMode::write);
    connection.exec("UPDATE part SET number = 2");
  }
  store::LogReader log = open_reader(dir.path());
  CHECK(check_honest(log) == 10);
  CHECK(names(log, dir / "part-000002.db", "repeat"));
}

TEST_CASE("after a part that cannot be read, numbers of sessions and robots are not given again") {
  TempDir dir(memory_folder());
  { Recording(dir.path()).polls(1); }
  fs::path newest;
  {
    store::WriterOptions options;
    options.first_part = 1;
    Recording recording(dir.path(), options, kT0 + kDay);
    recording.polls(5);
    recording.writer.commit();
    CHECK(recording.session == 2);
    CHECK(recording.writer.robot("amr-2", "127.0.0.1:19205:503") == 2);
    recording.end();
    newest = part_files(dir.path()).back();
  }
  REQUIRE(part_files(dir.path()).size() == 2);
  std::fstream(newest, std::ios::in | std::ios::out | std::ios::binary) << std::string(100, '\0');
  Recording recording(dir.path(), {}, kT0 + 2 * kDay);
  CHECK(recording.session > 1000);
  CHECK(recording.robot == 1);
  CHECK(recording.writer.robot("amr-3", "127.0.0.1:19206:504") > 1000);
  recording.polls(5);
  recording.end();
}

TEST_CASE("a part that was left damaged is not sealed as if it were whole") {
  TempDir dir(memory_folder());
  { Recording(dir.path()).polls(1); }
  { Recording(dir.path(), {}, kT0 + kDay).polls(1); }
  const std::vector<fs::path> parts = part_files(dir.path());
  REQUIRE(parts.size() == 2);
  store::Connection(parts[0], store::OpenMode::write)
      .exec("UPDATE part SET closed = 0; DELETE FROM summary; UPDATE coverage SET bytes = bytes + 1");
  CHECK_FALSE(open_reader(dir.path()).problems().empty());
  { Recording(dir.path(), {}, kT0 + 2 * kDay).polls(1); }
  CHECK_FALSE(open_reader(dir.path()).problems().empty());
}
