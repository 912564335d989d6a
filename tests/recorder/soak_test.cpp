// Months in minutes: two pollers ask a simulated robot of profile S in virtual time and a real writer thread records
// it, through outages, midnights and the removal of old parts. Nothing may grow.
//
// Three hours over a midnight by default; with TACHO_SOAK=1 thirty days, from a release build: sanitizers keep memory.

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <cstdlib>
#include <filesystem>
#include <mutex>
#include <thread>

#include "recorder/fleet.hpp"
#include "recorder/log_thread.hpp"
#include "recorder/own_rows.hpp"
#include "recorder/poller.hpp"
#include "samples/simulator/answers.hpp"
#include "samples/simulator/robot.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/measure.hpp"
#include "tests/support/temp_dir.hpp"

using namespace tacho;
using namespace tacho::recorder;
using namespace tacho::test;
namespace fs = std::filesystem;

namespace {

constexpr Micros kSecond = 1'000'000;
constexpr Micros kHour = 3600 * kSecond;
constexpr Micros kStart = 1'767'306'600'000'000;  // 2026-01-01T22:30:00Z
constexpr Micros kMost = 200'000'000'000'000;     // later than any run ends
constexpr std::size_t kMostWaiting = 2000;        // answers in the queue, far from what it takes

/// Virtual time of several threads, so that none is more than a second ahead of another, or of the writer.
class PacedTime {
 public:
  PacedTime(std::size_t threads, std::function<std::size_t()> waiting)
      : reached_(threads, 0), waiting_(std::move(waiting)) {}

  void reach(std::size_t thread, Micros now_us) {
    std::unique_lock lock(mutex_);
    reached_[thread] = now_us;
    moved_.notify_all();
    moved_.wait(lock, [&] { return now_us <= *std::min_element(reached_.begin(), reached_.end()) + kSecond; });
    lock.unlock();
    while (waiting_() > kMostWaiting) {
      std::this_thread::sleep_for(std::chrono::microseconds(200));
    }
  }

 private:
  std::mutex mutex_;
  std::condition_variable moved_;
  std::vector<Micros> reached_;
  std::function<std::size_t()> waiting_;
};

/// Of one thread: sleeping moves it.
class PacedClock final : public Clock {
 public:
  PacedClock(PacedTime& time, std::size_t thread) : time_(time), thread_(thread) {}
  [[nodiscard]] Micros mono_us() const override { return now_us_; }
  [[nodiscard]] Micros wall_us() const override { return kStart + now_us_; }
  bool sleep_until(Micros mono_us) override {
    pass(std::max<Micros>(mono_us - now_us_, 0));
    return true;
  }
  [[nodiscard]] std::optional<Micros> stopped_at() const override { return std::nullopt; }

  void pass(Micros us) {
    const Micros before = now_us_;
    now_us_ += us;
    if (before / kSecond != now_us_ / kSecond) {
      time_.reach(thread_, now_us_);
    }
  }
  /// Nobody waits for this thread any more.
  void leave() { time_.reach(thread_, std::exchange(now_us_, kMost)); }

 private:
  PacedTime& time_;
  std::size_t thread_;
  Micros now_us_ = 0;
};

/// Every day the robot is off for five minutes, every hour the network is lost for half a minute, and now and then an
/// answer does not come.
bool reachable(Micros mono_us) { return mono_us % (24 * kHour) >= 300 * kSecond && mono_us % kHour >= 30 * kSecond; }

class SimulatedLink final : public Link {
 public:
  explicit SimulatedLink(PacedClock& clock, const sim::Scenario& scenario)
      : clock_(clock), robot_(scenario, kStart), answers_(scenario) {}

  PollResult poll(Source source, std::chrono::milliseconds timeout) override {
    PollResult result;
    result.t_send_us = clock_.wall_us();
    if (!reachable(clock_.mono_us())) {
      connected_ = false;
      result.cause = Cause::connect_refused;
    } else if (++polls_ % 10'007 == 0) {
      clock_.pass(std::chrono::microseconds(timeout).count());
      connected_ = false;
    } else {
      clock_.pass(4000 + static_cast<Micros>(polls_ * 7919 % 5000));
      connected_ = result.ok = true;
      result.body = answers_.body(source, robot_.at(clock_.wall_us()));
    }
    result.t_recv_us = clock_.wall_us();
    result.detail = result.ok ? "" : "as it was made to be";
    return result;
  }
  [[nodiscard]] bool connected() const override { return connected_; }
  void close() override { connected_ = false; }
  void interrupt() override {}

 private:
  PacedClock& clock_;
  sim::Robot robot_;
  sim::AnswerMaker answers_;
  std::uint64_t polls_ = 0;
  bool connected_ = false;
};

/// What the process holds, every simulated hour.
struct Holdings {
  std::vector<double> bytes;
  std::vector<std::size_t> files;
};

RobotConfig robot_config() {
  RobotConfig robot;
  robot.name = "r1";
  robot.host = "127.0.0.1";
  robot.settings.period_us[static_cast<std::size_t>(Source::status)] = kSecond;
  robot.settings.period_us[static_cast<std::size_t>(Source::io)] = kSecond / 2;
  robot.settings.period_us[static_cast<std::size_t>(Source::registers)] = kSecond / 5;
  robot.settings.period_us[static_cast<std::size_t>(Source::inputs)] = kSecond / 5;
  return robot;
}

/// One robot with its two connections, its writer and its log.
class Soak {
 public:
  explicit Soak(const fs::path& folder)
      : writer_(folder, writer_options()),
        ingest_(writer_, [] { return kStart; }),
        time_(2, [this] { return log_->numbers().queue_items; }) {
    Session session;
    session.t_start_us = kStart;
    session.id = session_ = writer_.begin_session(session);
    robot_ = writer_.robot(config_.name, config_.address());
    for (const Source source : sources_) {
      ingest_.declare(stream_of(config_, {session_, robot_, source, 0}));
    }
    LogThread::Options out;
    out.commit_interval = std::chrono::milliseconds(5);
    out.planned = [this](store::LogWriter& writer) { tell_planned(writer); };
    out.notice = [this](const std::string& text) {
      disk_failures_ += text.find("cause disk") != std::string::npos ? 1 : 0;
    };
    log_ = std::make_unique<LogThread>(writer_, ingest_, std::move(out));
    log_->watch(robot_, config_.name, config_);
    RobotWatch::Options watch;
    watch.rates_vary = true;
    watch_ = std::make_unique<RobotWatch>(std::move(watch), reader_);
    sim::Scenario scenario = sim::busy_day(1);
    for (std::size_t i = 0; i < 2; ++i) {
      clocks_.push_back(std::make_unique<PacedClock>(time_, i));
      PollerOptions options;
      options.robot = robot_;
      options.session = session_;
      options.spacing_us = 0;
      options.watch = watch_.get();
      options.sources =
          i == 0 ? std::vector<PolledSource>{{Source::status, kSecond}, {Source::io, kSecond / 2, 250'000}}
                 : std::vector<PolledSource>{{Source::registers, kSecond / 5}, {Source::inputs, kSecond / 5, 100'000}};
      pollers_.push_back(std::make_unique<Poller>(
          std::move(options), std::make_unique<SimulatedLink>(*clocks_[i], scenario), *clocks_[i], *log_));
    }
  }

  /// Until `end_us`; looks at the process every hour.
  Holdings run(Micros end_us) {
    log_->start();
    std::vector<std::thread> threads;
    std::atomic<std::size_t> running{2};
    for (std::size_t i = 0; i < 2; ++i) {
      threads.emplace_back([&, i] {
        pollers_[i]->run(0, end_us);
        clocks_[i]->leave();
        --running;
      });
    }
    Holdings out;
    std::uint64_t status_polls = 0;
    while (running > 0) {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
      const std::uint64_t planned = pollers_[0]->counters(0).planned;
      if (planned >= status_polls + 3600) {
        status_polls = planned;
        out.bytes.push_back(resident_bytes());
        out.files.push_back(open_files());
      }
    }
    for (std::thread& thread : threads) {
      thread.join();
    }
    log_->finish(true);
    return out;
  }

  void check_counts() const {
    for (std::size_t i = 0; i < sources_.size(); ++i) {
      INFO(source_name(sources_[i]));
      const SourceCounters& asked = pollers_[i / 2]->counters(i % 2);
      const store::LogWriter::Tally tally = writer_.tally(robot_, sources_[i]);
      CHECK(tally.stored == asked.stored);
      CHECK(tally.missed[static_cast<std::size_t>(Cause::connect_refused)] > 0);
      CHECK(asked.stored + asked.missed_total() == asked.planned);
      std::uint64_t missed = 0;
      for (const std::uint64_t count : tally.missed) {
        missed += count;
      }
      CHECK(tally.stored + missed == asked.planned);
    }
  }

  [[nodiscard]] int disk_failures() const { return disk_failures_; }
  [[nodiscard]] std::uint64_t rows() const { return writer_.stats().rows; }

 private:
  RobotConfig config_ = robot_config();
  std::array<Source, 4> sources_{Source::status, Source::io, Source::registers, Source::inputs};
  std::atomic<int> disk_failures_{0};
  store::LogWriter writer_;
  Ingest ingest_;
  SessionId session_ = 0;
  RobotId robot_ = 0;
  PacedTime time_;
  AnswerReader reader_;
  std::unique_ptr<RobotWatch> watch_;
  std::vector<std::unique_ptr<PacedClock>> clocks_;
  std::unique_ptr<LogThread> log_;
  std::vector<std::unique_ptr<Poller>> pollers_;

  static store::WriterOptions writer_options() {
    store::WriterOptions out;
    out.durable = false;  // no power fails here
    out.decode = answer_decode();
    out.retention.rules.size_bytes = 100U << 20U;
    return out;
  }
  void tell_planned(store::LogWriter& writer) const {
    for (std::size_t i = 0; i < sources_.size(); ++i) {
      writer.planned(robot_, sources_[i], pollers_[i / 2]->counters(i % 2).planned);
    }
  }
};

}  // namespace

TEST_CASE("A recording that goes on and on accounts for every poll, and holds no more memory and files") {
  const bool long_run = std::getenv("TACHO_SOAK") != nullptr;
  const test::TempDir dir;
  Soak soak(dir.path() / "log");
  const Holdings held = soak.run(long_run ? 30 * 24 * kHour : 3 * kHour);
  soak.check_counts();
  CHECK(soak.disk_failures() == 0);
  REQUIRE(held.files.size() >= 2);
  const auto most = std::max_element(held.files.begin() + 1, held.files.end());
  CHECK(*most <= held.files.front() + 3);  // the next part, opened ahead: file, WAL and its index
  if (long_run) {
    constexpr std::ptrdiff_t kFiveDays = 120;
    const double early = median({held.bytes.begin() + 24, held.bytes.begin() + 24 + kFiveDays});
    const double late = median({held.bytes.end() - kFiveDays, held.bytes.end()});
    fmt::print("{} rows; resident {:.2f} MB in days 2 to 6, {:.2f} MB in the last five; at most {} files open\n",
               soak.rows(), early / 1e6, late / 1e6, *most);
    CHECK(late - early < 1e6);
    CHECK(soak.rows() > 30'000'000);
  }
}
