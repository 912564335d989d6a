// A robot is who it says it is; the address is only where it was found.

#include "recorder/identity.hpp"

#include <map>
#include <mutex>

#include "recorder/roster.hpp"
#include "schema/survey.hpp"
#include "schema/time.hpp"
#include "tests/recorder/fakes.hpp"
#include "tests/recorder/recording.hpp"
#include "tests/support/temp_dir.hpp"

using namespace tacho;
using namespace tacho::recorder;
using namespace tacho::recorder::test;
using namespace std::chrono_literals;
using tacho::test::TempDir;

namespace {

/// Who lives where. Thread-safe.
class Town {
 public:
  void move(const std::string& host, const std::string& body) {
    const std::lock_guard lock(mutex_);
    bodies_[host] = body;
  }
  std::string at(const std::string& host) {
    const std::lock_guard lock(mutex_);
    return bodies_[host];
  }

 private:
  std::mutex mutex_;
  std::map<std::string, std::string> bodies_;
};

/// Answers at once with what lives at its host.
class TownLink final : public Link {
 public:
  TownLink(Town& town, std::string host) : town_(town), host_(std::move(host)) {}
  PollResult poll(Source source, std::chrono::milliseconds) override {
    PollResult out;
    out.ok = !interrupted_;
    out.cause = Cause::shutdown;
    out.body = source == Source::io ? R"({"DI":[]})" : town_.at(host_);
    out.t_send_us = out.t_recv_us = wall_now_us();
    return out;
  }
  [[nodiscard]] bool connected() const override { return true; }
  void close() override {}
  void interrupt() override { interrupted_ = true; }

 private:
  Town& town_;
  std::string host_;
  std::atomic<bool> interrupted_{false};
};

std::string body(const std::string& name, const std::string& mac) {
  return R"({"vehicle_id":")" + name + R"(","MAC":")" + mac + R"(","model_md5":"m"})";
}
const std::string kAnna = body("Anna", "00:01");
const std::string kBert = body("Bert", "00:02");

struct Bench {
  TempDir dir;
  Town town;
  std::unique_ptr<Recorder> recorder;

  void record(const std::vector<std::string>& hosts) {
    Config config;
    config.log = dir / "log";
    config.commit_us = 50'000;
    for (const std::string& host : hosts) {
      RobotConfig robot;
      robot.name = "at-" + host;
      robot.host = host;
      robot.settings.period_us = {20'000, 30'000, 0, 0};
      robot.settings.status.spacing_us = 0;
      config.robots.push_back(robot);
    }
    Recorder::Options options;
    options.make = [this](const RobotConfig& one, Protocol) { return std::make_unique<TownLink>(town, one.host); };
    recorder = std::make_unique<Recorder>(config, std::move(options));
  }
  [[nodiscard]] std::uint64_t stored(const std::string& row) const {
    for (const StreamNow& stream : recorder->snapshot().streams) {
      if (stream.robot == row && stream.source == Source::status) {
        return stream.stored;
      }
    }
    return 0;
  }
  void wait_for(const std::string& row) const {
    const std::uint64_t before = stored(row);
    const auto end = std::chrono::steady_clock::now() + 60s;
    while (stored(row) < before + 10) {  // more than what is not committed yet
      INFO("waited a minute for answers of " << row);
      REQUIRE(std::chrono::steady_clock::now() < end);
      std::this_thread::sleep_for(2ms);
    }
  }
  void finish() {
    const auto summary = recorder->finish();
    recorder.reset();
    if (open(dir / "log")->sessions().size() == 1) {
      check_log(dir / "log", summary);
    }
    const std::vector<std::filesystem::path> logs{dir / "log"};
    store::LogReader reader(logs, {answer_decode(), {}});
    for (const auto& [key, stream] : survey(reader).streams) {
      INFO(key.robot << " " << source_name(key.source));
      CHECK(stream.holes.empty());
      CHECK(stream.doubled == 0);
      CHECK(stream.beyond == 0);
      CHECK(stream.stored + stream.missed == stream.planned);
    }
  }
  /// Every body in the log belongs to the robot whose row it is in.
  void check_owners(const std::map<std::string, std::string>& owners) const {
    const auto log = open(dir / "log");
    REQUIRE(log->robots().size() == owners.size());
    for (const Robot& robot : log->robots()) {
      INFO(robot.name);
      REQUIRE(owners.count(robot.name) == 1);
      std::size_t rows = 0;
      log->read_raw(robot.id, Source::status, {}, [&](const Answer& answer) {
        CHECK(answer.body == owners.at(robot.name));
        ++rows;
      });
      CHECK(rows > 0);
    }
  }
};

Identity who(const std::string& id, const std::string& mac = "", const std::string& model = "") {
  return {id, mac, model};
}

}  // namespace

TEST_CASE("only what both tell can make two robots of one") {
  CHECK(who("a", "1").differs(who("a", "2")));
  CHECK(who("a", "1").differs(who("b")));
  CHECK(who("a", "1", "m").differs(who("a", "1", "n")));
  CHECK_FALSE(who("a").differs(who("", "1")));
  CHECK_FALSE(who("a").differs(who("")));
  CHECK(who("a", "1").same(who("a")));
  CHECK_FALSE(who("a").same(who("", "1")));
  CHECK_FALSE(who("", "", "m").same(who("", "", "m")));  // a model is no robot
  Identity known = who("a");
  known.learn(who("", "1"));
  known.learn(who(""));
  CHECK(known.text() == "a, MAC 1");
  CHECK(who("").text() == "unknown");
}

TEST_CASE("a robot of the log is found again by its identity, one that is not there gets a row of its own") {
  Roster roster;
  roster.assign("left", {1, "left", who("anna")});
  roster.assign("right", {2, "right", who("bert")});
  roster.know({3, "left (2)", who("carl")});
  CHECK(roster.place("left", who("carl", "9")).name == "left (2)");
  CHECK(roster.place("left", who("dora")).name == "left (3)");
  CHECK(roster.place("left", who("bert")).name == "right");
  CHECK(roster.place("left", who("bert")).taken);
  roster.leave("right");
  CHECK_FALSE(roster.place("left", who("bert")).taken);
  CHECK(roster.find("right")->id == 2);
  CHECK(roster.recorded_for(2).empty());
  CHECK(roster.first_place("new").name == "new");
  CHECK(roster.first_place("left (2)").name == "left (2)");
  CHECK(roster.first_place("left").name == "left (3)");  // another configured robot is recorded into it
}

TEST_CASE("the poll that another robot answers is missed, and nothing is planned after it") {
  FakeClock clock;
  VectorSink sink;
  AnswerReader reader;
  RobotWatch watch({who("Anna"), false, 0, 0}, reader);
  PollerOptions options;
  options.sources = {{Source::status, kSecond, 0}, {Source::io, 500'000, 0}};
  options.spacing_us = 0;
  options.watch = &watch;
  std::vector<Identity> strangers;
  options.stranger = [&](const Identity& other) { strangers.push_back(other); };
  Poller poller(std::move(options),
                std::make_unique<FakeLink>(clock,
                                           [](Source, Micros now) {
                                             Act act;
                                             act.body = now < 5 * kSecond ? R"({"vehicle_id":"Anna"})"
                                                                          : R"({"vehicle_id":"Bert"})";
                                             return act;
                                           }),
                clock, sink);
  poller.run(0, 60 * kSecond);
  REQUIRE(strangers.size() == 1);
  CHECK(strangers[0].text() == "Bert");
  CHECK(poller.counters(0).planned == 6);
  CHECK(poller.counters(0).stored == 5);
  CHECK(poller.counters(0).missed[static_cast<std::size_t>(Cause::other_robot)] == 1);
  CHECK(poller.counters(1).stored + poller.counters(1).missed_total() == poller.counters(1).planned);
  CHECK(clock.mono_us() < 6 * kSecond);
  REQUIRE_FALSE(sink.gaps.empty());
  CHECK(sink.gaps[0].cause == Cause::other_robot);
  CHECK(sink.gaps[0].detail == "answered by Bert");
}

TEST_CASE("another robot at the same address is another robot of the log, and the first one is known when it returns") {
  Bench bench;
  bench.town.move("here", kAnna);
  bench.record({"here"});
  bench.wait_for("at-here");
  bench.town.move("here", R"({"x":1})");  // tells nothing: no difference
  bench.wait_for("at-here");
  bench.town.move("here", kBert);
  bench.wait_for("at-here (2)");
  bench.town.move("here", kAnna);
  bench.wait_for("at-here");
  CHECK_FALSE(bench.recorder->done());
  bench.finish();
  const auto events = events_of(bench.dir / "log", 1);
  const auto changed =
      std::find_if(events.begin(), events.end(), [](const Event& e) { return e.kind == EventKind::identity_changed; });
  REQUIRE(changed != events.end());
  CHECK(changed->old_value == "Anna, MAC 00:01, model m");
  CHECK(changed->new_value == "Bert, MAC 00:02, model m");
  CHECK(changed->detail == "another robot answers; it is recorded as 'at-here (2)'");
  const auto log = open(bench.dir / "log");
  REQUIRE(log->robots().size() == 2);
  CHECK(log->robots()[1].vehicle_id == "Bert");
  log->read_raw(2, Source::status, {}, [](const Answer& answer) { CHECK(answer.body == kBert); });
  log->read_raw(1, Source::status, {}, [](const Answer& answer) { CHECK(answer.body != kBert); });
}

TEST_CASE("two robots that exchange their addresses keep their rows") {
  Bench bench;
  bench.town.move("left", kAnna);
  bench.town.move("right", kBert);
  bench.record({"left", "right"});
  bench.wait_for("at-left");
  bench.wait_for("at-right");
  bench.town.move("left", kBert);
  bench.town.move("right", kAnna);
  bench.wait_for("at-left");
  bench.wait_for("at-right");
  bench.finish();
  bench.check_owners({{"at-left", kAnna}, {"at-right", kBert}});
}

TEST_CASE("a later session knows the robots of the log") {
  Bench bench;
  bench.town.move("here", kAnna);
  bench.record({"here"});
  bench.wait_for("at-here");
  bench.finish();
  bench.town.move("here", kBert);
  bench.record({"here"});
  bench.wait_for("at-here (2)");
  bench.finish();
  bench.record({"here"});
  bench.wait_for("at-here (2)");
  bench.finish();
  bench.check_owners({{"at-here", kAnna}, {"at-here (2)", kBert}});
}

TEST_CASE("stopping while a robot is being replaced ends at once and loses nothing") {
  for (int round = 0; round < 10; ++round) {
    Bench bench;
    bench.town.move("here", kAnna);
    bench.record({"here"});
    bench.wait_for("at-here");
    bench.town.move("here", kBert);
    std::this_thread::sleep_for(std::chrono::milliseconds(5 * round));
    bench.recorder->stop();
    bench.finish();
  }
}
