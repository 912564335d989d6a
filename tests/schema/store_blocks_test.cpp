// Answers move from hot rows into blocks while a log is written: nobody who reads it can tell.

#include "schema/store/part.hpp"
#include "schema/store/sqlite.hpp"
#include "tests/schema/store_fixture.hpp"

using namespace tacho;
using namespace tacho::test;
namespace fs = std::filesystem;

namespace {

struct Rows {
  std::int64_t hot = 0;
  std::int64_t blocks = 0;
  std::int64_t moved = 0;
};

Rows rows_of(const fs::path& part) {
  store::Connection connection(part, store::OpenMode::read);
  return {connection.integer("SELECT ifnull(sum(rows), 0) FROM hot"), connection.integer("SELECT count(*) FROM block"),
          connection.integer("SELECT ifnull(sum(rows), 0) FROM block")};
}

/// All answers of all sources in the order the reader gives them.
std::vector<std::pair<Source, std::uint64_t>> order_of(const fs::path& log) {
  std::vector<std::pair<Source, std::uint64_t>> order;
  store::LogReader reader = open_reader(log);
  for (std::size_t part = 0; part < reader.parts().size(); ++part) {
    reader.part_answers(part, 1, std::nullopt, [&](const Answer& a) { order.emplace_back(a.meta.source, a.meta.seq); });
  }
  return order;
}

constexpr std::uint64_t kEnough = 1850;  // rows a second apart that make a block

}  // namespace

TEST_CASE("a stream with rows of half an hour moves into a block, the next rows stay hot, and both are read as one") {
  TempDir dir;
  Recording recording(dir.path());
  recording.polls(kEnough);
  recording.writer.commit();
  recording.polls(100);
  recording.writer.commit();
  const Rows rows = rows_of(part_files(dir.path())[0]);
  CHECK(rows.blocks == 1);
  CHECK(rows.moved == kEnough);
  CHECK(rows.hot == 100);
  store::LogReader log = open_reader(dir.path());
  const std::vector<Stored> out = stored(log);
  REQUIRE(out.size() == kEnough + 100);
  for (std::size_t i = 0; i < out.size(); ++i) {
    CHECK(out[i].seq == i);
    CHECK(out[i].t_us == kT0 + static_cast<Micros>(i) * kSecond);
    CHECK(out[i].body == body_of(i));
  }
  CHECK(coverage_of(log).stored == kEnough + 100);
  CHECK(log.problems().empty());
}

TEST_CASE("a part that is closed has all its answers in blocks") {
  TempDir dir;
  {
    Recording recording(dir.path());
    recording.polls(30);
    recording.end();
  }
  const Rows rows = rows_of(part_files(dir.path())[0]);
  CHECK(rows.hot == 0);
  CHECK(rows.moved == 30);
}

TEST_CASE("answers come out in the order they arrived in, whichever of them have moved") {
  TempDir dir;
  std::vector<std::pair<Source, std::uint64_t>> arrived;
  Recording recording(dir.path());
  store::LogWriter& w = recording.writer;
  w.declare(stream_of(1, 1, Source::registers));
  w.declare(stream_of(1, 1, Source::inputs));
  std::uint64_t inputs = 0;
  for (std::uint64_t i = 0; i < 5000; ++i) {
    const Micros t = kT0 + static_cast<Micros>(i) * kSecond;
    recording.poll(body_of(i));
    arrived.emplace_back(Source::status, i);
    if (i % 3 != 1) {
      w.append(answer_of(1, 1, Source::registers, i, t + 1, body_of(i * 7)));
      arrived.emplace_back(Source::registers, i);
    }
    if (i % 11 == 0) {
      w.append(answer_of(1, 1, Source::inputs, inputs, t + 2, "inputs"));
      arrived.emplace_back(Source::inputs, inputs++);
    }
    if (i % 50 == 49) {
      w.commit();
    }
  }
  const Rows rows = rows_of(part_files(dir.path())[0]);
  CHECK(rows.blocks > 2);
  CHECK(rows.hot > 0);
  CHECK(order_of(dir.path()) == arrived);
  recording.end();
  CHECK(order_of(dir.path()) == arrived);
}

TEST_CASE("a window yields the same answers from blocks as from hot rows") {
  TempDir dir;
  Recording recording(dir.path());
  for (int i = 0; i < 4; ++i) {
    recording.polls(kEnough);
    recording.writer.commit();
  }
  store::LogReader log = open_reader(dir.path());
  for (const std::uint64_t from : {0U, 1U, 300U, 1849U, 1850U, 1851U, 3699U, 5000U, 7400U}) {
    const Micros start = kT0 + static_cast<Micros>(from) * kSecond;
    const std::vector<Stored> out = stored(log, 1, Source::status, {start, start + 700 * kSecond});
    const std::uint64_t expected = std::min<std::uint64_t>(700, 4 * kEnough - from);
    REQUIRE(out.size() == expected);
    CHECK((out.empty() || out.front().seq == from));
  }
  CHECK(log.problems().empty());
}

TEST_CASE("a kill loses nothing that has moved, and holes between moved answers become gaps") {
  TempDir dir;
  const fs::path copy = dir / "copy";
  {
    Recording recording(dir / "log");
    recording.polls(kEnough - 400);
    recording.next += 7;  // missed, but the gap row was not written yet
    recording.polls(400);
    recording.writer.commit();
    recording.polls(20);
    recording.writer.commit();
    copy_as_killed(dir / "log", copy);
  }
  CHECK(rows_of(part_files(copy)[0]).moved == kEnough);
  { store::LogWriter writer(copy); }
  store::LogReader log = open_reader(copy);
  const Coverage coverage = coverage_of(log);
  CHECK(coverage.stored == kEnough + 20);
  CHECK(coverage.missed == 7);
  CHECK(coverage.planned == kEnough + 27);
  CHECK(stored(log).size() == kEnough + 20);
  CHECK(log.problems().empty());
  CHECK(rows_of(part_files(copy)[0]).hot == 0);
}

TEST_CASE("a damaged block is named, and costs the answers that need what is damaged") {
  TempDir dir;
  {
    Recording recording(dir.path());
    for (int i = 0; i < 3; ++i) {
      recording.polls(kEnough);
      recording.writer.commit();
    }
    recording.end();
  }
  const fs::path part = part_files(dir.path())[0];
  {
    store::Connection connection(part, store::OpenMode::write);
    connection.exec(
        "UPDATE block SET data = CAST(substr(data, 1, 40) || x'ff' || substr(data, 42) AS BLOB) "
        "WHERE id = 2");
  }
  store::LogReader log = open_reader(part);
  CHECK(stored(log).size() == 2 * kEnough);
  REQUIRE_FALSE(log.problems().empty());
  CHECK_THAT(log.problems().back().what, Catch::Contains("block 2"));
}

TEST_CASE("a row of the block table that was changed is named and not used") {
  TempDir dir;
  {
    Recording recording(dir.path());
    recording.polls(kEnough);
    recording.end();
  }
  const fs::path part = part_files(dir.path())[0];
  {
    store::Connection connection(part, store::OpenMode::write);
    connection.exec("UPDATE block SET robot = 9");
  }
  store::LogReader log = open_reader(part);
  CHECK(stored(log).empty());
  REQUIRE_FALSE(log.problems().empty());
  CHECK_THAT(log.problems().back().what, Catch::Contains("table block"));
}
