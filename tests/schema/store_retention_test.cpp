// Retention at work on a log that is written: what goes, what the log says of it, and what never goes.

#include <fstream>
#include <functional>
#include <memory>
#include <numeric>

#include "schema/store/kept_parts.hpp"
#include "schema/store/sqlite.hpp"
#include "tests/schema/store_fixture.hpp"

using namespace tacho;
using namespace tacho::test;
namespace fs = std::filesystem;

namespace {

constexpr Micros kYear = 365 * kDay;

store::WriterOptions small_parts(store::RetentionRules rules) {
  store::WriterOptions options;
  options.part_bytes = 82'000;  // an empty part has 68 608
  options.durable = false;
  options.retention.rules = rules;
  return options;
}

std::uint64_t bytes_of(const fs::path& folder) {
  const std::vector<fs::path> parts = part_files(folder);
  return std::accumulate(parts.begin(), parts.end(), std::uint64_t{0},
                         [](std::uint64_t sum, const fs::path& part) { return sum + store::part_file_bytes(part); });
}

std::vector<Event> removals(const fs::path& folder) {
  store::LogReader log = open_reader(folder);
  std::vector<Event> out;
  for (std::size_t part = 0; part < log.parts().size(); ++part) {
    for (const Event& event : log.part_records(part, 0).events) {
      if (event.kind == EventKind::part_removed) {
        out.push_back(event);
      }
    }
  }
  return out;
}

/// The polls that are left: the newest ones, without a hole, up to `end`; the first of them.
std::uint64_t first_of_rest(const fs::path& folder, std::uint64_t end) {
  store::LogReader log = open_reader(folder);
  const std::vector<Stored> out = stored(log);
  REQUIRE_FALSE(out.empty());
  const std::uint64_t first = out.front().seq;
  REQUIRE(out.size() == end - first);
  for (std::size_t i = 0; i < out.size(); ++i) {
    REQUIRE(out[i].seq == first + i);
    REQUIRE(out[i].body == body_of(out[i].seq));
  }
  const Coverage coverage = coverage_of(log);
  CHECK(coverage.stored == out.size());
  CHECK(coverage.stored + coverage.missed == coverage.planned);
  CHECK(log.problems().empty());
  return first;
}

/// Records one answer an hour on a host whose wall clock is `wrong_by` off, and not synchronised while that is not 0
/// unless `synchronised` says so.
class Host {
 public:
  Host(const fs::path& folder, store::WriterOptions options, bool is_synchronised = true)
      : synchronised(is_synchronised), recording_(folder, with_time(std::move(options))) {}

  void record_days(int days) {
    for (int hour = 0; hour < 24 * days; ++hour) {
      const Micros wall = kT0 + mono_us_ + wrong_by;
      recording_.writer.append(answer_of(1, 1, Source::status, recording_.next, wall, body_of(recording_.next)));
      ++recording_.next;
      recording_.writer.commit();
      mono_us_ += 3600 * kSecond;
    }
  }
  void robot_says(Micros wrong) {
    recording_.writer.add(ClockPoint{1, 1, kT0 + mono_us_ + wrong_by, mono_us_, kT0 + mono_us_ + wrong});
  }
  void end() { recording_.end(); }
  [[nodiscard]] std::uint64_t polls() const { return recording_.next; }

  Micros wrong_by = 0;
  bool synchronised;

 private:
  Micros mono_us_ = 0;
  Recording recording_;

  store::WriterOptions with_time(store::WriterOptions options) {
    options.retention.time = [this] { return store::HostTime{kT0 + mono_us_ + wrong_by, mono_us_, synchronised}; };
    return options;
  }
};

store::WriterOptions by_age(Micros age_us) {
  store::WriterOptions options;
  options.durable = false;
  options.retention.rules.age_us = age_us;
  return options;
}

}  // namespace

TEST_CASE("a log stays within its size while it is recorded, and is the newest part of itself") {
  TempDir dir(memory_folder());
  constexpr std::uint64_t kSize = 400'000;
  Recording recording(dir.path(), small_parts({0, kSize, 0}));
  std::uint64_t most = 0;
  for (int i = 0; i < 100; ++i) {
    recording.polls(20);
    recording.writer.commit();
    most = std::max(most, bytes_of(dir.path()));
  }
  recording.end();
  CHECK(most < kSize + 100'000);  // one part more, until the next commit has removed one
  CHECK(first_of_rest(dir.path(), recording.next) > 500);
  const std::vector<Event> events = removals(dir.path());
  REQUIRE_FALSE(events.empty());
  store::LogReader log = open_reader(dir.path());
  CHECK(events.back().subject == "part " + std::to_string(log.parts().front().number - 1));
  CHECK(events.back().new_value == "size");
  CHECK(events.back().session == 1);
  CHECK_THAT(events.back().detail, Catch::Contains("2026-01-01T") && Catch::Contains("above 390.6 KB"));
}

TEST_CASE("rules that a log has outgrown are kept from the start, and the first session tells of it") {
  TempDir dir(memory_folder());
  {
    Recording recording(dir.path(), small_parts({}));
    for (int i = 0; i < 80; ++i) {
      recording.polls(20);
      recording.writer.commit();
    }
    recording.end();
  }
  const std::size_t before = part_files(dir.path()).size();
  std::vector<std::string> told;
  store::WriterOptions options = small_parts({0, 300'000, 0});
  options.retention.tell = [&](const std::string& text) { told.push_back(text); };
  { Recording recording(dir.path(), options, kT0 + 1700 * kSecond); }
  const std::size_t after = part_files(dir.path()).size();
  CHECK(after + 2 < before);
  CHECK(bytes_of(dir.path()) <= 300'000);
  CHECK(told.size() == before - after);
  CHECK(removals(dir.path()).size() == before - after);
  CHECK_THAT(told.at(0), Catch::Contains("removed part-000001.db") && Catch::Contains("the log was above"));
}

TEST_CASE("parts go by age when a confirmed clock has seen them end so long ago") {
  TempDir dir(memory_folder());
  Host host(dir.path(), by_age(3 * kDay));
  host.record_days(10);
  host.end();
  // At the end of the tenth day the seventh ended three days ago.
  CHECK(part_files(dir.path()).size() == 3);
  CHECK(first_of_rest(dir.path(), host.polls()) == 7 * 24);
  for (const Event& event : removals(dir.path())) {
    CHECK(event.new_value == "age");
  }
}

TEST_CASE("a wall clock a year ahead and back again deletes nothing, and nothing collides") {
  TempDir dir(memory_folder());
  Host host(dir.path(), by_age(30 * kDay));
  host.record_days(4);
  host.synchronised = false;  // the kernel drops it when the clock is set
  host.wrong_by = kYear;
  host.robot_says(0);
  host.record_days(4);
  host.wrong_by = 0;
  host.record_days(4);
  CHECK(part_files(dir.path()).size() == 12);
  host.synchronised = true;  // also what ended in the wrong year is now known to be no older than this
  host.record_days(2);
  host.end();
  CHECK(part_files(dir.path()).size() == 14);
  CHECK(removals(dir.path()).empty());
  CHECK(first_of_rest(dir.path(), host.polls()) == 0);
  const store::LogReader log = open_reader(dir.path());
  for (std::size_t i = 0; i < log.parts().size(); ++i) {
    CHECK(log.parts()[i].number == i + 1);
  }
}

TEST_CASE("the same year ahead would have deleted the days before it, had the clock been believed") {
  TempDir dir(memory_folder());
  Host host(dir.path(), by_age(30 * kDay));
  host.record_days(4);
  host.wrong_by = kYear;
  host.record_days(1);
  host.end();
  CHECK(part_files(dir.path()).size() == 2);  // the last day of the right time ended when the clock jumped
}

TEST_CASE("days of a wrong clock grow old with the days after them") {
  TempDir dir(memory_folder());
  Host host(dir.path(), by_age(3 * kDay), false);
  host.wrong_by = kYear;  // from the start, and nobody says so
  host.record_days(4);
  host.wrong_by = 0;
  host.synchronised = true;
  host.record_days(3);
  CHECK(part_files(dir.path()).size() == 7);
  host.record_days(3);
  host.end();
  CHECK(part_files(dir.path()).size() == 3);
}

TEST_CASE("a clock that nobody confirms ages nothing, but size goes on to be kept") {
  TempDir dir(memory_folder());
  store::WriterOptions options = by_age(kDay);
  options.retention.rules.size_bytes = 500'000;
  Host host(dir.path(), options, false);
  host.record_days(12);
  host.end();
  CHECK(part_files(dir.path()).size() > 3);
  CHECK(bytes_of(dir.path()) < 500'000 + 80'000);
  REQUIRE_FALSE(removals(dir.path()).empty());
  for (const Event& event : removals(dir.path())) {
    CHECK(event.new_value == "size");
  }
}

TEST_CASE("robots that show the host's time confirm its clock where there is no time server") {
  TempDir dir(memory_folder());
  Host host(dir.path(), by_age(3 * kDay), false);
  host.robot_says(0);
  host.record_days(10);
  host.end();
  CHECK(part_files(dir.path()).size() == 3);
}

TEST_CASE("files that are no parts of this log are never removed") {
  TempDir dir(memory_folder());
  {
    Recording other(dir / "other");
    other.polls(5);
    other.end();
  }
  fs::create_directory(dir / "log");
  fs::copy_file(part_files(dir / "other")[0], dir / "log" / "part-000000.db");
  std::ofstream(dir / "log" / "part-000001.db") << std::string(500'000, 'x');
  {
    Recording first(dir / "log", small_parts({}));
    first.polls(1);
    first.end();
  }
  fs::remove(dir / "log" / "part-000000.db");  // the log has its own name by now
  const fs::path wal = dir / "log" / "part-000000.db-wal";
  {
    Recording other(dir / "third");
    other.polls(5);
    other.writer.commit();
    const fs::path part = part_files(dir / "third")[0];
    fs::copy_file(part, dir / "log" / "part-000000.db");
    fs::copy_file(part.string() + "-wal", wal);
    other.end();
  }
  const auto wal_bytes = fs::file_size(wal);
  Recording recording(dir / "log", small_parts({0, 200'000, 0}));
  for (int i = 0; i < 80; ++i) {
    recording.polls(20);
    recording.writer.commit();
  }
  recording.end();
  CHECK(fs::exists(dir / "log" / "part-000000.db"));
  CHECK(fs::exists(dir / "log" / "part-000001.db"));
  REQUIRE(fs::exists(wal));
  CHECK(fs::file_size(wal) == wal_bytes);  // nor finished
  fs::remove(wal);
  fs::remove(dir / "log" / "part-000000.db");  // a reader would ask which of the two logs is meant
  CHECK_FALSE(removals(dir / "log").empty());
}

TEST_CASE("what a kill left beside a part that is gone is removed at the next start") {
  TempDir dir(memory_folder());
  {
    Recording recording(dir.path());
    recording.polls(1);
    recording.end();
  }
  std::ofstream(dir / "part-000000.db-wal") << "left";
  std::ofstream(dir / "part-000000.db-shm") << "left";
  std::ofstream(dir / "part-000001.db-note") << "of somebody else";
  { store::LogWriter writer(dir.path()); }
  CHECK_FALSE(fs::exists(dir / "part-000000.db-wal"));
  CHECK_FALSE(fs::exists(dir / "part-000000.db-shm"));
  CHECK(fs::exists(dir / "part-000001.db-note"));
}

TEST_CASE("the next part is made ready before it is due, and taken") {
  TempDir dir(memory_folder());
  const fs::path ready = dir / ".unfinished-part-000002.db";
  {
    Recording recording(dir.path(), small_parts({}));
    recording.polls(5);
    recording.writer.commit();
    CHECK_FALSE(fs::exists(ready));
    while (!fs::exists(ready)) {
      REQUIRE(part_files(dir.path()).size() == 1);
      recording.polls(5);
      recording.writer.commit();
    }
    while (part_files(dir.path()).size() == 1) {
      recording.polls(5);
      recording.writer.commit();
    }
    CHECK_FALSE(fs::exists(ready));
    recording.end();
  }
  first_of_rest(dir.path(), open_reader(dir.path()).coverage().at(0).planned);
}

TEST_CASE("the next part is ready before midnight, and a recording that ends before takes it away") {
  TempDir dir(memory_folder());
  {
    Recording recording(dir.path(), {}, kT0 + kDay - 30 * kSecond);
    recording.polls(10);
    recording.writer.commit();
    CHECK(fs::exists(dir / ".unfinished-part-000002.db"));
    recording.end();
  }
  CHECK_FALSE(fs::exists(dir / ".unfinished-part-000002.db"));
  CHECK(part_files(dir.path()).size() == 1);
}

TEST_CASE("a part that was made ready and is spoilt or gone costs no poll") {
  for (const bool gone : {false, true}) {
    TempDir dir(memory_folder());
    Recording recording(dir.path(), {}, kT0 + kDay - 30 * kSecond);
    recording.polls(10);
    recording.writer.commit();
    const fs::path ready = dir / ".unfinished-part-000002.db";
    REQUIRE(fs::exists(ready));
    if (gone) {
      fs::remove(ready);
    } else {
      std::ofstream(ready, std::ios::trunc) << "spoilt";
    }
    recording.polls(40);
    recording.writer.commit();
    recording.end();
    CHECK(part_files(dir.path()).size() == 2);
    CHECK(first_of_rest(dir.path(), 50) == 0);
  }
}

TEST_CASE("a next part that cannot be begun costs no poll: the one before goes on until it can be") {
  TempDir dir(memory_folder());
  std::vector<std::string> told;
  store::WriterOptions options;
  options.durable = false;
  options.retention.tell = [&](const std::string& text) { told.push_back(text); };
  Recording recording(dir.path(), options, kT0 + kDay - 10 * kSecond);
  const fs::path obstacle = dir / ".unfinished-part-000002.db";
  fs::remove(obstacle);
  fs::create_directories(obstacle / "in the way");
  for (int i = 0; i < 100; ++i) {
    recording.polls(1);
    recording.writer.commit();
  }
  CHECK(part_files(dir.path()).size() == 1);
  REQUIRE(told.size() == 1);
  CHECK_THAT(told[0], Catch::Contains("the one before goes on") && Catch::Contains(".unfinished-part-000002.db"));
  CHECK(recording.writer.stats().lost == 0);
  fs::remove_all(obstacle);
  for (int i = 0; i < 100; ++i) {
    recording.polls(1);
    recording.writer.commit();
  }
  CHECK(part_files(dir.path()).size() == 2);
  recording.end();
  CHECK(first_of_rest(dir.path(), 200) == 0);
}

TEST_CASE("a reader that keeps the WAL from being emptied is answered with a new part, and no row waits for it") {
  TempDir dir(memory_folder());
  store::WriterOptions options;
  options.durable = false;
  options.wal_bytes = 100'000;
  std::uint64_t polls = 0;
  {
    Recording recording(dir.path(), options);
    recording.polls(20);
    recording.writer.commit();
    store::Connection reader(part_files(dir.path())[0], store::OpenMode::read);
    reader.exec("BEGIN");
    CHECK(reader.integer("SELECT sum(rows) FROM hot") == 20);
    std::uint64_t largest = 0;
    while (part_files(dir.path()).size() == 1) {
      recording.polls(20);
      recording.writer.commit();
      largest = std::max(largest, store::part_file_bytes(part_files(dir.path())[0]));
      REQUIRE(largest < 2'000'000);
    }
    recording.polls(20);
    recording.writer.commit();
    CHECK(reader.integer("SELECT sum(rows) FROM hot") == 20);
    polls = recording.next;
    recording.end();
  }
  CHECK(first_of_rest(dir.path(), polls) == 0);
}

TEST_CASE("a part that cannot be closed goes when it is its turn, and holds up none of those after it") {
  struct Row {
    const char* why;
    std::function<std::unique_ptr<store::Connection>(const fs::path&)> spoil;
  };
  const std::vector<Row> rows{
      {"a reader never ends",
       [](const fs::path& part) {
         auto reader = std::make_unique<store::Connection>(part, store::OpenMode::read);
         reader->exec("BEGIN");
         CHECK(reader->integer("SELECT sum(rows) FROM hot") > 0);
         return reader;
       }},
      {"a table is gone",
       [](const fs::path& part) {
         store::Connection(part, store::OpenMode::write).exec("DROP TABLE block");
         return std::unique_ptr<store::Connection>();
       }},
  };
  for (const Row& row : rows) {
    INFO(row.why);
    TempDir dir(memory_folder());
    constexpr std::uint64_t kSize = 400'000;
    Recording recording(dir.path(), small_parts({0, kSize, 0}));
    recording.polls(20);
    recording.writer.commit();
    const fs::path first = part_files(dir.path()).at(0);
    const std::unique_ptr<store::Connection> held = row.spoil(first);
    std::uint64_t most = 0;
    for (int i = 0; i < 100; ++i) {
      recording.polls(20);
      recording.writer.commit();
      most = std::max(most, bytes_of(dir.path()));
    }
    CHECK(most < kSize + 200'000);  // and what is pinned is not packed
    CHECK_FALSE(fs::exists(first));
    if (held) {
      CHECK(held->integer("SELECT sum(rows) FROM hot") == 20);  // who reads it reads on
    }
    recording.end();
    const std::vector<Event> events = removals(dir.path());
    REQUIRE_FALSE(events.empty());
    CHECK_THAT(events.back().detail, Catch::Contains("2026-01-01T"));
  }
}

TEST_CASE("the forecast of a log is its own growth, by the time it was recorded and not by the clock") {
  TempDir dir(memory_folder());
  store::WriterOptions options;
  options.durable = false;
  options.part_per_day = false;
  options.retention.free_bytes = [](const fs::path&) { return std::optional<std::uint64_t>(1u << 30); };
  Recording recording(dir.path(), options);
  recording.polls(1800);
  recording.writer.commit();
  CHECK_FALSE(recording.writer.forecast().bytes_per_day);
  recording.polls(1800);
  recording.writer.append(answer_of(1, 1, Source::status, recording.next++, kT0 + kYear, "{}"));
  recording.writer.commit();
  const store::Forecast forecast = recording.writer.forecast();
  REQUIRE(forecast.bytes_per_day);
  CHECK(*forecast.bytes_per_day == Approx(static_cast<double>(forecast.used_bytes) * 86'400 / 3601));
  CHECK(*forecast.days_left == Approx((1u << 30) / *forecast.bytes_per_day));
}
