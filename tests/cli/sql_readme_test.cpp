// SQL as the README shows it: every query of it runs, and says what the analyses say; the command's formats and
// refusals.

#include <cmath>
#include <map>

#include "schema/store/sqlite.hpp"
#include "tests/cli/analyze_fixture.hpp"

using namespace tacho;
using namespace tacho::test;
namespace fs = std::filesystem;

namespace {

/// The fenced sql blocks of a README, in its order.
std::vector<std::string> readme_queries(const char* readme = "README.md") {
  const std::string text = read_file(fs::path(TACHO_SOURCE_DIR) / readme);
  const std::string open = "```sql\n";
  std::vector<std::string> queries;
  for (std::size_t at = text.find(open); at != std::string::npos; at = text.find(open, at)) {
    at += open.size();
    queries.push_back(text.substr(at, text.find("```", at) - at));
  }
  return queries;
}

/// A day of the README's robot: two hours around its incident, with alarms, blockages and a gap.
const std::string& readme_log() {
  static const TempDir dir;
  static const std::string log = [] {
    sim::WriteOptions options;
    options.t0_us = 1'768'222'800'000'000;  // 2026-01-12T13:00:00Z
    options.duration_us = 7'200'000'000;
    sim::Scenario one = robot("amr1", 1);
    one.blocks_per_km = 4.0;
    one.alarms.push_back({AlarmLevel::warning, 54018, 6.0, 30.0, 5.0, false, "blocked", 10.0});
    Gap gap;
    gap.robot = 2;
    gap.source = Source::status;
    gap.t_from_us = options.t0_us + 300'000'000;
    gap.t_to_us = options.t0_us + 360'000'000;
    gap.cause = Cause::timeout;
    options.gaps = {gap};
    sim::write_log({one, robot("amr2", 2)}, options, dir / "log");
    return (dir / "log").string();
  }();
  return log;
}

Json rows(const std::string& log, const std::string& sql) {
  const Outcome outcome = analyze({"sql", log, sql, "--format", "json"});
  INFO(sql << outcome.err);
  REQUIRE(outcome.code == 0);
  return table(Json::parse(outcome.out), "result");
}

double number(const Json& value) { return value.is_object() ? value["value"].get<double>() : value.get<double>(); }

Json analysis(const std::string& command, const std::string& name) {
  const Outcome outcome = analyze({command, readme_log(), "--format", "json"});
  REQUIRE(outcome.code == 0);
  return table(Json::parse(outcome.out), name);
}

}  // namespace

TEST_CASE("every query of the README runs and finds something") {
  const std::vector<std::string> queries = readme_queries();
  REQUIRE(queries.size() == 6);
  for (const std::string& query : queries) {
    INFO(query);
    CHECK_FALSE(rows(readme_log(), query).empty());
  }
}

TEST_CASE("the queries of the tables' README join by the robot's name") {
  const std::vector<std::string> queries = readme_queries("schema/store/sql/README.md");
  REQUIRE(queries.size() == 2);
  const Json blocked = rows(readme_log(), queries[0]);
  REQUIRE(blocked.size() == 2);
  CHECK(blocked[0]["robot"] == "amr1");
  CHECK(number(blocked[0]["answered"]) == 1.0);
  CHECK(number(blocked[0]["blocked"]) > 0);
  CHECK(number(blocked[1]["answered"]) == Approx(7'140.0 / 7'200.0));
  const Json links = rows(readme_log(), queries[1]);
  REQUIRE_FALSE(links.empty());
  CHECK(links[0]["robot"] == "amr2");
}

TEST_CASE("README: what the rollups say of voltage and current is what the rows say") {
  const Json days = rows(readme_log(), readme_queries()[5]);
  REQUIRE(days.size() == 4);
  for (const Json& day : days) {
    const std::string field = day["field"].get<std::string>();
    const Json all =
        rows(readme_log(), "select min(" + field + ") as lowest, avg(" + field + ") as mean, max(" + field +
                               ") as highest from status where robot = '" + day["robot"].get<std::string>() + "'");
    CHECK(number(day["lowest"]) == number(all[0]["lowest"]));
    CHECK(number(day["highest"]) == number(all[0]["highest"]));
    CHECK(number(day["mean"]) == Approx(number(all[0]["mean"])).margin(6e-4));
  }
}

TEST_CASE("README: the battery per hour is that of the rows") {
  const Json hours = rows(readme_log(), readme_queries()[0]);
  REQUIRE(hours.size() == 4);
  CHECK(hours[0]["hour"] == "2026-01-12 13:00");
  const Json check = rows(readme_log(),
                          "select avg(battery_level) a from status where robot = 'amr1' and time >= "
                          "'2026-01-12 13:00' and time < '2026-01-12 14:00'");
  CHECK(std::abs(number(hours[0]["percent"]) - 100 * number(check[0]["a"])) <= 0.05);
}

TEST_CASE("README: minutes blocked are those of the blockage analysis, within its bounds") {
  std::map<std::string, double> minutes;
  for (const Json& row : rows(readme_log(), readme_queries()[1])) {
    CHECK_FALSE(row["reason"].get<std::string>().empty());
    minutes[row["robot"].get<std::string>()] += number(row["minutes"]);
  }
  const Json robots = analysis("blockage", "by_robot");
  REQUIRE(robots.size() == 2);
  REQUIRE_FALSE(minutes.empty());
  for (const Json& r : robots) {
    INFO(r.dump());
    const Json& blocked = r["blocked"];
    const double seconds = 60 * minutes[r["robot"].get<std::string>()];
    CHECK(seconds >= blocked["lo"].get<double>() - 2);
    CHECK(seconds <= blocked["hi"].get<double>() + 2);
  }
}

TEST_CASE("README: gaps by cause are those of info") {
  const Json gaps = rows(readme_log(), readme_queries()[3]);
  const Json missed = analysis("info", "missed");
  REQUIRE(gaps.size() == 1);
  REQUIRE(missed.size() == 1);
  CHECK(gaps[0]["robot"] == missed[0]["robot"]);
  CHECK(gaps[0]["cause"] == missed[0]["cause"]);
  CHECK(number(gaps[0]["missed_polls"]) == number(missed[0]["polls"]));
}

TEST_CASE("README: alarms per day are the events of the log") {
  double raised = 0;
  for (const Json& row : rows(readme_log(), readme_queries()[2])) {
    CHECK(row["day"] == "2026-01-12");
    raised += number(row["times"]);
  }
  std::size_t events = 0;
  const std::vector<fs::path> paths{readme_log()};
  const auto log = open_log(paths);
  for (const Robot& r : log->robots()) {
    log->read(r.id, {}, {}, [&](const Slice& slice) {
      for (const Event& e : slice.events) {
        events += e.kind == EventKind::alarm_raised && e.source == Source::status ? 1U : 0U;
      }
    });
  }
  CHECK(raised == static_cast<double>(events));
}

TEST_CASE("README: rows around an incident are two minutes of one robot in order") {
  const Json around = rows(readme_log(), readme_queries()[4]);
  CHECK(around.size() >= 119);
  CHECK(around.size() <= 121);
  CHECK(around[0]["time"].get<std::string>().rfind("2026-01-12T14:31:00", 0) == 0);
}

TEST_CASE("sql answers as a table, CSV and JSON, on standard output and in a file") {
  const std::string sql = "select robot, count(*) as n, null as missing, 'a,b' as t from status group by robot";
  const std::string expected = "robot,n,missing,t\r\namr1,7200,,\"a,b\"\r\namr2,7140,,\"a,b\"\r\n";
  CHECK(analyze({"sql", readme_log(), sql, "--format", "csv"}).out == expected);
  TempDir dir;
  const std::string file = (dir / "out.csv").string();
  REQUIRE(analyze({"sql", readme_log(), sql, "--format", "csv", "-o", file}).code == 0);
  CHECK(read_file(file) == expected);
  const Outcome text = analyze({"sql", readme_log(), sql});
  CHECK(text.out.find("2 rows") != std::string::npos);
  CHECK(text.out.find("7140") != std::string::npos);
  CHECK(lines(analyze({"sql", readme_log(), "select seq from status", "--format", "csv"}).out) == 14'341);
}

TEST_CASE("mistakes in SQL are wrong usage: exit code 2, nothing on standard output, no file") {
  TempDir dir;
  const std::string file = (dir / "out.csv").string();
  for (const auto& [sql, words] : std::vector<std::pair<std::string, std::string>>{
           {"select batery_level from status", "did you mean 'battery_level'?"},
           {"select * from statsu", "did you mean 'status'?"},
           {"drop table gap", "a log is only read"},
           {"attach 'x.db' as x", "a log is only read"},
           {"", "there is no statement"}}) {
    const Outcome outcome = analyze({"sql", readme_log(), sql, "--format", "csv", "-o", file});
    INFO(sql << ": " << outcome.err);
    CHECK(outcome.code == 2);
    CHECK(outcome.out.empty());
    CHECK(outcome.err.find(words) != std::string::npos);
    CHECK_FALSE(fs::exists(file));
  }
  CHECK(analyze({"sql", readme_log()}).code == 2);
  CHECK(analyze({"sql", (dir / "none").string(), "select 1"}).code == 1);
}

TEST_CASE("export --format sqlite makes a new file of plain tables, and refuses to write over one") {
  TempDir dir;
  const std::string file = (dir / "out.db").string();
  const Outcome outcome = analyze({"export", readme_log(), "--format", "sqlite", "-o", file, "--robot", "amr1"});
  INFO(outcome.err);
  REQUIRE(outcome.code == 0);
  store::Connection connection(file, store::OpenMode::read);
  CHECK(connection.integer("select count(*) from status") == 7200);
  CHECK(connection.integer("select count(*) from registers") == 0);
  CHECK(connection.scalar("select group_concat(name) from robot") == "amr1");
  const Outcome again = analyze({"export", readme_log(), "--format", "sqlite", "-o", file});
  CHECK(again.code == 1);
  CHECK(again.err.find(file + ": exists already") != std::string::npos);
  CHECK(analyze({"export", readme_log(), "--format", "sqlite"}).code == 2);
}
