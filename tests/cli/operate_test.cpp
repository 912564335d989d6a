// The recorder as a service: readiness, watchdog, reload, metrics, and a look at it from another terminal.

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <map>
#include <thread>

#include "samples/simulator/serve.hpp"
#include "schema/log.hpp"
#include "schema/survey.hpp"
#include "tests/recorder/notify_socket.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/process.hpp"
#include "tests/support/temp_dir.hpp"

using namespace tacho;
using namespace std::chrono_literals;
using recorder::test::NotifySocket;
using test::Outcome;
using test::Process;
using test::TempDir;

namespace {

const std::string kRecorder = "recorder/tacho-recorder";

bool has(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

std::vector<sim::ServedRobot> robots(std::size_t count) {
  std::vector<sim::ServedRobot> out(count);
  for (std::size_t i = 0; i < count; ++i) {
    out[i].scenario = sim::busy_day(i + 1);
    out[i].scenario.name = "robot" + std::to_string(i + 1);
  }
  return out;
}

sim::ServeOptions serving() {
  sim::ServeOptions options;
  options.push_period_us = 500'000;
  return options;
}

/// Two simulated robots, a configuration file that names some of them, and a service manager.
struct Site {
  TempDir dir;
  NotifySocket notify;
  sim::Server server{robots(2), serving()};
  const std::string log = (dir / "log").string();
  const std::string config = (dir / "site.toml").string();
  std::vector<std::string> heard;

  Site() {
    setenv("NOTIFY_SOCKET", notify.address().c_str(), 1);
    setenv("WATCHDOG_USEC", "900000", 1);
  }
  ~Site() {
    unsetenv("NOTIFY_SOCKET");
    unsetenv("WATCHDOG_USEC");
  }
  void write_config(std::size_t count, const std::string& more = "") const {
    std::ofstream out(config);
    out << "log = '" << log << "'\n" << more << "[sources]\nstatus = '500ms'\nregisters = 'off'\n";
    for (std::size_t i = 0; i < count; ++i) {
      out << "[[robot]]\nname = 'robot" << i + 1 << "'\nhost = '127.0.0.1'\nstatus_port = " << server.status_port(i)
          << "\nmodbus_port = " << server.modbus_port(i) << "\n";
    }
  }
  [[nodiscard]] std::size_t times_heard(const std::string& words) {
    for (std::string& one : notify.take()) {
      heard.push_back(std::move(one));
    }
    return static_cast<std::size_t>(
        std::count_if(heard.begin(), heard.end(), [&](const std::string& one) { return has(one, words); }));
  }
  void wait_heard(const std::string& words, std::size_t times = 1) {
    while (times_heard(words) < times) {
      std::this_thread::sleep_for(10ms);
    }
  }
};

}  // namespace

TEST_CASE("a service is ready once it records, stays fed, says how it is, and says when it stops") {
  Site site;
  site.write_config(1);
  Process recorder(kRecorder, {"run", "--config", site.config});
  site.wait_heard("READY=1");
  CHECK(test::run(kRecorder, {"status", site.log}).code == 0);
  site.wait_heard("WATCHDOG=1", 3);
  site.wait_heard("STATUS=robots 1/1");
  recorder.signal(SIGTERM);
  const Outcome outcome = recorder.wait();
  INFO(outcome.err);
  CHECK(outcome.code == 0);
  CHECK(site.times_heard("STOPPING=1") == 1);
  const Outcome status = test::run(kRecorder, {"status", site.log, "--format", "json"});
  CHECK(status.code == 3);
  CHECK(has(status.out, "\"recorded\":false"));
}

TEST_CASE("SIGHUP loads the configuration again, keeps unchanged robots going, and never ends the recording") {
  Site site;
  site.write_config(1);
  Process recorder(kRecorder, {"run", "--config", site.config});
  site.wait_heard("READY=1");
  site.write_config(2);
  recorder.signal(SIGHUP);
  site.wait_heard("READY=1", 2);
  site.write_config(2, "comit = '1s'\n");
  recorder.signal(SIGHUP);
  site.wait_heard("READY=1", 3);
  CHECK(site.times_heard("RELOADING=1") == 2);
  site.wait_heard("STATUS=robots 2/2");
  std::this_thread::sleep_for(1500ms);
  recorder.signal(SIGINT);
  const Outcome outcome = recorder.wait();
  INFO(outcome.err);
  CHECK(outcome.code == 0);
  CHECK(has(outcome.err, "reload: 1 robot kept, added: robot2\n"));
  CHECK(has(outcome.err, "site.toml:2:1: unknown key 'comit'; did you mean 'commit'?"));
  CHECK(has(outcome.err, "nothing changed\n"));
  const std::vector<std::filesystem::path> logs{site.log};
  const auto log = open_log(logs);
  REQUIRE(log->sessions().size() == 1);
  CHECK(log->sessions()[0].clean);
  for (const Coverage& c : log->coverage()) {
    INFO("robot " << c.robot << " " << source_name(c.source));
    CHECK(c.stored > 0);
    CHECK(c.stored + c.missed == c.planned);
  }
  store::LogReader reader(logs, {answer_decode(), {}});
  for (const auto& [key, stream] : survey(reader).streams) {
    CHECK(stream.holes.empty());
    CHECK(stream.doubled == 0);
    CHECK(stream.beyond == 0);
  }
}

TEST_CASE("without a configuration file SIGHUP changes nothing and says so") {
  Site site;
  Process recorder(
      kRecorder, {"run", "--log", site.log, "--robot", "robot1=127.0.0.1:" + std::to_string(site.server.status_port(0)),
                  "--sources", "status"});
  site.wait_heard("READY=1");
  recorder.signal(SIGHUP);
  site.wait_heard("STATUS=robots 1/1");
  recorder.signal(SIGTERM);
  const Outcome outcome = recorder.wait();
  CHECK(outcome.code == 0);
  CHECK(has(outcome.err, "there is no --config file to read again; nothing changed"));
}

TEST_CASE("a mark from another terminal, or by SIGUSR1, is an event of the robots it is for") {
  Site site;
  site.write_config(2);
  CHECK(test::run(kRecorder, {"mark", site.log, "nobody hears this"}).code == 1);
  Process recorder(kRecorder, {"run", "--config", site.config, "--for", "60s"});
  site.wait_heard("READY=1");
  CHECK(test::run(kRecorder, {"mark", site.log, "pallet slipped"}).code == 0);
  const Outcome one = test::run(kRecorder, {"mark", site.log, "door 3", "--robot", "robot2"});
  INFO(one.err);
  CHECK(one.code == 0);
  const Outcome wrong = test::run(kRecorder, {"mark", site.log, "x", "--robot", "robto2"});
  CHECK(wrong.code == 2);
  CHECK(has(wrong.err, "did you mean 'robot2'"));
  recorder.signal(SIGUSR1);
  std::this_thread::sleep_for(300ms);
  recorder.signal(SIGTERM);
  const Outcome outcome = recorder.wait();
  INFO(outcome.err);
  CHECK(outcome.code == 0);
  CHECK(has(outcome.err, "mark: pallet slipped"));

  const Outcome late = test::run(kRecorder, {"mark", site.log, "too late"});
  CHECK(late.code == 1);
  CHECK(has(late.err, "nobody records into this log"));
  const auto log = open_log(std::vector<std::filesystem::path>{site.log});
  std::map<RobotId, std::vector<std::string>> marks;
  for (const Robot& robot : log->robots()) {
    Selection records;
    log->read(robot.id, {}, records, [&](const Slice& slice) {
      for (const Event& event : slice.events) {
        if (event.kind == EventKind::mark) {
          marks[event.robot].push_back(event.detail);
        }
      }
    });
  }
  CHECK(marks[1] == std::vector<std::string>{"pallet slipped", "signal SIGUSR1"});
  CHECK(marks[2] == std::vector<std::string>{"pallet slipped", "door 3", "signal SIGUSR1"});
}

TEST_CASE("metrics that cannot be offered cost no recording") {
  Site site;
  site.write_config(1);
  Process recorder(kRecorder, {"run", "--config", site.config, "--metrics",
                               std::to_string(site.server.status_port(0))});  // taken by the robot
  site.wait_heard("STATUS=robots 1/1");
  recorder.signal(SIGTERM);
  const Outcome outcome = recorder.wait();
  CHECK(outcome.code == 0);
  CHECK(has(outcome.err, "cannot listen there"));
  CHECK(has(outcome.err, "recording goes on without metrics"));
}

TEST_CASE("tail follows a recording from another process and ends when told") {
  Site site;
  site.write_config(1);
  Process recorder(kRecorder, {"run", "--config", site.config});
  site.wait_heard("STATUS=robots 1/1");
  const Outcome tail = test::run(kRecorder, {"tail", site.log, "--for", "3s", "--last", "1min", "--fields", "x,y"});
  INFO(tail.err);
  CHECK(tail.code == 0);
  CHECK(has(tail.out, "robot1 status #0 "));
  CHECK(has(tail.out, " x="));
  CHECK(has(tail.out, "EVENT link_up"));
  Process endless(kRecorder, {"tail", site.log});
  std::this_thread::sleep_for(500ms);
  endless.signal(SIGINT);
  CHECK(endless.wait().code != 1);
  recorder.signal(SIGTERM);
  CHECK(recorder.wait().code == 0);
}

TEST_CASE("wrong usage of status and tail is answered with exit code 2, a missing log with 1") {
  TempDir dir;
  CHECK(test::run(kRecorder, {"status"}).code == 2);
  CHECK(test::run(kRecorder, {"status", "x", "--format", "xml"}).code == 2);
  CHECK(test::run(kRecorder, {"tail", "x", "--fields", "battery_levl"}).code == 2);
  CHECK(test::run(kRecorder, {"tail", "x", "--source", "statsu"}).code == 2);
  const Outcome missing = test::run(kRecorder, {"status", (dir / "none").string()});
  CHECK(missing.code == 1);
  CHECK(has(missing.err, "does not exist"));
}

TEST_CASE("a mark writes what the ring holds and what follows, pushes are recorded, and verify finds all of it whole") {
  Site site;
  const std::string push = std::to_string(site.server.push_port(0));
  Process recorder(kRecorder, {"run", "--log", site.log, "--robot",
                               "robot1=127.0.0.1:" + std::to_string(site.server.status_port(0)) + ":" +
                                   std::to_string(site.server.modbus_port(0)) + ":" + push,
                               "--period", "ring=5Hz,push=500ms,registers=off,inputs=off", "--for", "60s"});
  site.wait_heard("READY=1");
  std::this_thread::sleep_for(2500ms);
  CHECK(test::run(kRecorder, {"mark", site.log, "pallet slipped"}).code == 0);
  std::this_thread::sleep_for(1500ms);
  recorder.signal(SIGTERM);
  const Outcome outcome = recorder.wait();
  INFO(outcome.err << outcome.out);
  CHECK(outcome.code == 0);
  CHECK(has(outcome.err, "robot1: mark: "));

  const auto log = open_log(std::vector<std::filesystem::path>{site.log});
  std::map<Source, Coverage> coverage;
  for (const Coverage& c : log->coverage()) {
    INFO(source_name(c.source));
    CHECK(c.stored + c.missed == c.planned);
    CHECK(c.stored > 0);
    coverage[c.source] = c;
  }
  REQUIRE(coverage.size() == 3);
  CHECK(coverage[Source::ring].stored >= 12);  // before and after the mark
  CHECK(coverage[Source::push].stored >= 5);
  CHECK(coverage[Source::push].missed <= 2);
  Selection records;
  std::size_t windows = 0;
  log->read(1, {}, records, [&](const Slice& slice) {
    for (const Event& event : slice.events) {
      windows += event.kind == EventKind::ring_kept ? 1 : 0;
      CHECK((event.kind != EventKind::ring_kept || event.subject == "mark"));
    }
  });
  CHECK(windows == 1);
  const Outcome verify = test::run("analyzer/tacho-analyzer", {"verify", site.log});
  INFO(verify.out);
  CHECK(verify.code == 0);
  const Outcome sql = test::run("analyzer/tacho-analyzer",
                                {"sql", site.log, "--format", "csv",
                                 "select (select count(x) = count(*) from ring), (select count(jack_height) = count(*) "
                                 "and min(firmware_version) is not null from push)"});
  INFO(sql.out << sql.err);
  CHECK(has(sql.out, "\n1,1"));
}
