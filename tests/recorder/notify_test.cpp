// What the service manager is told, and when it is told nothing.

#include "recorder/notify.hpp"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>

#include "recorder/clock.hpp"
#include "recorder/health.hpp"
#include "schema/time.hpp"
#include "tests/recorder/notify_socket.hpp"
#include "tests/support/catch.hpp"

using namespace tacho;
using namespace tacho::recorder;
using tacho::recorder::test::NotifySocket;

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

}  // namespace

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
