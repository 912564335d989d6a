// Names of robots, while their name server is quick, slow, dead or wrong.

#include "recorder/link/resolver.hpp"

#include <netdb.h>

#include <atomic>
#include <deque>
#include <thread>

#include "recorder/link/socket.hpp"
#include "schema/time.hpp"
#include "tests/recorder/tiny_server.hpp"
#include "tests/support/catch.hpp"

using namespace tacho;
using namespace tacho::recorder;
using namespace tacho::recorder::test;
using namespace std::chrono_literals;

namespace {

Resolver::Answer loopback(const std::string&, std::uint16_t port) {
  addrinfo* found = nullptr;
  const int error = ::getaddrinfo("127.0.0.1", std::to_string(port).c_str(), nullptr, &found);
  return {error, {found, ::freeaddrinfo}};
}

/// A name server as a test wants it; it is asked from other threads, and they may outlive the test.
struct NameServer {
  std::shared_ptr<std::atomic<int>> takes_ms = std::make_shared<std::atomic<int>>(0);
  std::shared_ptr<std::atomic<int>> error = std::make_shared<std::atomic<int>>(0);
  std::shared_ptr<std::atomic<int>> asked = std::make_shared<std::atomic<int>>(0);

  [[nodiscard]] Resolver::Lookup lookup() const {
    return [*this](const std::string& host, std::uint16_t port) {
      ++*asked;
      std::this_thread::sleep_for(std::chrono::milliseconds(takes_ms->load()));
      return *error != 0 ? Resolver::Answer{error->load(), {}} : loopback(host, port);
    };
  }
};

}  // namespace

TEST_CASE("an address is not looked up, and a name that is none says so") {
  CHECK(Resolver("127.0.0.1", 502).find(0).addresses);
  CHECK(Resolver("::1", 502).find(0).addresses);
  NameServer names;
  *names.error = EAI_NONAME;
  Resolver unknown("robto-1", 502, names.lookup());
  const Resolver::Found found = unknown.find(mono_now_us() + 2'000'000);
  CHECK_FALSE(found.addresses);
  CHECK(found.problem.find("is the name right") != std::string::npos);
}

TEST_CASE("a name server that does not answer costs the deadline and no more, also at the end") {
  NameServer names;
  *names.takes_ms = 1500;
  const Micros start = mono_now_us();
  {
    Resolver resolver("robot-1", 502, names.lookup());
    const Resolver::Found found = resolver.find(start + 100'000);
    CHECK_FALSE(found.addresses);
    CHECK(found.problem.find("no name server answers") == 0);
    CHECK_FALSE(resolver.find(mono_now_us() + 100'000).addresses);
    CHECK(*names.asked == 1);  // one question at a time
  }
  CHECK(mono_now_us() - start < 1'000'000);
}

TEST_CASE("an answer that came too late serves the next attempt") {
  NameServer names;
  *names.takes_ms = 200;
  Resolver resolver("robot-1", 502, names.lookup());
  CHECK_FALSE(resolver.find(mono_now_us() + 20'000).addresses);
  std::this_thread::sleep_for(400ms);
  CHECK(resolver.find(mono_now_us()).addresses);
  CHECK(*names.asked == 1);
}

TEST_CASE("while no name server answers the addresses found last stand, and time is left to connect to them") {
  NameServer names;
  TinyServer server([](Peer& peer, int) { peer.wait_closed(); });
  Socket socket("robot-1", server.port(), names.lookup());
  CHECK_FALSE(socket.connect(mono_now_us() + 2'000'000).failed);
  *names.error = EAI_AGAIN;
  CHECK_FALSE(socket.connect(mono_now_us() + 2'000'000).failed);
  *names.takes_ms = 3000;
  const Micros start = mono_now_us();
  CHECK_FALSE(socket.connect(start + 600'000).failed);
  CHECK(mono_now_us() - start < 600'000);
}

TEST_CASE("a name that is taken back is not connected to any more") {
  NameServer names;
  TinyServer server([](Peer& peer, int) { peer.wait_closed(); });
  Socket socket("robot-1", server.port(), names.lookup());
  CHECK_FALSE(socket.connect(mono_now_us() + 2'000'000).failed);
  *names.error = EAI_NONAME;
  const Failure failure = socket.connect(mono_now_us() + 2'000'000);
  CHECK(failure.failed);
  CHECK(failure.cause == Cause::unreachable);
}

TEST_CASE("interrupting ends the wait for a name server") {
  NameServer names;
  *names.takes_ms = 2000;
  Socket socket("robot-1", 502, names.lookup());
  std::thread stopper([&] {
    std::this_thread::sleep_for(50ms);
    socket.interrupt();
  });
  const Micros start = mono_now_us();
  CHECK(socket.connect(start + 5'000'000).cause == Cause::shutdown);
  CHECK(mono_now_us() - start < 1'500'000);
  stopper.join();
}
