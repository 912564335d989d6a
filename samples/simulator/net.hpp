#pragma once
// Small helpers on TCP sockets, shared by the two servers of a robot.

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>

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

}  // namespace tacho::sim
