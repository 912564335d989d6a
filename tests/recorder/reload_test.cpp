// Another configuration for a running recorder: what changes, what must not, and what the log says of it.

#include "recorder/reload.hpp"

#include <map>
#include <mutex>

#include "schema/survey.hpp"
#include "schema/time.hpp"
#include "tests/recorder/recording.hpp"
#include "tests/support/temp_dir.hpp"

using namespace tacho;
using namespace tacho::recorder;
using namespace tacho::recorder::test;
using namespace std::chrono_literals;
using tacho::test::TempDir;

namespace {

RobotConfig robot(const std::string& name, Micros status_us = 1'000'000) {
  RobotConfig out;
  out.name = name;
  out.host = "127.0.0.1";
  out.settings.period_us = {status_us, 0, 0, 0};
  out.settings.status.spacing_us = 0;
  return out;
}

Config config_of(std::vector<RobotConfig> robots) {
  Config out;
  out.log = "log";
  out.robots = std::move(robots);
  return out;
}

std::vector<std::string> names(const std::vector<RobotConfig>& robots) {
  std::vector<std::string> out;
  for (const RobotConfig& one : robots) {
    out.push_back(one.name);
  }
  return out;
}

std::string refused(const Config& now, const Config& next) {
  try {
    plan_reload(now, next);
  } catch (const UsageError& error) {
    return error.what();
  }
  return "";
}

/// Answers at once. Counts how many were made for each robot.
class QuickLink final : public Link {
 public:
  PollResult poll(Source, std::chrono::milliseconds) override {
    PollResult out;
    out.ok = !interrupted_;
    out.cause = Cause::shutdown;
    out.body = R"({"x":1.5})";
    out.t_send_us = out.t_recv_us = wall_now_us();
    return out;
  }
  [[nodiscard]] bool connected() const override { return true; }
  void close() override {}
  void interrupt() override { interrupted_ = true; }

 private:
  std::atomic<bool> interrupted_{false};
};

struct Bench {
  TempDir dir;
  std::mutex mutex;
  std::map<std::string, int> made;
  std::unique_ptr<Recorder> recorder;
  Config config;

  explicit Bench(std::vector<RobotConfig> robots) : config(config_of(std::move(robots))) {
    config.log = dir / "log";
    config.commit_us = 50'000;
    Recorder::Options options;
    options.make = [this](const RobotConfig& one, Protocol) {
      const std::lock_guard lock(mutex);
      ++made[one.name];
      return std::make_unique<QuickLink>();
    };
    recorder = std::make_unique<Recorder>(config, std::move(options));
  }

  std::string reload(std::vector<RobotConfig> robots, const std::string& text = "text") {
    config.robots = std::move(robots);
    return recorder->reload(config, text);
  }

  [[nodiscard]] StreamNow stream(const std::string& name) const {
    for (StreamNow& one : recorder->snapshot().streams) {
      if (one.robot == name) {
        return one;
      }
    }
    return {};
  }
  void wait_stored(const std::string& name, std::uint64_t count) const {
    while (stream(name).stored < count) {
      std::this_thread::sleep_for(2ms);
    }
  }
  [[nodiscard]] std::vector<Event> events(RobotId id, EventKind kind) const {
    const std::vector<std::filesystem::path> logs{dir / "log"};
    store::LogReader reader(logs, {answer_decode(), {}});
    std::vector<Event> out;
    for (std::size_t part = 0; part < reader.parts().size(); ++part) {
      for (const Event& event : reader.part_records(part, id).events) {
        if (event.kind == kind) {
          out.push_back(event);
        }
      }
    }
    return out;
  }
};

}  // namespace

TEST_CASE("a reload tells robots that are the same, changed, new and gone apart by their names") {
  const Config now = config_of({robot("a"), robot("b"), robot("c")});
  Config next = config_of({robot("d"), robot("c", 500'000), robot("a")});
  const ReloadPlan plan = plan_reload(now, next);
  CHECK(plan.kept == 1);
  CHECK(names(plan.changed) == std::vector<std::string>{"c"});
  CHECK(names(plan.added) == std::vector<std::string>{"d"});
  CHECK(plan.removed == std::vector<std::string>{"b"});
  CHECK(plan.text() == "1 robot kept, changed: c, added: d, removed: b");
  CHECK(plan_reload(now, now).nothing());
  next = now;
  next.robots[1].settings.status.request.keys = {"x"};
  CHECK(names(plan_reload(now, next).changed) == std::vector<std::string>{"b"});
}

TEST_CASE("what belongs to the log or the whole program is refused by name while recording") {
  const Config now = config_of({robot("a")});
  const auto with = [&](auto change) {
    Config next = now;
    change(next);
    return refused(now, next);
  };
  CHECK(with([](Config& c) { c.log = "elsewhere"; }).rfind("log: cannot be changed while recording", 0) == 0);
  CHECK(with([](Config& c) { c.commit_us *= 2; }).rfind("commit:", 0) == 0);
  CHECK(with([](Config& c) { c.part_bytes *= 2; }).rfind("part_size:", 0) == 0);
  CHECK(with([](Config& c) { c.retention.age_us = 1; }).rfind("[retention]:", 0) == 0);
  CHECK(with([](Config& c) { c.metrics = "127.0.0.1:1"; }).rfind("metrics:", 0) == 0);
}

TEST_CASE("a reload starts, stops and restarts robots, and one that is unchanged notices nothing") {
  Bench bench({robot("same", 20'000), robot("gone", 20'000), robot("faster", 40'000)});
  for (const char* name : {"same", "gone", "faster"}) {
    bench.wait_stored(name, 3);
  }
  CHECK(bench.reload({robot("same", 20'000), robot("faster", 10'000), robot("new", 20'000)}) ==
        "1 robot kept, changed: faster, added: new, removed: gone");
  const std::uint64_t before = bench.stream("faster").stored;
  bench.wait_stored("new", 3);
  bench.wait_stored("faster", before + 3);
  bench.wait_stored("same", bench.stream("same").stored + 3);
  CHECK(bench.stream("gone").period_us == 0);
  CHECK(bench.stream("faster").period_us == 10'000);
  const auto summary = bench.recorder->finish();
  check_log(bench.dir / "log", summary);  // every number once, also of what was stopped and restarted
  REQUIRE(summary.size() == 4);
  CHECK(bench.made == std::map<std::string, int>{{"same", 1}, {"gone", 1}, {"faster", 2}, {"new", 1}});
  for (const SourceSummary& row : summary) {
    INFO(row.robot);
    std::uint64_t other = 0;
    for (std::size_t c = 0; c < kCauseCount; ++c) {
      other += c == static_cast<std::size_t>(Cause::overrun) ? 0 : row.missed[c];  // a busy computer's
    }
    CHECK((row.robot != "same" || other <= 1));  // the one that the end interrupts
    CHECK(row.planned > 2);
  }
}

TEST_CASE("the log tells of a reload: the new text, the rates that changed, and pauses") {
  Bench bench({robot("a", 20'000), robot("b", 20'000)});
  bench.wait_stored("a", 2);
  bench.wait_stored("b", 2);
  bench.reload({robot("a", 20'000)}, "without b");
  bench.wait_stored("a", bench.stream("a").stored + 2);
  bench.reload({robot("a", 20'000), robot("b", 30'000)}, "with b again");
  bench.wait_stored("b", bench.stream("b").stored + 2);
  check_log(bench.dir / "log", bench.recorder->finish());

  const auto changes = bench.events(0, EventKind::config_changed);
  REQUIRE(changes.size() == 2);
  CHECK(changes[0].subject == "1 robot kept, removed: b");
  CHECK(changes[0].detail == "without b");
  CHECK(changes[1].detail == "with b again");
  CHECK(bench.events(1, EventKind::rate).empty());
  const auto rates = bench.events(2, EventKind::rate);
  REQUIRE(rates.size() == 2);
  CHECK(rates[0].old_value == "20 ms");
  CHECK(rates[0].new_value == "off");
  CHECK(rates[1].old_value == "off");
  CHECK(rates[1].new_value == "30 ms");
  CHECK(rates[1].seq == rates[0].seq);

  const std::vector<std::filesystem::path> logs{bench.dir / "log"};
  store::LogReader reader(logs, {answer_decode(), {}});
  const Survey found = survey(reader);
  for (const auto& [key, stream] : found.streams) {
    CHECK(stream.holes.empty());
    CHECK(stream.doubled == 0);
    CHECK(stream.beyond == 0);
    CHECK(stream.stored + stream.missed == stream.planned);
  }
  std::size_t pauses = 0;
  for (const Gap& gap : reader.part_records(0, 2).gaps) {
    pauses += gap.cause == Cause::recorder_off && gap.seq_count == 0 ? 1 : 0;
  }
  CHECK(pauses == 1);
  CHECK(reader.sessions().size() == 1);
}

TEST_CASE("a source that is switched on later is a stream of the same session") {
  Bench bench({robot("a", 20'000)});
  bench.wait_stored("a", 2);
  RobotConfig with_io = robot("a", 20'000);
  with_io.settings.period_us[1] = 20'000;
  bench.reload({with_io});
  while (bench.recorder->snapshot().streams.size() < 2 || bench.recorder->snapshot().streams[1].stored < 2) {
    std::this_thread::sleep_for(2ms);
  }
  bench.reload({robot("a", 20'000)}, "io off");
  bench.reload({with_io}, "io on again");
  const auto summary = bench.recorder->finish();
  REQUIRE(summary.size() == 2);
  check_log(bench.dir / "log", summary);
  std::vector<std::string> rates;
  for (const Event& event : bench.events(1, EventKind::rate)) {
    CHECK(event.source == Source::io);
    rates.push_back(event.old_value + " -> " + event.new_value);
  }
  CHECK(rates == std::vector<std::string>{"off -> 20 ms", "20 ms -> off", "off -> 20 ms"});
}

TEST_CASE("a reload without a difference, or with one that is refused, leaves no trace") {
  Bench bench({robot("a", 20'000)});
  bench.wait_stored("a", 1);
  CHECK(bench.reload({robot("a", 20'000)}) == "nothing differs");
  bench.config.part_bytes *= 2;
  CHECK_THROWS_AS(bench.reload({robot("b", 20'000)}), UsageError);
  bench.wait_stored("a", bench.stream("a").stored + 2);
  const auto summary = bench.recorder->finish();
  REQUIRE(summary.size() == 1);
  check_log(bench.dir / "log", summary);
  CHECK(bench.made == std::map<std::string, int>{{"a", 1}});
  CHECK(bench.events(0, EventKind::config_changed).empty());
}
