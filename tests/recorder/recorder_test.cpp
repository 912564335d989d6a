// A whole recording into a temporary log, read back from its rows.

#include "recorder/recorder.hpp"

#include <sys/resource.h>

#include <csignal>
#include <set>

#include "recorder/console.hpp"
#include "recorder/queue.hpp"
#include "tests/recorder/recording.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/temp_dir.hpp"

using namespace tacho;
using namespace tacho::recorder;
using namespace tacho::recorder::test;
using namespace std::chrono_literals;
using tacho::test::TempDir;

TEST_CASE("a living robot beside a dead one: everything planned is stored or missed, told from the log alone") {
  TempDir dir;
  TinyServer status([](Peer& peer, int) { serve_status(peer); });
  ModbusServer modbus([](const Asked&) { return 0; });
  const std::uint16_t nobody = closed_port();
  const Config config = config_for(dir / "log", {{status.port(), modbus.port()}, {nobody, nobody}});
  std::mutex mutex;
  std::vector<std::string> notices;
  Recorder::Options options;
  options.run_for_us = 1'500'000;
  options.notice = [&](const std::string& text) {
    const std::lock_guard lock(mutex);
    notices.push_back(text);
  };
  Recorder recorder(config, std::move(options));
  wait_done(recorder);
  const auto summary = recorder.finish();
  REQUIRE(summary.size() == 8);
  check_log(dir / "log", summary);
  for (const SourceSummary& row : summary) {
    INFO(row.robot << " " << source_name(row.source));
    const auto period = config.defaults.period(row.source);
    CHECK(row.planned == static_cast<std::uint64_t>(1'500'000 / period));
    CHECK((row.robot == "r1" ? row.stored > 0 : row.stored == 0));
    if (row.robot == "r2") {
      const std::uint64_t overrun = row.missed[static_cast<std::size_t>(Cause::overrun)];  // a busy computer's
      CHECK(row.missed[static_cast<std::size_t>(Cause::connect_refused)] + overrun == row.planned);
    }
  }
  const auto log = open(dir / "log");
  REQUIRE(log->sessions().size() == 1);
  CHECK(log->sessions()[0].clean);
  CHECK(log->sessions()[0].software.find("tacho-recorder") == 0);
  CHECK(to_toml(parse_config(log->sessions()[0].config, "log")) == to_toml(config));
  const auto events = events_of(dir / "log", 1);
  CHECK(std::count_if(events.begin(), events.end(), [](const Event& e) { return e.kind == EventKind::link_up; }) == 2);
  CHECK(std::any_of(notices.begin(), notices.end(),
                    [](const std::string& t) { return t.find("r2: modbus: lost: ") == 0; }));
}

TEST_CASE("stopping at any moment ends the session cleanly and at once, whatever the timeout") {
  TempDir dir;
  TinyServer status([](Peer& peer, int) { peer.wait_closed(); });  // never answers
  ModbusServer modbus([](const Asked&) { return -1; });
  Config config = config_for(dir / "log", {{status.port(), modbus.port()}});
  config.robots[0].settings.status.timeout_us = config.robots[0].settings.modbus.timeout_us = 60'000'000;
  Recorder recorder(config, {});
  while (status.connections() == 0 || modbus.connections() == 0) {
    std::this_thread::sleep_for(1ms);
  }
  recorder.stop();
  recorder.stop();
  wait_done(recorder);  // would last a minute if the polls were not interrupted
  const auto summary = recorder.finish();
  check_log(dir / "log", summary);
  for (const SourceSummary& row : summary) {
    CHECK(row.stored == 0);
    const std::uint64_t late = row.missed[static_cast<std::size_t>(Cause::overrun)];  // of threads that began late
    CHECK(row.missed[static_cast<std::size_t>(Cause::shutdown)] + late == row.planned);
    CHECK((late == 0 || late < row.planned));
  }
  CHECK(open(dir / "log")->sessions()[0].clean);
}

TEST_CASE("a recorder destroyed without finish leaves a readable log and an unclean session") {
  TempDir dir;
  TinyServer status([](Peer& peer, int) { serve_status(peer); });
  Config config = config_for(dir / "log", {{status.port(), 1}});
  config.robots[0].settings.period_us = {20'000, 0, 0, 0};
  {
    Recorder recorder(config, {});
    while (recorder.progress().rows == 0) {
      std::this_thread::sleep_for(5ms);
    }
  }
  const auto log = open(dir / "log");
  REQUIRE(log->sessions().size() == 1);
  CHECK_FALSE(log->sessions()[0].clean);
  CHECK(log->coverage()[0].stored > 0);
}

TEST_CASE("a stalled writer costs polls, which are counted as queue_full and nothing else") {
  TempDir dir;
  TinyServer status([](Peer& peer, int) { serve_status(peer); });
  Config config = config_for(dir / "log", {{status.port(), 1}});
  config.robots[0].settings.period_us = {10'000, 0, 0, 0};
  std::atomic<bool> stall{true};
  Recorder::Options options;
  options.queue_items = 4;
  options.notice = [&](const std::string&) {  // called by the writer: the first event, the link's, holds it up
    while (stall) {
      std::this_thread::sleep_for(1ms);
    }
  };
  Recorder recorder(config, std::move(options));
  while (recorder.snapshot().streams[0].missed[static_cast<std::size_t>(Cause::queue_full)] == 0) {
    std::this_thread::sleep_for(1ms);
  }
  stall = false;
  const auto summary = recorder.finish();
  check_log(dir / "log", summary);
  CHECK(summary[0].missed[static_cast<std::size_t>(Cause::queue_full)] > 0);
}

TEST_CASE("a disk that is full for a while costs polls, which the log tells of, and never the recording") {
  TempDir dir;
  TinyServer status([](Peer& peer, int) { serve_status(peer); });
  Config config = config_for(dir / "log", {{status.port(), closed_port()}});
  config.defaults.period_us = config.robots[0].settings.period_us = {5'000, 0, 0, 0};
  config.commit_us = 20'000;
  std::mutex mutex;
  std::vector<std::string> told;
  Recorder::Options options;
  options.notice = [&](const std::string& text) {
    const std::lock_guard lock(mutex);
    told.push_back(text);
  };
  const auto times_told = [&](std::string_view words) {
    const std::lock_guard lock(mutex);
    return std::count_if(told.begin(), told.end(), [&](const std::string& t) { return t.find(words) != t.npos; });
  };
  const auto wait_until_told = [&](std::string_view words) {
    for (int i = 0; i < 2000 && times_told(words) == 0; ++i) {
      std::this_thread::sleep_for(5ms);
    }
  };
  std::signal(SIGXFSZ, SIG_IGN);
  rlimit unlimited{};
  getrlimit(RLIMIT_FSIZE, &unlimited);
  std::vector<SourceSummary> summary;
  {
    Recorder recorder(config, std::move(options));
    while (recorder.progress().rows < 10) {
      std::this_thread::sleep_for(5ms);
    }
    rlimit full = unlimited;
    full.rlim_cur = 120'000;
    setrlimit(RLIMIT_FSIZE, &full);
    wait_until_told("recording goes on");
    std::this_thread::sleep_for(200ms);
    CHECK_FALSE(recorder.done());
    setrlimit(RLIMIT_FSIZE, &unlimited);
    wait_until_told("written again");
    summary = recorder.finish();
  }
  std::signal(SIGXFSZ, SIG_DFL);
  CHECK(times_told("recording goes on") == 1);
  CHECK(times_told("written again") == 1);
  REQUIRE(summary.size() == 1);
  CHECK(summary[0].missed[static_cast<std::size_t>(Cause::disk)] > 0);
  check_log(dir / "log", summary);
}

TEST_CASE("a status answer without DI and DO is pointed out once when io is off") {
  TempDir dir;
  TinyServer status([](Peer& peer, int) { serve_status(peer); });
  Config config = config_for(dir / "log", {{status.port(), 1}});
  config.robots[0].settings.period_us = {10'000, 0, 0, 0};
  std::mutex mutex;
  std::vector<std::string> notices;
  Recorder::Options options;
  options.notice = [&](const std::string& text) {
    const std::lock_guard lock(mutex);
    notices.push_back(text);
  };
  options.run_for_us = 500'000;
  Recorder recorder(config, std::move(options));
  wait_done(recorder);
  recorder.finish();
  CHECK(std::count_if(notices.begin(), notices.end(),
                      [](const std::string& t) { return t.find("no DI and DO") != std::string::npos; }) == 1);
}

TEST_CASE("a second recorder on the same log is refused, also after the first has begun") {
  TempDir dir;
  const Config config = config_for(dir / "log", {{closed_port(), closed_port()}});
  Recorder first(config, {});
  CHECK_THROWS_AS(Recorder(config, {}), Error);
  first.finish();
}

TEST_CASE("the queue refuses answers beyond its bounds and never a row that tells of a loss") {
  Queue<int> queue(2, 100);
  CHECK(queue.try_push(1, 60));
  CHECK_FALSE(queue.try_push(2, 60));  // too many bytes
  CHECK(queue.try_push(3, 10));
  CHECK_FALSE(queue.try_push(4, 1));  // too many items
  queue.push(5);
  CHECK(queue.dropped() == 2);
  std::vector<int> out;
  CHECK(queue.pop_all(out, std::chrono::steady_clock::now()));
  CHECK(out == std::vector<int>{1, 3, 5});
  CHECK(queue.try_push(6, 1000));  // a single answer may be larger than the bound
  queue.close();
  CHECK(queue.pop_all(out, std::chrono::steady_clock::now()));
  CHECK_FALSE(queue.pop_all(out, std::chrono::steady_clock::now()));
}

TEST_CASE("the status line and the summary show what happened") {
  Progress p;
  p.robots = 3;
  p.robots_ok = 2;
  p.rows = 1234;
  p.missed = 5;
  p.last_commit = 420us;
  p.stored_bytes = 12'300'000;
  CHECK(Console::status_text(p) == "robots 2/3  rows 1234  missed 5  queue 0  commit 0.4 ms  12.3 MB");
  SourceSummary row;
  row.robot = "amr-1";
  row.planned = 10;
  row.stored = 7;
  row.missed[static_cast<std::size_t>(Cause::timeout)] = 2;
  row.missed[static_cast<std::size_t>(Cause::overrun)] = 1;
  const std::string text = summary_text({row});
  CHECK(text.find("timeout 2, overrun 1") != std::string::npos);
}

TEST_CASE("a recording without a single answer names the cause behind most missed polls") {
  SourceSummary row;
  row.robot = "amr-1";
  row.planned = 12;
  row.missed[static_cast<std::size_t>(Cause::connect_refused)] = 3;
  row.missed[static_cast<std::size_t>(Cause::timeout)] = 1;
  row.missed[static_cast<std::size_t>(Cause::shutdown)] = 8;  // a consequence, not the cause
  CHECK(nothing_recorded({row, row}) == "nothing was recorded: nobody listens on the port");
  CHECK(nothing_recorded({}) == "nothing was recorded: it ended before the first poll");
  SourceSummary other = row;
  other.stored = 1;
  CHECK(nothing_recorded({row, other}).empty());
}

TEST_CASE("a second recording begins with what the first has learned about a robot") {
  ModbusServer modbus([](const Asked& a) { return a.function == 4 && a.holds(28) ? 2 : 0; });
  const tacho::test::TempDir dir;
  Config config = config_for(dir / "log", {{closed_port(), modbus.port()}});
  config.robots[0].settings.period_us = {0, 0, 50'000, 50'000};
  Recorder::Options options;
  options.run_for_us = 500'000;
  for (const bool again : {false, true}) {
    modbus.take();
    Recorder recorder(config, options);
    wait_done(recorder);
    const auto summary = recorder.finish();
    CHECK(summary.at(0).stored > 0);
    CHECK(summary.at(0).partial == 1);  // each recording says once what it does not have
    const auto asked = modbus.take();
    CHECK(std::any_of(asked.begin(), asked.end(), [](const Asked& a) { return a.function == 4 && a.holds(28); }) ==
          !again);
    CHECK(std::filesystem::exists(dir / "log" / "learned.json"));
  }
  std::ofstream(dir / "log" / "learned.json") << "{";
  std::vector<std::string> notices;
  options.notice = [&](const std::string& text) { notices.push_back(text); };
  Recorder recorder(config, options);
  wait_done(recorder);
  recorder.finish();
  REQUIRE_FALSE(notices.empty());
  CHECK(notices[0].find("learned.json") != std::string::npos);
}
