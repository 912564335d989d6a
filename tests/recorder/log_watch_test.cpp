// `status` and `tail` on logs that are recorded, ended, killed and reconfigured.

#include <atomic>
#include <mutex>

#include "recorder/log_holder.hpp"
#include "recorder/log_status.hpp"
#include "recorder/log_tail.hpp"
#include "schema/time.hpp"
#include "tests/recorder/recording.hpp"
#include "tests/support/temp_dir.hpp"

using namespace tacho;
using namespace tacho::recorder;
using namespace tacho::recorder::test;
using namespace std::chrono_literals;
using tacho::test::TempDir;

namespace {

bool has(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

std::size_t count(const std::vector<std::string>& lines, const std::string& part) {
  return static_cast<std::size_t>(
      std::count_if(lines.begin(), lines.end(), [&](const std::string& line) { return has(line, part); }));
}

/// One living robot r1 and r2 that is dead, recorded until the destructor.
struct Site {
  TempDir dir;
  TinyServer status{[](Peer& peer, int) { serve_status(peer); }};
  ModbusServer modbus{[](const Asked&) { return 0; }};
  Config config;
  std::unique_ptr<Recorder> recorder;

  Site() {
    const std::uint16_t nobody = closed_port();
    config = config_for(dir / "log", {{status.port(), modbus.port()}, {nobody, nobody}});
    recorder = std::make_unique<Recorder>(config, Recorder::Options{});
  }
  [[nodiscard]] std::filesystem::path log() const { return dir / "log"; }
  void wait_rows(std::uint64_t rows) const {
    while (recorder->progress().rows < rows) {
      std::this_thread::sleep_for(5ms);
    }
  }
  [[nodiscard]] LogStatus look() const { return read_status(log(), wall_now_us()); }
};

const StreamStatus& stream(const LogStatus& status, const std::string& robot, Source source) {
  for (const StreamStatus& one : status.streams) {
    if (one.robot == robot && one.source == source) {
      return one;
    }
  }
  throw std::runtime_error("no such stream");
}

}  // namespace

TEST_CASE("status of a log that is recorded says by whom, and how each source is doing") {
  Site site;
  site.wait_rows(40);
  std::this_thread::sleep_for(100ms);  // two commits
  const LogStatus status = site.look();
  CHECK(status.alive());
  CHECK(has(status.holder, "process " + std::to_string(getpid()) + " on "));
  CHECK(status.session.t_end_us == 0);
  REQUIRE(status.streams.size() == 8);
  const StreamStatus& registers = stream(status, "r1", Source::registers);
  CHECK(registers.stored > 0);
  CHECK(registers.last_minute == registers.stored);
  CHECK(registers.word_order == "cdab");
  CHECK(registers.period_us == 25'000);
  CHECK_FALSE(registers.late);
  CHECK(stream(status, "r2", Source::status).last_answer_us == 0);
  const std::string text = status_text(status);
  CHECK(has(text, "recorded by process"));
  CHECK(has(text, "word order cdab"));
  CHECK(has(text, "never"));
  CHECK(stream(status, "r1", Source::io).lost.empty());
  CHECK(stream(status, "r2", Source::inputs).lost == "connect_refused");
  CHECK(has(text, "connection lost: connect_refused"));
  CHECK(has(status_json(status), "\"recorded\":true"));
  site.recorder->finish();
}

TEST_CASE("missed polls of the last day are shown by their causes") {
  Site site;
  site.wait_rows(20);
  const auto summary = site.recorder->finish();
  const LogStatus status = site.look();
  for (const SourceSummary& row : summary) {
    const StreamStatus& seen = stream(status, row.robot, row.source);
    CHECK(seen.stored == row.stored);
    CHECK(seen.missed_in_day == row.missed);
  }
  CHECK(has(status_text(status), "connect_refused "));
}

TEST_CASE("a log that nobody records looks like it: ended, died, and long ago") {
  Site site;
  site.wait_rows(20);
  SECTION("ended") {
    site.recorder->finish();
    site.recorder.reset();
    const LogStatus status = site.look();
    CHECK_FALSE(status.alive());
    CHECK(status.holder.empty());
    CHECK(has(status_text(status), "NOT RECORDED: the last recording ended"));
    CHECK(has(status_json(status), "\"recorded\":false"));
  }
  SECTION("died") {
    site.recorder.reset();
    const LogStatus status = read_status(site.log(), wall_now_us() + 3'600'000'000);
    CHECK_FALSE(status.alive());
    CHECK(has(status_text(status), "NOT RECORDED: the recorder died, the last answer is 1 h"));
    for (const StreamStatus& one : status.streams) {
      CHECK_FALSE(one.late);  // the headline says it all
    }
  }
}

TEST_CASE("a source whose answers stay away while the log is recorded is late") {
  Site site;
  site.wait_rows(20);
  const LogStatus status = read_status(site.log(), wall_now_us() + 60'000'000);
  CHECK(status.alive());  // the lock is held
  CHECK(stream(status, "r1", Source::status).late);
  CHECK(has(status_text(status), "LATE"));
  const auto in_last_minute = [&](Micros later_us) {
    return stream(read_status(site.log(), wall_now_us() + later_us), "r1", Source::status).last_minute;
  };
  CHECK(in_last_minute(30'000'000) > 0);
  CHECK(in_last_minute(120'000'000) == 0);
  site.recorder->finish();
}

TEST_CASE("status knows the rate that is in force where rates depend on the robot") {
  TempDir dir;
  std::atomic<bool> moves{false};
  TinyServer server([&](Peer& peer, int) {
    wire::FrameDecoder decoder;
    wire::Frame frame;
    for (std::string byte = peer.read(1); !byte.empty(); byte = peer.read(1)) {
      decoder.feed(byte);
      if (decoder.next(frame)) {
        const std::string body =
            std::string(R"({"w":0,"task_status":0,"charging":false,"vx":)") + (moves ? "1}" : "0}");
        peer.write(wire::encode_frame(1, frame.header.sequence, wire::answer_type(frame.header.type), body));
      }
    }
  });
  Config config = config_for(dir / "log", {{server.port(), 1}});
  Settings& settings = config.robots[0].settings;
  settings.period_us = {50'000, 0, 0, 0};
  settings.standing[0].idle_us = 400'000;
  Recorder recorder(config, {});
  const auto wait_for = [&](Micros period) {
    while (stream(read_status(dir / "log", wall_now_us()), "r1", Source::status).period_us != period) {
      std::this_thread::sleep_for(50ms);
    }
  };
  wait_for(50'000);   // nothing is known yet
  wait_for(400'000);  // after the hold time
  moves = true;
  wait_for(50'000);
  check_log(dir / "log", recorder.finish());
}

TEST_CASE("status goes by the configuration that was loaded last") {
  Site site;
  site.wait_rows(20);
  Config next = site.config;
  next.robots.pop_back();
  next.robots[0].settings.period_us = {70'000, 0, 25'000, 25'000};
  site.recorder->reload(next, to_toml(next));
  const LogStatus status = read_status(site.log(), wall_now_us() + 60'000'000);
  CHECK(stream(status, "r1", Source::status).period_us == 70'000);
  CHECK(stream(status, "r1", Source::io).period_us == 0);
  CHECK_FALSE(stream(status, "r1", Source::io).late);
  CHECK_FALSE(stream(status, "r2", Source::status).late);
  CHECK(stream(status, "r1", Source::status).late);
  CHECK(has(status_text(status), "  off"));
  site.recorder->finish();
}

TEST_CASE("who holds a log is found out without touching the lock") {
  TempDir dir;
  CHECK(log_holder(dir / "none").empty());
  const Config config = config_for(dir / "log", {{closed_port(), closed_port()}});
  {
    Recorder recorder(config, {});
    CHECK(log_holder(dir / "log") == log_holder(dir / "log"));
    CHECK_FALSE(log_holder(dir / "log").empty());
  }
  CHECK(log_holder(dir / "log").empty());
  std::atomic<bool> stop{false};
  std::thread looker([&] {
    while (!stop) {
      log_holder(dir / "log");
    }
  });
  for (int i = 0; i < 5; ++i) {
    CHECK_NOTHROW(Recorder(config, {}));  // a lock that is tried would refuse one of them
  }
  stop = true;
  looker.join();
}

TEST_CASE("tail gives every answer, gap and event that is committed, once, however it is looked at") {
  Site site;
  TailOptions options;
  options.log = site.log();
  Tail tail(options, 0);
  std::vector<std::string> lines;
  const auto look = [&] {
    const auto more = tail.poll();
    CHECK(std::is_sorted(more.begin(), more.end(), [](const std::string& a, const std::string& b) {
      return a.substr(0, 23) < b.substr(0, 23);  // the time
    }));
    lines.insert(lines.end(), more.begin(), more.end());
  };
  for (std::uint64_t rows = 10; rows < 120; rows += 10) {
    site.wait_rows(rows);
    look();
  }
  const auto summary = site.recorder->finish();
  look();
  look();
  for (const SourceSummary& row : summary) {
    const std::string stream = " " + row.robot + " " + std::string(source_name(row.source));
    INFO(stream);
    CHECK(count(lines, stream + " #") == row.stored);
  }
  CHECK(count(lines, "EVENT link_up") == 2);
  CHECK(count(lines, "r2 status MISSED") > 0);
  CHECK(count(lines, ": connect_refused: ") > 0);
  CHECK(count(lines, "r1 status #0 ") == 1);
  CHECK(count(lines, " x=1.5") > 0);
}

TEST_CASE("tail begins with what comes after its start, and shows what it is asked for") {
  Site site;
  site.wait_rows(40);
  TailOptions options;
  options.log = site.log();
  options.robots = {"r1"};
  options.sources = parse_sources({"status"});
  options.fields = parse_fields({"vehicle_id"});
  options.json = true;
  const Micros start_us = wall_now_us();
  Tail tail(options, start_us);
  std::vector<std::string> lines;
  while (count(lines, "\"type\":\"answer\"") < 3) {
    const auto more = tail.poll();
    lines.insert(lines.end(), more.begin(), more.end());
    std::this_thread::sleep_for(5ms);
  }
  for (const std::string& line : lines) {
    INFO(line);
    CHECK(has(line, "\"robot\":\"r1\""));
    if (has(line, "\"type\":\"answer\"")) {
      CHECK(has(line, "\"source\":\"status\""));
      CHECK(has(line, "\"fields\":{\"vehicle_id\":\"AMB-1\"}}"));
      CHECK(std::stoll(line.substr(line.find("\"t_recv_us\":") + 12)) > start_us);
    }
  }
  site.recorder->finish();
}

TEST_CASE("tail of events alone has no answers") {
  Site site;
  site.wait_rows(20);
  TailOptions options;
  options.log = site.log();
  options.answers = false;
  site.recorder->finish();
  const auto lines = Tail(options, 0).poll();
  CHECK(count(lines, "EVENT link_up") == 2);
  CHECK(count(lines, "r1 status EVENT link_up") + count(lines, "r1 io EVENT link_up") == 1);
  CHECK(count(lines, " #0 ") == 0);
}

TEST_CASE("wrong names of robots, sources and fields are answered with the nearest") {
  Site site;
  site.wait_rows(1);
  TailOptions options;
  options.log = site.log();
  options.robots = {"r9"};
  CHECK_THROWS_WITH(Tail(options, 0), Catch::Contains("it has r1, r2"));
  CHECK_THROWS_WITH(parse_sources({"statsu"}), Catch::Contains("did you mean 'status'"));
  CHECK_THROWS_WITH(parse_fields({"battery_levl"}), Catch::Contains("did you mean 'battery_level'"));
  options.log = site.dir / "none";
  CHECK_THROWS_AS(Tail(options, 0), Error);
  CHECK_THROWS_AS(read_status(site.dir / "none", 0), Error);
}
