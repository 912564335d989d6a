// A closed part has its head in one row: opening a log reads that, and careful readers compare it with the tables.

#include <fmt/format.h>

#include <fstream>

#include "schema/store/summary.hpp"
#include "tests/schema/store_workload.hpp"

using namespace tacho;
using namespace tacho::test;
namespace fs = std::filesystem;

namespace {

/// Two sessions with misses, events, unknown keys and fields that were seen; one closed part.
fs::path write_part(const fs::path& folder) {
  Ledger ledger;
  store::WriterOptions options = workload_options();
  options.part_bytes = 1 << 20;
  Workload work(folder, ledger, options);
  for (int session = 0; session < 2; ++session) {
    work.begin(kT0 + session * 1000 * kSecond);
    Robot identity;
    identity.vehicle_id = "AMB-150-17";
    work.writer().identify(1, identity);
    for (int i = 0; i < 40; ++i) {
      work.poll();
      Sample sample;
      sample.meta = {1, Source::status, work.session(), work.next() - 1, work.time(), 0};
      sample.cells[field("x")].state = State::present;
      sample.unknown_keys = {"key_" + std::to_string(i / 10)};
      work.writer().note(sample);
    }
    work.end();
  }
  return folder / "part-000001.db";
}

std::string head_text(const fs::path& log, store::Access access) {
  const std::vector<fs::path> paths{log};
  const store::LogReader reader(paths, {decode_x, {}}, access);
  std::string out;
  for (const Robot& r : reader.robots()) {
    out += fmt::format("robot {} {} {} {}\n", r.id, r.name, r.address, r.vehicle_id);
  }
  for (const Session& s : reader.sessions()) {
    out += fmt::format("session {} {} {} {} {}\n", s.id, s.t_start_us, s.t_end_us, s.clean, s.software);
  }
  for (const Stream& s : reader.streams()) {
    out += fmt::format("stream {} {} {} {} {}\n", s.session, s.robot, source_name(s.source), s.period_us,
                       s.planned.value_or(0));
  }
  for (const Coverage& c : reader.coverage()) {
    out += fmt::format("coverage {} {} {} {} {} {} {} {}\n", source_name(c.source), c.planned, c.stored, c.missed,
                       c.bytes, c.last_us, c.seen.to_string(), c.valued.to_string());
    for (const auto& [cause, sum] : c.gaps.causes) {
      out += fmt::format("gaps {} {} {} {}\n", cause_name(cause), sum.polls, sum.gaps, sum.length_us);
    }
    for (const auto& [from, to] : c.gaps.off) {
      out += fmt::format("off {} {}\n", from, to);
    }
  }
  for (const UnknownKey& k : reader.unknown_keys()) {
    out += fmt::format("key {} {} {}\n", source_name(k.source), k.key, k.first_us);
  }
  for (const store::LogReader::PartInfo& p : reader.parts()) {
    out += fmt::format("part {} {} {} {} {}\n", p.number, p.bytes, p.closed, p.first_us, p.last_us);
  }
  for (const ReadProblem& problem : reader.problems()) {
    out += "problem " + problem.what + "\n";
  }
  return out;
}

std::int64_t root_of(const fs::path& part, const std::string& table) {
  store::Connection connection(part, store::OpenMode::read);
  return connection.integer("SELECT rootpage FROM sqlite_schema WHERE name = '" + table + "'");
}

void turn_byte(const fs::path& part, std::int64_t page, std::int64_t offset) {
  std::fstream file(part, std::ios::in | std::ios::out | std::ios::binary);
  const std::streamoff at = (page - 1) * 1024 + offset;
  file.seekg(at);
  const char byte = static_cast<char>(file.get() ^ 0x5A);
  file.seekp(at);
  file.put(byte);
}

}  // namespace

TEST_CASE("the summary of a closed part says what its tables say") {
  TempDir dir;
  const fs::path part = write_part(dir.path());
  const std::string tables = head_text(dir.path(), store::Access::careful);
  CHECK(store::read_summary(part));
  CHECK(head_text(dir.path(), store::Access::fast) == tables);
  CHECK_THAT(tables, Catch::Contains("off ") && Catch::Contains("gaps timeout") && Catch::Contains("key_3"));
  CHECK_THAT(tables, !Catch::Contains("problem"));
}

TEST_CASE("a closed part is opened from its summary alone, and its tables are compared where damage is looked for") {
  TempDir dir;
  const fs::path part = write_part(dir.path());
  const std::string whole = head_text(dir.path(), store::Access::fast);
  for (const char* table : {"robot", "stream", "coverage", "seal"}) {
    turn_byte(part, root_of(part, table), 3);
  }
  CHECK(head_text(dir.path(), store::Access::fast) == whole);
  CHECK_THAT(head_text(dir.path(), store::Access::careful), Catch::Contains("problem"));
}

TEST_CASE("a damaged summary is named by those who look for damage, and costs nobody anything") {
  TempDir dir;
  const fs::path part = write_part(dir.path());
  const std::string whole = head_text(dir.path(), store::Access::fast);
  REQUIRE(root_of(part, "summary") == 2);
  for (const std::int64_t offset : {0, 4, 9, 700, 1000}) {
    INFO("byte " << offset);
    turn_byte(part, 2, offset);
    CHECK_FALSE(store::read_summary(part));
    CHECK(head_text(dir.path(), store::Access::fast) == whole);
    turn_byte(part, 2, offset);
  }
  turn_byte(part, 2, 700);
  CHECK_THAT(head_text(dir.path(), store::Access::careful), Catch::Contains("problem table summary"));
}

TEST_CASE("the summary of another part is named, though it is whole") {
  TempDir dir;
  const fs::path part = write_part(dir / "one");
  Ledger ledger;
  {
    Workload work(dir / "two", ledger);
    work.begin(kT0);
    work.end();
  }
  {
    store::Connection connection(part, store::OpenMode::write);
    connection.exec("ATTACH '" + (dir / "two" / "part-000001.db").string() + "' AS two");
    connection.exec("UPDATE main.summary SET data = (SELECT data FROM two.summary)");
  }
  CHECK_THAT(head_text(dir / "one", store::Access::careful), Catch::Contains("table summary is not as it was"));
}

TEST_CASE("a part that is written, or cut short, has no summary to go by") {
  TempDir dir;
  const fs::path part = write_part(dir.path());
  const fs::path shorter = dir / "short.db";
  fs::copy_file(part, shorter);
  fs::resize_file(shorter, fs::file_size(part) - 1024);
  CHECK_FALSE(store::read_summary(shorter));
  Ledger ledger;
  store::WriterOptions options = workload_options();
  options.part_bytes = 1 << 20;
  Workload work(dir.path(), ledger, options);
  work.begin(kT0 + 5000 * kSecond);
  work.poll();
  work.commit();
  CHECK_FALSE(store::read_summary(part));
  CHECK(head_text(dir.path(), store::Access::fast) == head_text(dir.path(), store::Access::careful));
  work.end();
}

TEST_CASE("a part whose fields are numbered otherwise gets no summary, and reads by its tables") {
  TempDir dir;
  const fs::path part = write_part(dir.path());
  const std::string before = head_text(dir.path(), store::Access::careful);
  {
    store::Connection connection(part, store::OpenMode::write);
    connection.exec("UPDATE field SET id = id + 1000; UPDATE field SET id = 1200 - id; DELETE FROM seal");
    connection.exec("DELETE FROM summary; UPDATE part SET closed = 0");
  }
  { const store::LogWriter writer(dir.path()); }
  CHECK_FALSE(store::read_summary(part));
  CHECK_FALSE(before.empty());
  CHECK(head_text(dir.path(), store::Access::fast) == head_text(dir.path(), store::Access::careful));
}
