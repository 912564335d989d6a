// Connecting to a host that has several addresses. All of 127.0.0.0/8 is this machine, so two of them make such a host
// without a name server.

#include "recorder/link/socket.hpp"

#include <netdb.h>
#include <netinet/in.h>

#include <deque>

#include "schema/time.hpp"
#include "tests/recorder/tiny_server.hpp"
#include "tests/support/catch.hpp"

using namespace tacho;
using namespace tacho::recorder;
using namespace tacho::recorder::test;

namespace {

/// What getaddrinfo would give for a host with these IPv4 addresses.
class Addresses {
 public:
  Addresses(std::initializer_list<in_addr_t> hosts, std::uint16_t port) {
    for (const in_addr_t host : hosts) {
      Item& item = items_.emplace_back();
      item.address.sin_family = AF_INET;
      item.address.sin_addr.s_addr = htonl(host);
      item.address.sin_port = htons(port);
      item.info.ai_family = AF_INET;
      item.info.ai_socktype = SOCK_STREAM;
      item.info.ai_addrlen = sizeof(item.address);
      item.info.ai_addr = reinterpret_cast<sockaddr*>(&item.address);
    }
    for (std::size_t i = 1; i < items_.size(); ++i) {
      items_[i - 1].info.ai_next = &items_[i].info;
    }
  }
  [[nodiscard]] const addrinfo* list() const { return &items_.front().info; }

 private:
  struct Item {
    sockaddr_in address{};
    addrinfo info{};
  };
  std::deque<Item> items_;
};

constexpr in_addr_t kSilentHost = INADDR_LOOPBACK + 1;  // 127.0.0.2

/// Listens on 127.0.0.2 and never answers: its queue of waiting connections is kept full, and Linux then drops what
/// asks for another one.
class SilentHost {
 public:
  explicit SilentHost(std::uint16_t port) : listener_(bound(port)) {
    for (int& client : clients_) {
      client = ::socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
      const sockaddr_in address = at(port);
      ::connect(client, reinterpret_cast<const sockaddr*>(&address), sizeof(address));
    }
  }
  ~SilentHost() {
    for (const int client : clients_) {
      ::close(client);
    }
    ::close(listener_);
  }
  SilentHost(const SilentHost&) = delete;
  SilentHost& operator=(const SilentHost&) = delete;

 private:
  int listener_;
  std::array<int, 4> clients_{};

  static sockaddr_in at(std::uint16_t port) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(kSilentHost);
    address.sin_port = htons(port);
    return address;
  }
  static int bound(std::uint16_t port) {
    const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const int on = 1;
    ::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
    const sockaddr_in address = at(port);
    if (::bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0 || ::listen(fd, 0) != 0) {
      throw std::runtime_error("cannot listen on 127.0.0.2");
    }
    return fd;
  }
};

}  // namespace

TEST_CASE("the time left is shared evenly by the addresses left") {
  CHECK(attempt_deadline(100, 1000, 1) == 1000);
  CHECK(attempt_deadline(100, 1000, 3) == 400);
  CHECK(attempt_deadline(400, 1000, 2) == 700);  // the first of three used its share up
  CHECK(attempt_deadline(110, 1000, 2) == 555);  // the first of three failed at once
}

TEST_CASE("past the deadline no address gets more time") {
  CHECK(attempt_deadline(1000, 1000, 2) == 1000);
  CHECK(attempt_deadline(1500, 1000, 2) == 1000);
}

TEST_CASE("a first address that never answers leaves the second its share of the time") {
  TinyServer server([](Peer& peer, int) { peer.wait_closed(); });
  const SilentHost silent(server.port());
  const Addresses addresses({kSilentHost, INADDR_LOOPBACK}, server.port());
  Socket socket("robot", server.port());
  const Micros start = mono_now_us();
  const Failure failure = socket.connect(addresses.list(), start + 800'000);
  const Micros spent = mono_now_us() - start;
  INFO(failure.detail);
  REQUIRE_FALSE(failure.failed);
  CHECK(socket.peer() == "127.0.0.1");
  CHECK(spent >= 400'000);  // half of it was the silent address's
  CHECK(spent < 800'000);   // connected in time
}

TEST_CASE("a host all of whose addresses are silent fails at the deadline, not after it") {
  const std::uint16_t port = closed_port();
  const SilentHost silent(port);
  const Addresses addresses({kSilentHost, kSilentHost}, port);
  Socket socket("robot", port);
  const Micros start = mono_now_us();
  const Failure failure = socket.connect(addresses.list(), start + 200'000);
  const Micros spent = mono_now_us() - start;
  CHECK(failure.failed);
  CHECK(failure.cause == Cause::connect_timeout);
  CHECK(spent >= 200'000);
  CHECK(spent < 2'000'000);  // the machine may be busy
}
