// What the analyzer program says to wrong command lines, and what export gives back.

#include "schema/time.hpp"
#include "tests/cli/analyze_fixture.hpp"

using namespace tacho;
using namespace tacho::test;
namespace fs = std::filesystem;

namespace {

/// The command line is refused as wrong usage, with this in the message and nothing on standard output.
void check_usage(const std::vector<std::string>& arguments, const std::string& words) {
  const Outcome outcome = analyze(arguments);
  INFO(arguments[0] << ": " << outcome.err);
  CHECK(outcome.code == 2);
  CHECK(outcome.out.empty());
  CHECK(outcome.err.find(words) != std::string::npos);
}

std::string log_of_three() {
  static const TempDir dir;
  static const std::string log = [] {
    write_short_log(dir / "log", 3);
    return (dir / "log").string();
  }();
  return log;
}

/// Bodies as stored, read through the library.
std::vector<std::string> bodies(const std::string& log, RobotId robot, Source source) {
  std::vector<std::string> out;
  const std::vector<fs::path> paths{log};
  open_log(paths)->read_raw(robot, source, {}, [&](const Answer& a) { out.push_back(a.body); });
  return out;
}

}  // namespace

TEST_CASE("names that do not exist get the nearest one and exit code 2") {
  check_usage({"odometri", log_of_three()}, "did you mean 'odometry'?");
  check_usage({"info", log_of_three(), "--robot", "amb-10"}, "did you mean 'amb-01'?");
  check_usage({"export", log_of_three(), "--fields", "x,battery_levl"}, "did you mean 'battery_level'?");
  check_usage({"export", log_of_three(), "--source", "statsu"}, "did you mean 'status'?");
  check_usage({"fields", "--format", "csv", "--table", "feilds"}, "did you mean 'fields'?");
}

TEST_CASE("wrong options, times, zones and surplus arguments are refused with exit code 2") {
  check_usage({"info"}, "LOG");
  check_usage({"info", log_of_three(), "--format", "xml"}, "--format");
  check_usage({"info", log_of_three(), "--nonsense"}, "--nonsense");
  check_usage({"odometry", log_of_three(), "--from", "yesterday"}, "--from yesterday");
  check_usage({"odometry", log_of_three(), "--from", "2026-02-01", "--to", "2026-01-01"}, "is not before");
  check_usage({"odometry", log_of_three(), "--tz", "Europe/Nowhere"}, "no such time zone");
  check_usage({"incident", log_of_three()}, "--at");
  check_usage({"incident", log_of_three(), "--at", "2026-01-01", "--before", "long"}, "--before long");
  check_usage({"report", log_of_three()}, "--output");
  check_usage({"blockage", log_of_three(), "--format", "png"}, "-o");
  check_usage({"fields", "surplus"}, "surplus");
  CHECK(analyze({"--help"}).code == 0);
  CHECK(analyze({"--version"}).out.find("tacho-analyzer") == 0);
}

TEST_CASE("what is no log is named with the cause and what to do, exit code 1") {
  TempDir dir;
  fs::create_directory(dir / "empty");
  for (const std::string& path : {(dir / "none").string(), (dir / "empty").string()}) {
    const Outcome outcome = analyze({"info", path});
    INFO(outcome.err);
    CHECK(outcome.code == 1);
    CHECK(outcome.out.empty());
    CHECK(outcome.err.rfind("tacho-analyzer: error: " + path, 0) == 0);
    CHECK(lines(outcome.err) == 1);
  }
}

TEST_CASE("only what draws maps offers png, and the others say what they have instead") {
  TempDir dir;
  for (const std::string name : {"odometry", "battery", "alarms"}) {
    check_usage({name, log_of_three(), "--format", "png", "-o", (dir / "png").string()},
                name + " has curves only; use --format csv -o DIR");
    CHECK(analyze({name, "--help"}).out.find("png") == std::string::npos);
  }
  CHECK_FALSE(fs::exists(dir / "png"));
  CHECK(analyze({"blockage", "--help"}).out.find("png") != std::string::npos);
}

TEST_CASE("a configuration with a mistake is wrong usage: exit code 2, with file and line") {
  TempDir dir;
  std::ofstream(dir / "site.toml") << "[odometry]\nv_maximum = 3\n";
  const std::vector<std::string> command{"odometry", log_of_three(), "--config", (dir / "site.toml").string()};
  check_usage(command, "site.toml:2: odometry.v_maximum: no such setting");
  std::ofstream(dir / "site.toml") << "[odometry]\nv_max_mps = \"fast\"\n";
  check_usage(command, "site.toml:2: odometry.v_max_mps: not a number");
  std::ofstream(dir / "site.toml") << "[battery]\nnominal_capacity_ah = -4\n";
  check_usage(command, "site.toml:2: battery.nominal_capacity_ah: -4 Ah: allowed is above 0\n");
  std::ofstream(dir / "site.toml") << "[battery\n";
  check_usage(command, "site.toml:1");
  fs::remove(dir / "site.toml");
  check_usage(command, "site.toml: No such file");
}

TEST_CASE("--fail-on turns findings into exit code 3, and the result is still printed") {
  // One snapshot decides nothing: UNKNOWN is no failure.
  CHECK(analyze({"odometry", log_of_three(), "--fail-on", "warn"}).code == 0);
  TempDir dir;
  write_short_log(dir / "log", 20);
  std::ofstream(dir / "log" / "foreign.db") << "no database";
  CHECK(analyze({"info", (dir / "log").string(), "--fail-on", "fail"}).code == 0);
  const Outcome outcome = analyze({"info", (dir / "log").string(), "--fail-on", "warn"});
  CHECK(outcome.code == 3);
  CHECK(outcome.out.find("DATA-11") != std::string::npos);
}

TEST_CASE("export --raw gives back every stored answer byte for byte, on standard output and as files") {
  TempDir dir;
  for (const Source source : {Source::status, Source::registers}) {
    const std::string name(source_name(source));
    INFO(name);
    std::string expected;
    const std::vector<std::string> stored = bodies(two_robots(), 2, source);
    REQUIRE(stored.size() > 100);
    for (const std::string& body : stored) {
      expected += body + "\n";
    }
    CHECK(analyze({"export", two_robots(), "--raw", "--source", name, "--robot", "amb-02"}).out == expected);
    const std::string folder = (dir / name).string();
    REQUIRE(analyze({"export", two_robots(), "--raw", "--source", name, "--robot", "amb-02", "-o", folder}).code == 0);
    const auto files = contents(folder);
    REQUIRE(files.size() == stored.size());
    std::size_t i = 0;
    for (const auto& [file, bytes] : files) {  // names sort in the order of the answers
      CHECK(bytes == stored[i++]);
    }
  }
  check_usage({"export", two_robots(), "--raw"}, "choose one robot");
}

TEST_CASE("export writes a row per answer with a column per field, and the schema beside a file") {
  const std::size_t stored =
      bodies(two_robots(), 1, Source::status).size() + bodies(two_robots(), 2, Source::status).size();
  const Outcome csv = analyze({"export", two_robots(), "--fields", "x,block_reason,di,create_on"});
  INFO(csv.err);
  REQUIRE(csv.code == 0);
  CHECK(csv.out.rfind("robot,session,seq,t_utc,t_unix_ms,t_send_us,t_recv_us,x,block_reason,di,create_on\r\n", 0) == 0);
  CHECK(lines(csv.out) == stored + 1);
  TempDir dir;
  const std::string file = (dir / "rows.csv").string();
  REQUIRE(analyze({"export", two_robots(), "--robot", "amb-01", "-o", file}).code == 0);
  const std::string schema = read_file(dir / "rows.schema.csv");
  const std::string header = read_file(file).substr(0, read_file(file).find("\r\n"));
  CHECK(lines(schema) == static_cast<std::size_t>(std::count(header.begin(), header.end(), ',')) + 2);
  CHECK(header.find(",battery_level,") != std::string::npos);
}

TEST_CASE("JSON lines keep absent, null and not meaningful apart when asked") {
  const Outcome outcome = analyze({"export", two_robots(), "--robot", "amb-01", "--format", "json", "--states",
                                   "--source", "registers", "--fields", "x,block_reason,battery_level"});
  INFO(outcome.err);
  REQUIRE(outcome.code == 0);
  std::size_t rows = 0;
  std::size_t meaningless = 0;
  std::size_t at = 0;
  while (at < outcome.out.size()) {
    const std::size_t end = outcome.out.find('\n', at);
    const Json row = Json::parse(outcome.out.substr(at, end - at));
    at = end + 1;
    ++rows;
    CHECK(row["x"].is_number());
    if (row["block_reason"].is_null()) {
      CHECK(row["states"]["block_reason"] == "not_meaningful");
      ++meaningless;
    } else {
      CHECK_FALSE(row["states"].contains("block_reason"));
    }
  }
  CHECK(rows == bodies(two_robots(), 1, Source::registers).size());
  CHECK(meaningless > 0);
}

TEST_CASE("--from and --to cut the export at both ends, in the zone asked for") {
  const Outcome outcome = analyze({"export", two_robots(), "--robot", "amb-02", "--fields", "x", "--tz", "+01:00",
                                   "--from", "2026-01-01 01:01:00", "--to", "2026-01-01 01:02:00"});
  REQUIRE(outcome.code == 0);
  CHECK(lines(outcome.out) >= 60);
  CHECK(lines(outcome.out) <= 62);
  CHECK(outcome.out.find("2026-01-01T00:01:30") != std::string::npos);
  CHECK(outcome.out.find("2026-01-01T00:02:30") == std::string::npos);
}

TEST_CASE("a result that cannot be written is an error, not silence") {
  TempDir dir;
  std::ofstream(dir / "file") << "x";
  const std::string below = (dir / "file" / "result").string();  // also root cannot write below a file
  for (const char* name : {"info", "export"}) {
    const Outcome outcome = analyze({name, log_of_three(), "-o", below});
    INFO(name << ": " << outcome.err);
    CHECK(outcome.code == 1);
    CHECK(outcome.err.find(below) != std::string::npos);
  }
}

TEST_CASE("fields lists every field with its unit, source and meaning, and marks the structured ones") {
  const Outcome outcome = analyze({"fields", "--format", "json"});
  REQUIRE(outcome.code == 0);
  const Json rows = table(Json::parse(outcome.out), "fields");
  CHECK(rows.size() == kFieldCount);
  for (const Json& row : rows) {
    CHECK_FALSE(row["meaning"].get<std::string>().empty());
    if (row["name"] == "pgvs") {
      CHECK(row["kind"] == "structured");
    }
  }
  CHECK(analyze({"fields"}).out.find("battery_level") != std::string::npos);
  const Outcome csv = analyze({"fields", "--format", "csv"});
  CHECK(csv.out.rfind("name,unit,kind,json,register", 0) == 0);
}

TEST_CASE("a period or moment outside the log is refused with what the log covers, by every command that takes one") {
  TempDir dir;
  const std::string out = (dir / "out").string();
  for (const std::vector<std::string>& command : {std::vector<std::string>{"battery", log_of_three()},
                                                  {"info", log_of_three()},
                                                  {"alarms", log_of_three()},
                                                  {"blockage", log_of_three()},
                                                  {"odometry", log_of_three()},
                                                  {"export", log_of_three()},
                                                  {"export", log_of_three(), "--raw"},
                                                  {"report", log_of_three(), "-o", out}}) {
    std::vector<std::string> arguments = command;
    arguments.insert(arguments.end(), {"--from", "2020-01-01", "--to", "2020-01-02"});
    check_usage(arguments,
                "--from/--to: no answer between 2020-01-01T00:00:00.000Z and 2020-01-02T00:00:00.000Z; the log covers "
                "2026-01-01T00:00:0");
  }
  CHECK_FALSE(fs::exists(out));
  check_usage({"battery", log_of_three(), "--from", "2030-01-01"}, "--from: no answer from 2030-01-01");
  check_usage({"battery", log_of_three(), "--to", "2020-01-01"}, "--to: no answer before 2020-01-01");
  check_usage({"incident", log_of_three(), "--at", "2020-01-01"}, "the log covers 2026-01-01T00:00:0");
  check_usage({"battery", two_robots(), "--robot", "amb-02", "--from", "2030-01-01"}, "of the chosen robots");
}
