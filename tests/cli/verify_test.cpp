// verify names what is damaged, recover saves the rest; both through the program.

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
