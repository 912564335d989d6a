// verify names what is damaged, recover saves the rest; both through the program.

#include <set>

#include "schema/store/manifest.hpp"
#include "schema/store/sqlite.hpp"
#include "tests/cli/analyze_fixture.hpp"

using namespace tacho;
using namespace tacho::test;
namespace fs = std::filesystem;

namespace {

/// Poll -> body, of one source of one robot.
std::map<std::pair<SessionId, std::uint64_t>, std::string> answers_of(const fs::path& log, RobotId robot,
                                                                      Source source) {
  std::map<std::pair<SessionId, std::uint64_t>, std::string> out;
  open_log(std::vector<fs::path>{log})->read_raw(robot, source, {}, [&](const Answer& a) {
    out[{a.meta.session, a.meta.seq}] = a.body;
  });
  return out;
}

struct Records {
  std::vector<std::string> gaps;
  std::vector<std::string> events;
  friend bool operator==(const Records&, const Records&) = default;
};

Records records_of(const fs::path& log, RobotId robot) {
  Records out;
  Selection selection;
  selection.rows.fill(true);
  open_log(std::vector<fs::path>{log})->read(robot, {}, selection, [&](const Slice& slice) {
    for (const Gap& g : slice.gaps) {
      out.gaps.push_back(std::string(source_name(g.source)) + " " + std::to_string(g.seq_from) + "+" +
                         std::to_string(g.seq_count) + " " + std::string(cause_name(g.cause)) + " " + g.detail);
    }
    for (const Event& e : slice.events) {
      out.events.push_back(std::to_string(e.t_us) + " " + std::string(event_kind_name(e.kind)) + " " + e.subject + " " +
                           e.old_value + ">" + e.new_value);
    }
  });
  return out;
}

fs::path copy_of_two_robots(const TempDir& dir) {
  fs::copy(two_robots(), dir / "log");
  return dir / "log";
}

fs::path part_of(const fs::path& log) { return log / "part-000001.db"; }

/// Twenty answers a day for three days: three parts.
void write_three_parts(const fs::path& folder) {
  store::LogWriter writer(folder);
  Ingest ingest(writer, [] { return Micros{0}; });
  Session session;
  session.t_start_us = 1'767'225'600'000'000;
  session.software = "test";
  Stream stream;
  stream.robot = writer.robot("amb-01", "127.0.0.1:19204:502");
  stream.session = writer.begin_session(session);
  stream.period_us = 4320 * 1'000'000LL;
  ingest.declare(stream);
  for (std::uint64_t poll = 0; poll < 60; ++poll) {
    const Micros t_us = session.t_start_us + static_cast<Micros>(poll) * stream.period_us;
    ingest.append({{stream.robot, stream.source, stream.session, poll, t_us, t_us + 4000},
                   "{\"x\":" + std::to_string(poll) + "}",
                   {}});
  }
  writer.end_session(session.t_start_us + 3 * 86'400'000'000, true);
}

/// Overwrites the pages of the part that `chosen` chooses by their first byte (of the first page: the 101st).
template <class Chosen>
int blank_pages(const fs::path& part, Chosen chosen) {
  std::string bytes = read_file(part);
  int blanked = 0;
  const std::size_t page =
      static_cast<std::size_t>(static_cast<unsigned char>(bytes[16])) << 8U | static_cast<unsigned char>(bytes[17]);
  for (std::size_t at = 0; at < bytes.size(); at += page) {
    if (chosen(at / page + 1, static_cast<unsigned char>(bytes[at == 0 ? 100 : at]))) {
      std::fill_n(bytes.begin() + static_cast<std::ptrdiff_t>(at), page, '\0');
      ++blanked;
    }
  }
  std::ofstream(part, std::ios::binary) << bytes;
  return blanked;
}

void check_all_is_there(const fs::path& log, const fs::path& whole) {
  const Outcome again = analyze({"verify", log.string()});
  INFO(again.out << again.err);
  CHECK(again.code == 0);
  for (const Robot& robot : open_log(std::vector<fs::path>{whole})->robots()) {
    for (const Source source : {Source::status, Source::io, Source::registers, Source::inputs}) {
      CHECK(answers_of(log, robot.id, source) == answers_of(whole, robot.id, source));
    }
    CHECK(records_of(log, robot.id) == records_of(whole, robot.id));
  }
}

/// Turns one byte in the middle of a block's data.
void damage_block(const fs::path& log, int id) {
  store::Connection connection(part_of(log), store::OpenMode::write);
  connection.exec(
      "UPDATE block SET data = CAST(substr(data, 1, length(data) / 2) || x'a5' || substr(data, "
      "length(data) / 2 + 2) AS BLOB) WHERE id = " +
      std::to_string(id));
}

}  // namespace

TEST_CASE("a log that is whole verifies, and recovering it gives the same answers, gaps and events") {
  TempDir dir;
  const Outcome verified = analyze({"verify", two_robots()});
  INFO(verified.out << verified.err);
  CHECK(verified.code == 0);
  const Outcome recovered = analyze({"recover", two_robots(), "-o", (dir / "new").string()});
  INFO(recovered.out << recovered.err);
  CHECK(recovered.code == 0);
  CHECK(analyze({"verify", (dir / "new").string()}).code == 0);
  for (const RobotId robot : {1U, 2U}) {
    for (const Source source : {Source::status, Source::io, Source::registers, Source::inputs}) {
      const auto before = answers_of(two_robots(), robot, source);
      CHECK_FALSE(before.empty());
      CHECK(answers_of(dir / "new", robot, source) == before);
    }
    CHECK(records_of(dir / "new", robot) == records_of(two_robots(), robot));
  }
}

TEST_CASE("a damaged block is named, and costs its own answers in the recovered log, which says so in gaps") {
  TempDir dir;
  const fs::path log = copy_of_two_robots(dir);
  damage_block(log, 1);
  const Outcome verified = analyze({"verify", log.string()});
  INFO(verified.out << verified.err);
  CHECK(verified.code == 3);
  CHECK_THAT(verified.out + verified.err, Catch::Contains("block 1"));
  CHECK_THAT(verified.out + verified.err, Catch::Contains("recover"));

  const Outcome recovered = analyze({"recover", log.string(), "-o", (dir / "new").string()});
  INFO(recovered.out << recovered.err);
  CHECK(recovered.code == 3);
  const Outcome again = analyze({"verify", (dir / "new").string()});
  INFO(again.out << again.err);
  CHECK(again.code == 0);
  std::size_t lost = 0;
  for (const RobotId robot : {1U, 2U}) {
    for (const Source source : {Source::status, Source::io, Source::registers, Source::inputs}) {
      const auto whole = answers_of(two_robots(), robot, source);
      const auto saved = answers_of(dir / "new", robot, source);
      lost += whole.size() - saved.size();
      bool exact = true;
      for (const auto& [place, body] : saved) {
        exact = exact && whole.at(place) == body;
      }
      CHECK(exact);
    }
  }
  CHECK(lost > 0);
  const auto log_again = open_log(std::vector<fs::path>{dir / "new"});
  for (const Coverage& coverage : log_again->coverage()) {
    CHECK(coverage.stored + coverage.missed == coverage.planned);
  }
}

TEST_CASE("answers that are there twice are written once by recover, which says how many it left out") {
  const TempDir dir;
  write_three_parts(dir / "log");
  store::Connection(part_of(dir / "log"), store::OpenMode::write)
      .exec(
          "INSERT INTO block SELECT id + 100, robot, source, session, seq_from, seq_to, row_from, row_to, t_from_us, "
          "t_to_us, rows, crc, data FROM block");
  const Outcome done =
      test::run("analyzer/tacho-analyzer", {"recover", (dir / "log").string(), "-o", (dir / "new").string()});
  INFO(done.out << done.err);
  CHECK(done.code == 3);
  CHECK_THAT(done.out, Catch::Contains("60 answers, 0 polls lost, 20 rows left out"));
  CHECK(answers_of(dir / "new", 1, Source::status).size() == 60);
  CHECK(test::run("analyzer/tacho-analyzer", {"verify", (dir / "new").string()}).code == 0);
}

TEST_CASE("an hour whose answers are not those that were recorded is named") {
  const TempDir dir;
  write_three_parts(dir / "log");
  const fs::path part = dir / "log" / "part-000002.db";
  {
    store::Connection connection(part, store::OpenMode::write);
    CHECK(connection.integer("SELECT sum(rows) FROM manifest") == 20);
    connection.exec("BEGIN");
    store::write_manifest(connection, {{{1, Source::status, 1'767'312'000'000'000}, {0, 1}}});
    connection.exec("COMMIT");
  }
  const Outcome said = test::run("analyzer/tacho-analyzer", {"verify", (dir / "log").string()});
  INFO(said.out << said.err);
  CHECK(said.code == 3);
  CHECK_THAT(said.out, Catch::Contains("VER-08") &&
                           Catch::Contains("part-000002.db: robot 1 status from "
                                           "2026-01-02T00:00:00") &&
                           Catch::Contains("1 answers came, 1 are read, but not the same"));
}

TEST_CASE("a part that is cut short is recovered as far as it goes") {
  TempDir dir;
  const fs::path log = copy_of_two_robots(dir);
  fs::resize_file(part_of(log), fs::file_size(part_of(log)) * 3 / 4);
  CHECK(analyze({"verify", log.string()}).code == 3);
  const Outcome recovered = analyze({"recover", log.string(), "-o", (dir / "new").string()});
  INFO(recovered.out << recovered.err);
  CHECK(recovered.code == 3);
  CHECK(analyze({"verify", (dir / "new").string()}).code == 0);
}

TEST_CASE("a part without its header, schema and interior pages is recovered from its other pages, with nothing lost") {
  TempDir dir;
  const fs::path log = copy_of_two_robots(dir);
  CHECK(blank_pages(part_of(log), [](std::size_t page, unsigned char type) {
          return page == 1 || type == 0x05 || type == 0x02;
        }) > 1);
  const Outcome verified = analyze({"verify", log.string()});
  CHECK(verified.code == 1);
  CHECK_THAT(verified.err, Catch::Contains("part-000001.db") && Catch::Contains("recover"));
  const Outcome recovered = analyze({"recover", log.string(), "-o", (dir / "new").string()});
  INFO(recovered.out << recovered.err);
  CHECK(recovered.code == 0);
  CHECK_THAT(recovered.err, Catch::Contains("part-000001.db"));
  check_all_is_there(dir / "new", two_robots());
  const auto names = open_log(std::vector<fs::path>{dir / "new"})->robots();
  CHECK(names.at(0).name == "amb-01");
  CHECK(names.at(1).name == "amb-02");
}

TEST_CASE("where the small tables are gone, recover makes up names for robots and sessions, and says so") {
  TempDir dir;
  const fs::path log = dir / "log";
  write_short_log(log, 60);
  fs::copy(log, dir / "whole");
  {
    store::Connection connection(part_of(log), store::OpenMode::write);
    connection.exec("DELETE FROM robot; DELETE FROM session; DELETE FROM stream; DELETE FROM part; VACUUM");
  }
  const Outcome recovered = analyze({"recover", log.string(), "-o", (dir / "new").string()});
  INFO(recovered.out << recovered.err);
  CHECK(recovered.code == 3);
  CHECK_THAT(recovered.err, Catch::Contains("robot-1") && Catch::Contains("session 1") && Catch::Contains("estimated"));
  check_all_is_there(dir / "new", dir / "whole");
  const auto again = open_log(std::vector<fs::path>{dir / "new"});
  CHECK(again->robots().at(0).name == "robot-1");
  const std::vector<Stream> streams = again->streams();
  const std::vector<Stream> before = open_log(std::vector<fs::path>{dir / "whole"})->streams();
  REQUIRE(streams.size() == before.size());
  for (std::size_t i = 0; i < streams.size(); ++i) {
    CHECK(streams[i].planned == before[i].planned);
    CHECK(std::abs(streams[i].period_us - before[i].period_us) < 10'000);
  }
}

TEST_CASE("a part that lost its header takes its small tables from the other parts of the log") {
  TempDir dir;
  const fs::path log = dir / "log";
  write_three_parts(log);
  const auto before = answers_of(log, 1, Source::status);
  std::set<std::size_t> small{1};
  {
    store::Connection connection(log / "part-000002.db", store::OpenMode::read);
    store::Statement root(connection,
                          "SELECT rootpage FROM sqlite_schema WHERE name IN ('part', 'robot', 'session', "
                          "'stream', 'seal')");
    while (root.step()) {
      small.insert(static_cast<std::size_t>(root.integer(0)));
    }
  }
  CHECK(blank_pages(log / "part-000002.db", [&](std::size_t page, unsigned char) { return small.count(page) > 0; }) ==
        6);
  CHECK(analyze({"verify", log.string()}).code == 3);
  const Outcome recovered = analyze({"recover", log.string(), "-o", (dir / "new").string()});
  INFO(recovered.out << recovered.err);
  CHECK(answers_of(dir / "new", 1, Source::status) == before);
  const auto again = open_log(std::vector<fs::path>{dir / "new"});
  CHECK(again->robots().at(0).name == "amb-01");
  CHECK(again->sessions().at(0).software == "test");
  CHECK(analyze({"verify", (dir / "new").string()}).code == 0);
}

TEST_CASE(
    "a part that is missing between others is named, and its polls become gap rows; missing at the start is none") {
  TempDir dir;
  const fs::path log = dir / "log";
  write_three_parts(log);
  REQUIRE(analyze({"verify", log.string()}).code == 0);
  fs::rename(log / "part-000002.db", dir / "two");
  const Outcome verified = analyze({"verify", log.string()});
  INFO(verified.out << verified.err);
  CHECK(verified.code == 3);
  CHECK_THAT(verified.out, Catch::Contains("part 2") && Catch::Contains("is missing between others"));
  const Outcome info = analyze({"info", log.string(), "--all"});
  INFO(info.out << info.err);
  CHECK_THAT(info.out, Catch::Contains("DATA-13") && Catch::Contains("part 2") &&
                           Catch::Contains("is missing between others") && !Catch::Contains("defect"));
  const Outcome recovered = analyze({"recover", log.string(), "-o", (dir / "new").string()});
  CHECK(recovered.code == 3);
  CHECK_THAT(recovered.out, Catch::Contains("40 answers, 20 polls lost"));
  CHECK_THAT(records_of(dir / "new", 1).gaps.at(0), Catch::Contains("status 20+20 damaged"));
  CHECK(analyze({"verify", (dir / "new").string()}).code == 0);

  fs::rename(dir / "two", log / "part-000002.db");
  fs::remove(log / "part-000001.db");
  const Outcome shorter = analyze({"verify", log.string()});
  INFO(shorter.out << shorter.err);
  CHECK(shorter.code == 0);
  CHECK_THAT(shorter.out, Catch::Contains("the log begins with part 2") && Catch::Contains("moved away"));
  CHECK_THAT(analyze({"info", log.string()}).out, Catch::Contains("the log begins with part 2"));
}

TEST_CASE("a part that retention removed is told of with what the log says about it") {
  TempDir dir;
  const fs::path log = dir / "log";
  write_three_parts(log);
  fs::remove(log / "part-000001.db");
  {
    store::LogWriter writer(log);
    Session session;
    session.t_start_us = 1'767'225'600'000'000 + 4 * 86'400'000'000;
    Event removed;
    removed.session = writer.begin_session(session);
    removed.kind = EventKind::part_removed;
    removed.t_from_us = removed.t_us = session.t_start_us;
    removed.subject = "part 1";
    removed.detail = "older than 3 days";
    writer.add(removed);
    writer.end_session(session.t_start_us + 1'000'000, true);
  }
  for (const char* command : {"info", "verify"}) {
    const Outcome told = analyze({command, log.string()});
    INFO(told.out << told.err);
    CHECK(told.code == 0);
    CHECK_THAT(told.out,
               Catch::Contains("retention removed part 1 at 2026-01-05") && Catch::Contains("older than 3 days"));
  }
}

TEST_CASE("a log that ends in the middle of a session says that a later part may be missing") {
  TempDir dir;
  const fs::path log = dir / "log";
  write_three_parts(log);
  CHECK_THAT(analyze({"info", log.string()}).out, !Catch::Contains("a later part is missing"));
  fs::remove(log / "part-000003.db");
  for (const char* command : {"info", "verify"}) {
    const Outcome told = analyze({command, log.string()});
    INFO(told.out << told.err);
    CHECK_THAT(told.out, Catch::Contains("session 1 has not ended in it: a later part is missing"));
  }
}

TEST_CASE("recover keeps the numbers of parts, and says of none that it was skipped") {
  TempDir dir;
  const fs::path log = dir / "log";
  write_three_parts(log);
  const auto before = answers_of(log, 1, Source::status);
  fs::copy(log, dir / "whole");
  {
    std::fstream part(log / "part-000002.db", std::ios::in | std::ios::out | std::ios::binary);
    part << std::string(1024, '\0');
  }
  const Outcome recovered = analyze({"recover", log.string(), "-o", (dir / "new").string()});
  INFO(recovered.out << recovered.err);
  CHECK(recovered.code == 0);
  CHECK_THAT(recovered.err, Catch::Contains("part-000002.db") && Catch::Contains("looked for in its pages") &&
                                !Catch::Contains("skipped"));
  CHECK(answers_of(dir / "new", 1, Source::status) == before);
  for (const char* part : {"part-000001.db", "part-000002.db", "part-000003.db"}) {
    CHECK(answers_of(dir / "new" / part, 1, Source::status) == answers_of(dir / "whole" / part, 1, Source::status));
  }
  fs::remove(log / "part-000001.db");
  CHECK(analyze({"recover", log.string(), "-o", (dir / "later").string()}).code == 0);
  CHECK(!fs::exists(dir / "later" / "part-000001.db"));
  CHECK(fs::exists(dir / "later" / "part-000002.db"));
}

TEST_CASE("a single part whose header is broken cannot be verified, and the message leads to recover") {
  TempDir dir;
  const fs::path log = copy_of_two_robots(dir);
  {
    std::fstream part(part_of(log), std::ios::in | std::ios::out | std::ios::binary);
    part << "no header";
  }
  for (const fs::path& given : {log, part_of(log)}) {
    const Outcome verified = analyze({"verify", given.string()});
    INFO(verified.err);
    CHECK(verified.code == 1);
    CHECK_THAT(verified.err, Catch::Contains("part-000001.db") && Catch::Contains("is not an SQLite database") &&
                                 Catch::Contains("tacho-analyzer recover") && !Catch::Contains("move it out"));
  }
}

TEST_CASE("files that do not belong to the log are mentioned and are no damage") {
  TempDir dir;
  const fs::path log = dir / "log";
  write_short_log(log, 60);
  std::ofstream(log / "notes.db") << "no part of anything";
  fs::copy_file(part_of(log), log / "part-000001 (copy).db");
  const Outcome verified = analyze({"verify", log.string()});
  INFO(verified.out << verified.err);
  CHECK(verified.code == 0);
  CHECK_THAT(verified.out, Catch::Contains("notes.db") && Catch::Contains("is a copy of"));
  CHECK(analyze({"recover", log.string(), "-o", (dir / "new").string()}).code == 0);
}

TEST_CASE("events that could be compared in no session are unknown, which is no failure") {
  TempDir dir;
  sim::WriteOptions options;
  options.duration_us = 60'000'000;
  options.inputs_period_us = 1'000'000;
  Gap gap;  // of the inputs: at a moment that is not on record the flags of the registers were forgotten
  gap.robot = 1;
  gap.source = Source::inputs;
  gap.t_from_us = options.t0_us + 20'000'000;
  gap.t_to_us = options.t0_us + 30'000'000;
  gap.cause = Cause::timeout;
  options.gaps = {gap};
  sim::write_log({robot("amb-01", 1)}, options, dir / "log");
  const Outcome verified = analyze({"verify", (dir / "log").string(), "--format", "json"});
  INFO(verified.out << verified.err);
  CHECK(verified.code == 0);
  bool met = false;
  const Json document = Json::parse(verified.out);
  for (const Json& finding : document["sections"][0]["findings"]) {
    if (finding["id"] == "VER-05") {
      met = true;
      CHECK(finding["verdict"] == "UNKNOWN");
      CHECK_THAT(finding.dump(), Catch::Contains("in no session"));
    }
  }
  CHECK(met);
  CHECK_THAT(verified.out, Catch::Contains("not for 1: inputs, by which registers are read, have a gap"));
}

TEST_CASE("recover never writes over anything, and never into the log it reads") {
  TempDir dir;
  const fs::path log = copy_of_two_robots(dir);
  const std::string before = read_file(part_of(log));
  const Outcome outcome = analyze({"recover", log.string(), "-o", log.string()});
  CHECK(outcome.code == 1);
  CHECK_THAT(outcome.err, Catch::Contains("empty"));
  CHECK(read_file(part_of(log)) == before);
}

TEST_CASE("what is no log at all cannot be verified") {
  TempDir dir;
  std::ofstream(dir / "part-000001.db") << "no database";
  CHECK(analyze({"verify", dir.path().string()}).code == 1);
}
