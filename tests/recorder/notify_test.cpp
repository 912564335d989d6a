// What the service manager is told, and when it is told nothing.

#include "recorder/notify.hpp"

#include <atomic>
#include <cstdlib>

#include "recorder/clock.hpp"
#include "recorder/health.hpp"
#include "schema/time.hpp"
#include "tests/recorder/notify_socket.hpp"
#include "tests/recorder/recording.hpp"

using namespace tacho;
using namespace tacho::recorder;
using namespace tacho::recorder::test;

namespace {

/// A variable of the environment for one test.
class Variable {
 public:
  Variable(const char* name, const std::string& value) : name_(name) { setenv(name, value.c_str(), 1); }
  ~Variable() { unsetenv(name_); }
  Variable(const Variable&) = delete;
  Variable& operator=(const Variable&) = delete;

 private:
  const char* name_;
};

/// A robot that lets a poll wait until it is told to answer.
class HangingLink final : public Link {
 public:
  explicit HangingLink(const std::atomic<bool>& hang) : hang_(hang) {}
  PollResult poll(Source, std::chrono::milliseconds) override {
    while (hang_) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    return {};
  }
  [[nodiscard]] bool connected() const override { return true; }
  void close() override {}
  void interrupt() override {}

 private:
  const std::atomic<bool>& hang_;
};

Micros busy_us(const Recorder& recorder, const std::string& who) {
  for (const Beat& beat : recorder.beats()) {
    if (beat.who == who) {
      return beat.busy_us;
    }
  }
  return -1;
}

/// Waits until a step has taken 30 ms, which none of a well thread does for ever.
void wait_hanging(const Recorder& recorder, const std::string& who) {
  for (Micros last = 0; last < 30'000;) {
    const Micros now = busy_us(recorder, who);
    REQUIRE(now >= 0);
    last = std::max(last, now);
  }
}

void wait_well(const Recorder& recorder, const std::string& who) {
  while (busy_us(recorder, who) > 0) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

Config one_robot(const tacho::test::TempDir& dir) {
  Config config = config_for(dir / "log", {{closed_port(), closed_port()}});
  config.robots[0].settings.period_us = {20'000, 0, 0, 0};
  return config;
}

}  // namespace

TEST_CASE("a writer that does not come back from one row is seen, and so is that it has come back") {
  const tacho::test::TempDir dir;
  std::atomic<bool> hang{true};
  Recorder::Options options;
  options.notice = [&hang](const std::string&) {  // called by the writer: the link is lost
    while (hang) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  };
  Recorder recorder(one_robot(dir), std::move(options));
  wait_hanging(recorder, "the writer");
  hang = false;
  wait_well(recorder, "the writer");
  recorder.finish();
}

TEST_CASE("a poller that does not come back from one poll is seen, and so is that it has come back") {
  const tacho::test::TempDir dir;
  std::atomic<bool> hang{true};
  Recorder::Options options;
  options.make = [&hang](const RobotConfig&, Protocol) { return std::make_unique<HangingLink>(hang); };
  Recorder recorder(one_robot(dir), std::move(options));
  wait_hanging(recorder, "r1: status port");
  hang = false;
  wait_well(recorder, "r1: status port");
  recorder.finish();
}

TEST_CASE("the service manager hears readiness, status, reload and end as sd_notify(3) writes them") {
  NotifySocket socket;
  const Variable address("NOTIFY_SOCKET", socket.address());
  const Notifier notifier;
  notifier.ready();
  notifier.status("robots 3/3");
  notifier.reloading();
  notifier.stopping();
  const auto heard = socket.take();
  REQUIRE(heard.size() == 4);
  CHECK(heard[0] == "READY=1");
  CHECK(heard[1] == "STATUS=robots 3/3");
  CHECK(heard[2].rfind("RELOADING=1\nMONOTONIC_USEC=", 0) == 0);
  CHECK(heard[3] == "STOPPING=1");
}

TEST_CASE("a socket without a file is reached, too") {
  NotifySocket socket(true);
  const Variable address("NOTIFY_SOCKET", socket.address());
  Notifier().ready();
  CHECK(socket.take() == std::vector<std::string>{"READY=1"});
}

TEST_CASE("the watchdog is fed every third of its time, and not at all when it is not meant for this process") {
  NotifySocket socket;
  const Variable address("NOTIFY_SOCKET", socket.address());
  CHECK_FALSE(Notifier().watchdog_us());
  const Variable time("WATCHDOG_USEC", "3000000");
  {
    Notifier notifier;
    for (Micros now = 5'000'000; now < 8'000'000; now += 100'000) {
      notifier.alive(now);
    }
    CHECK(socket.take() == std::vector<std::string>(3, "WATCHDOG=1"));
  }
  const Variable other("WATCHDOG_PID", "1");
  Notifier notifier;
  notifier.alive(5'000'000);
  CHECK(socket.take().empty());
}

TEST_CASE("without a service manager nothing is sent and nothing fails") {
  Notifier notifier;
  notifier.ready();
  notifier.alive(1);
  const Variable address("NOTIFY_SOCKET", "/nowhere/at/all");
  Notifier().ready();
}

TEST_CASE("a thread is stuck when one step takes longer than it can, and the worst is named") {
  CHECK(stuck({}).empty());
  CHECK(stuck(std::vector<Beat>{{"the writer", kWriterMayTake, kWriterMayTake}}).empty());
  CHECK(stuck(std::vector<Beat>{{"amr-1: modbus", 3'000'000, 2'000'000}, {"the writer", 9'000'000, 1'000'000}}) ==
        "the writer has been at one step for 9.0 s");
}

TEST_CASE("a sleeping thread is well however long it sleeps; one that does not come back is busy") {
  HostClock clock;
  CHECK(clock.busy_us() == 0);  // has not begun
  CHECK(clock.sleep_until(mono_now_us() - 5'000'000));
  const Micros first = clock.busy_us();
  CHECK(first >= 0);
  while (clock.busy_us() <= first) {
  }
  std::thread sleeper([&clock] { clock.sleep_until(mono_now_us() + 3'600'000'000); });
  while (clock.busy_us() > 0) {
  }
  clock.stop();
  sleeper.join();
}
