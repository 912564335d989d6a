#pragma once
// TCP sockets, and the loop that the two servers of a robot share.

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

namespace tacho::sim {

/// Owns a file descriptor.
class Descriptor {
 public:
  Descriptor() = default;
  explicit Descriptor(int fd) : fd_(fd) {}
  ~Descriptor() { reset(); }
  Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    if (this != &other) {
      reset();
      fd_ = std::exchange(other.fd_, -1);
    }
    return *this;
  }
  void reset();
  [[nodiscard]] int get() const { return fd_; }
  [[nodiscard]] bool open() const { return fd_ >= 0; }

 private:
  int fd_ = -1;
};

/// Listens on bind:port (0 = any free one). Throws Error naming the address.
Descriptor listen_on(const std::string& bind, std::uint16_t port);
std::uint16_t port_of(const Descriptor& listener);
/// Accepts one waiting client, without blocking; closed when there is none. Sending to it gives up after a second.
Descriptor accept_client(const Descriptor& listener);
/// False when the peer is gone or does not read.
bool send_all(const Descriptor& socket, std::string_view bytes);

/// Wakes a thread that polls.
class Wakeup {
 public:
  Wakeup();
  void signal();
  [[nodiscard]] int fd() const { return event_.get(); }

 private:
  Descriptor event_;
};

/// Accepts clients and serves them, on one thread from construction to destruction.
class ClientLoop {
 public:
  /// Called when a client has sent something or has gone; false when the connection is over.
  using Serve = std::function<bool(const Descriptor& socket)>;
  /// Called for a new client with the number of those already there; an empty answer sends it away.
  using Welcome = std::function<Serve(const Descriptor& socket, std::size_t clients)>;

  ClientLoop(Descriptor listener, Welcome welcome);
  ~ClientLoop();
  ClientLoop(const ClientLoop&) = delete;
  ClientLoop& operator=(const ClientLoop&) = delete;

 private:
  struct Client {
    Descriptor socket;
    Serve serve;
  };

  Descriptor listener_;
  Welcome welcome_;
  Wakeup stop_;
  std::vector<Client> clients_;
  std::jthread thread_;  // last: joined before the rest goes

  void run();
  void accept_one();
};

}  // namespace tacho::sim
