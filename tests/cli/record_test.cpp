// The whole way: simulated robots on sockets, the recorder program, the log, the analyzer program.

#include <chrono>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "samples/simulator/serve.hpp"
#include "schema/log.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/golden.hpp"
#include "tests/support/process.hpp"
#include "tests/support/temp_dir.hpp"

using namespace tacho;
using namespace std::chrono_literals;
using test::Outcome;
using test::Process;
using test::TempDir;

namespace {

const std::string kRecorder = "recorder/tacho-recorder";
const std::string kSimulator = "samples/simulator/tacho-sim";
const std::string kAnalyzer = "analyzer/tacho-analyzer";
const std::string kPeriods = "status=1s,io=2Hz,registers=5Hz,inputs=5Hz";

std::vector<sim::ServedRobot> robots(std::size_t count) {
  std::vector<sim::ServedRobot> out(count);
  for (std::size_t i = 0; i < count; ++i) {
    out[i].scenario = sim::busy_day(i + 1);
    out[i].scenario.name = "robot" + std::to_string(i + 1);
  }
  return out;
}

std::vector<std::string> record_arguments(const sim::Server& server, std::size_t count, const std::string& log,
                                          const std::string& time) {
  std::vector<std::string> arguments{"run", "--log", log, "--for", time, "--period", kPeriods};
  for (std::size_t i = 0; i < count; ++i) {
    arguments.push_back("--robot");
    arguments.push_back("robot" + std::to_string(i + 1) + "=127.0.0.1:" + std::to_string(server.status_port(i)) + ":" +
                        std::to_string(server.modbus_port(i)));
  }
  return arguments;
}

std::unique_ptr<RowSource> open(const std::filesystem::path& log) {
  return open_log(std::vector<std::filesystem::path>{log});
}

/// Every planned poll of every stream is in the log: stored, or inside a gap row. Counted from rows, not from
/// summaries.
void check_every_poll_is_accounted_for(RowSource& log) {
  for (const Stream& stream : log.streams()) {
    INFO("robot " << stream.robot << " " << source_name(stream.source));
    REQUIRE(stream.planned);
    std::vector<int> seen(static_cast<std::size_t>(*stream.planned), 0);
    log.read_raw(stream.robot, stream.source, {}, [&](const Answer& a) {
      if (a.meta.session == stream.session) {
        ++seen.at(a.meta.seq);
      }
    });
    Selection selection;
    selection.rows[static_cast<std::size_t>(stream.source)] = true;
    log.read(stream.robot, {}, selection, [&](const Slice& slice) {
      for (const Gap& gap : slice.gaps) {
        const bool mine = gap.source == stream.source && gap.session == stream.session && !gap.partial;
        for (std::uint64_t k = 0; mine && k < gap.seq_count; ++k) {
          ++seen.at(gap.seq_from + k);
        }
      }
    });
    CHECK(std::count(seen.begin(), seen.end(), 1) == static_cast<std::ptrdiff_t>(seen.size()));
  }
}

/// A real answer when its file is here, else the document's example; and the same with one key nobody knows.
std::string real_answer() {
  const std::filesystem::path file =
      std::filesystem::path(TACHO_SOURCE_DIR) / "../shared/data/real-1100-forklift-rbk3.4.7.json";
  return std::filesystem::exists(file)
             ? test::read_file(file)
             : test::read_file(std::filesystem::path(TACHO_SOURCE_DIR) / "tests/golden/wire/vendor-1100-answer.json");
}

/// Serves `body` as every 11100 answer (and `io_body` as every 11013 answer), records it and returns the log's folder.
void record_body(const TempDir& dir, const std::string& body, const std::string& io_body) {
  std::ofstream(dir / "body.json", std::ios::binary) << body;
  std::ofstream(dir / "io.json", std::ios::binary) << io_body;
  std::vector<sim::ServedRobot> one = robots(1);
  one[0].scenario.body_file = (dir / "body.json").string();
  one[0].scenario.io_body_file = (dir / "io.json").string();
  sim::Server server(one, {});
  const Outcome outcome = test::run(kRecorder, record_arguments(server, 1, (dir / "log").string(), "3s"));
  INFO(outcome.err);
  REQUIRE(outcome.code == 0);
}

}  // namespace

TEST_CASE("a recording that stored nothing fails and says why on its last line") {
  TempDir dir;
  const Outcome outcome = test::run(kRecorder, {"run", "--log", (dir / "log").string(), "--for", "2s", "--robot",
                                                "amr1=127.0.0.1:1:1", "--sources", "status"});
  INFO(outcome.err);
  CHECK(outcome.code == 1);
  CHECK(outcome.err.ends_with("nothing was recorded: nobody listens on the port\n"));
  CHECK(outcome.out.find("connect_refused") != std::string::npos);
}

TEST_CASE("a table that nobody gets is an error, and the log is whole") {
  TempDir dir;
  sim::Server server(robots(1), {});
  std::string command = std::string(TACHO_BINARY_DIR) + "/" + kRecorder;
  for (const std::string& argument : record_arguments(server, 1, (dir / "log").string(), "1s")) {
    command += " " + argument;
  }
  const Outcome outcome = test::run("/bin/sh", {"-c", command + " > /dev/full"});
  CHECK(outcome.code == 1);
  CHECK(outcome.err.find("standard output: No space left on device; the log is complete") != std::string::npos);
  const auto log = open(dir / "log");
  CHECK(log->sessions().at(0).clean);
  check_every_poll_is_accounted_for(*log);
}

TEST_CASE("pose beside the full answer, also of a controller that ignores keys: accounted for, verified and readable") {
  TempDir dir;
  const std::string log = (dir / "log").string();
  std::vector<sim::ServedRobot> two = robots(2);
  two[1].scenario.ignores_keys = true;
  sim::Server server(two, {});
  std::vector<std::string> arguments = record_arguments(server, 2, log, "5s");
  arguments[6] = "status=1s,io=off,pose=5Hz,pose.idle=2s,registers=5Hz,registers.charging=1s,inputs=5Hz";
  const Outcome outcome = test::run(kRecorder, arguments);
  INFO(outcome.err);
  REQUIRE(outcome.code == 0);
  CHECK(outcome.err.find("robot2: pose: asked for 8 keys, the controller answered with ") != std::string::npos);
  CHECK(outcome.err.find("robot1: pose: asked") == std::string::npos);

  const auto source = open(log);
  check_every_poll_is_accounted_for(*source);
  std::map<RobotId, std::uint64_t> poses;
  for (const Coverage& c : source->coverage()) {
    if (c.source == Source::pose) {
      poses[c.robot] = c.planned;
    }
  }
  CHECK(poses[1] > 20);
  CHECK(poses[2] == 1);
  const Outcome sql =
      test::run(kAnalyzer,
                {"sql", log, "--format", "csv",
                 "select count(*) > 10, count(x) = count(*), min(t_recv_us - t_send_us) > 0, count(battery_level) from "
                 "pose where robot = 'robot1'"});
  INFO(sql.out << sql.err);
  CHECK(sql.out.find("\n1,1,1,0") != std::string::npos);
  const Outcome verify = test::run(kAnalyzer, {"verify", log});
  INFO(verify.out);
  CHECK(verify.code == 0);
  CHECK(verify.out.find("PASS     VER-05") != std::string::npos);
  CHECK(verify.out.find("events derived again for 2 sessions of a robot\n") != std::string::npos);
}

TEST_CASE("another robot behind the same address is recorded as another robot, and every poll is accounted for") {
  TempDir dir;
  const std::string log = (dir / "log").string();
  std::vector<sim::ServedRobot> first = robots(2);
  auto server = std::make_unique<sim::Server>(std::vector<sim::ServedRobot>{first[0]}, sim::ServeOptions{});
  Process recorder(kRecorder, record_arguments(*server, 1, log, "9s"));
  std::this_thread::sleep_for(3s);
  sim::ServedRobot other = first[1];
  other.status_port = server->status_port(0);
  other.modbus_port = server->modbus_port(0);
  server.reset();
  server = std::make_unique<sim::Server>(std::vector<sim::ServedRobot>{other}, sim::ServeOptions{});
  const Outcome outcome = recorder.wait();
  INFO(outcome.err);
  REQUIRE(outcome.code == 0);
  CHECK(outcome.err.find("robot1: another robot answers; it is recorded as 'robot1 (2)'") != std::string::npos);

  const auto source = open(log);
  check_every_poll_is_accounted_for(*source);
  REQUIRE(source->robots().size() == 2);
  CHECK(source->robots()[0].vehicle_id == "robot1");
  CHECK(source->robots()[1].vehicle_id == "robot2");
  for (const Robot& robot : source->robots()) {
    std::size_t rows = 0;
    source->read_raw(robot.id, Source::status, {}, [&](const Answer& answer) {
      CHECK(answer.body.find("\"vehicle_id\":\"" + robot.vehicle_id + "\"") != std::string::npos);
      ++rows;
    });
    CHECK(rows > 0);
  }
  CHECK(test::run(kAnalyzer, {"verify", log}).code == 0);
}

TEST_CASE("three robots at every source: each planned poll is stored or missed, also when a robot is switched off") {
  TempDir dir;
  const std::string log = (dir / "log").string();
  sim::Server server(robots(3), {});
  Process recorder(kRecorder, record_arguments(server, 3, log, "14s"));
  std::this_thread::sleep_for(5s);
  server.stop(1);
  std::this_thread::sleep_for(3s);
  server.start(1);
  const Outcome outcome = recorder.wait();
  INFO(outcome.err);
  REQUIRE(outcome.code == 0);

  const auto source = open(log);
  check_every_poll_is_accounted_for(*source);
  REQUIRE(source->coverage().size() == 12);
  const std::map<Source, std::uint64_t> per_second{
      {Source::status, 1}, {Source::io, 2}, {Source::registers, 5}, {Source::inputs, 5}};
  for (const Coverage& c : source->coverage()) {
    INFO("robot " << c.robot << " " << source_name(c.source));
    CHECK(c.planned == c.stored + c.missed);
    CHECK(c.planned >= 13 * per_second.at(c.source));
    CHECK(c.planned <= 15 * per_second.at(c.source));
    CHECK((c.robot == 2 || c.stored * 10 >= c.planned * 8));
    CHECK((c.robot != 2 || c.missed > 0));
  }
  std::set<Cause> causes;
  Micros last_gap_end = 0;
  Micros last_row = 0;
  Selection selection;
  selection.rows.fill(true);
  source->read(2, {}, selection, [&](const Slice& slice) {
    for (const Gap& gap : slice.gaps) {
      causes.insert(gap.cause);
      last_gap_end = std::max(last_gap_end, gap.t_to_us);
    }
    for (const Batch& batch : slice.batches) {
      last_row = std::max(last_row, batch.t_recv_us.back());
    }
  });
  CHECK(causes.count(Cause::connect_refused) + causes.count(Cause::closed) > 0);
  CHECK(last_row > last_gap_end);
}

TEST_CASE("a real answer is recorded byte for byte and every key of it is known") {
  TempDir dir;
  const std::string body = real_answer();
  record_body(dir, body,
              test::read_file(std::filesystem::path(TACHO_SOURCE_DIR) / "tests/golden/wire/vendor-1013-answer.json"));
  const std::string log = (dir / "log").string();
  const Outcome raw = test::run(kAnalyzer, {"export", log, "--raw", "--source", "status", "--robot", "robot1"});
  REQUIRE(raw.code == 0);
  REQUIRE(!raw.out.empty());
  REQUIRE(raw.out.size() % (body.size() + 1) == 0);
  for (std::size_t at = 0; at < raw.out.size(); at += body.size() + 1) {
    CHECK(raw.out.compare(at, body.size() + 1, body + "\n") == 0);
  }
  CHECK(open(log)->unknown_keys().empty());
  const Outcome info = test::run(kAnalyzer, {"info", log});
  CHECK(info.code == 0);
  INFO(info.out);
  CHECK(info.out.find("0 unknown") != std::string::npos);
}

TEST_CASE("one invented key in a real answer is listed, and only that one") {
  TempDir dir;
  std::string body = real_answer();
  body.insert(body.find('{') + 1, "\"flux_capacitor\":1.21,");
  record_body(dir, body, "{}");
  const auto unknown = open(dir / "log")->unknown_keys();
  REQUIRE(unknown.size() == 1);
  CHECK(unknown[0].key == "flux_capacitor");
  const Outcome info = test::run(kAnalyzer, {"info", (dir / "log").string()});
  CHECK(info.out.find("flux_capacitor") != std::string::npos);
}

TEST_CASE("the example of the 1013 document is recorded and decoded") {
  TempDir dir;
  record_body(dir, real_answer(),
              test::read_file(std::filesystem::path(TACHO_SOURCE_DIR) / "tests/golden/wire/vendor-1013-answer.json"));
  const auto log = open(dir / "log");
  Selection selection;
  selection.add(Source::io, field("di"));
  selection.add(Source::io, field("ret_code"));
  std::size_t rows = 0;
  log->read(1, {}, selection, [&](const Slice& slice) {
    const Batch* io = slice.find(Source::io);
    for (std::size_t i = 0; io != nullptr && i < io->rows(); ++i, ++rows) {
      const auto points = io->points_of(i);
      REQUIRE(points.size() == 17);
      CHECK_FALSE(points[4].status);
      CHECK(points[2].valid == 0);
      CHECK(io->texts.at(points[9].source) == "virtual");
      CHECK(points[10].output);
      CHECK(points[10].valid == -1);
      CHECK(io->find(field("ret_code"))->integer[i] == 0);
    }
  });
  CHECK(rows >= 4);
}

TEST_CASE("SIGINT ends a recording cleanly, with nothing unaccounted for") {
  TempDir dir;
  sim::Server server(robots(1), {});
  Process recorder(kRecorder, record_arguments(server, 1, (dir / "log").string(), "1h"));
  std::this_thread::sleep_for(4s);
  recorder.signal(SIGINT);
  const Outcome outcome = recorder.wait();
  CHECK(outcome.code == 0);
  const auto log = open(dir / "log");
  REQUIRE(log->sessions().size() == 1);
  CHECK(log->sessions()[0].clean);
  check_every_poll_is_accounted_for(*log);
}

TEST_CASE("a killed recorder loses at most a commit interval, and the next start closes the hole with gap rows") {
  TempDir dir;
  const std::string log = (dir / "log").string();
  sim::Server server(robots(1), {});
  {
    Process recorder(kRecorder, record_arguments(server, 1, log, "1h"));
    std::this_thread::sleep_for(5s);
    recorder.signal(SIGKILL);
    CHECK(recorder.wait().code == -SIGKILL);
  }
  REQUIRE(test::run(kRecorder, record_arguments(server, 1, log, "2s")).code == 0);
  const auto source = open(log);
  REQUIRE(source->sessions().size() == 2);
  CHECK_FALSE(source->sessions()[0].clean);
  check_every_poll_is_accounted_for(*source);
  std::size_t between = 0;
  Selection selection;
  selection.rows.fill(true);
  source->read(1, {}, selection, [&](const Slice& slice) {
    for (const Gap& gap : slice.gaps) {
      between += gap.cause == Cause::recorder_off ? 1 : 0;
    }
  });
  CHECK(between == 4);
}

TEST_CASE("the simulator lists its faults, and refuses one that it does not know") {
  const Outcome list = test::run(kSimulator, {"serve", "--list-faults"});
  CHECK(list.code == 0);
  for (const sim::LinkFault& fault : sim::link_faults()) {
    INFO(fault.name);
    CHECK(list.out.find(std::string(fault.name) + " ") != std::string::npos);
  }
  const Outcome wrong = test::run(kSimulator, {"serve", "--fault", "modbus:silense@1..2"});
  CHECK(wrong.code == 2);
  CHECK(wrong.out.empty());
  CHECK(wrong.err.find("did you mean 'silence'?") != std::string::npos);
}

TEST_CASE("the simulator writes a log into a folder that is not there yet, and not beside one that is") {
  const TempDir dir;
  const std::string log = (dir / "new" / "log").string();
  CHECK(test::run(kSimulator, {"write", "--log", log, "--days", "0.001"}).code == 0);
  CHECK(open(log)->robots().size() == 1);
  const Outcome again = test::run(kSimulator, {"write", "--log", log, "--days", "0.001"});
  CHECK(again.code == 1);
  CHECK_THAT(again.err, Catch::Contains("holds a log already"));
}

TEST_CASE("a robot whose ports fail for a while is recorded before and after, and every poll is accounted for") {
  const TempDir dir;
  auto served = robots(1);
  served[0].scenario.link_faults = {{"reset", sim::Port::status, 1, 2}, {"silence", sim::Port::modbus, 1, 2}};
  sim::Server server(served, {});
  const Outcome outcome = test::run(kRecorder, record_arguments(server, 1, (dir / "log").string(), "6s"));
  INFO(outcome.err);
  CHECK(outcome.code == 0);
  const auto log = open(dir / "log");
  check_every_poll_is_accounted_for(*log);
  std::set<Source> missed;
  Selection selection;
  selection.rows.fill(true);
  log->read(1, {}, selection, [&](const Slice& slice) {
    for (const Gap& gap : slice.gaps) {
      missed.insert(gap.source);
    }
  });
  CHECK(missed.count(Source::io) == 1);
  CHECK(missed.count(Source::registers) == 1);
}
