#pragma once
// A server on 127.0.0.1 whose every connection is a piece of test code, run one after the other in one thread.

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <stdexcept>
#include <string>
#include <thread>

namespace tacho::recorder::test {

/// One accepted connection; closed when the handler returns.
class Peer {
 public:
  Peer(int fd, const std::atomic<bool>& stop) : fd_(fd), stop_(stop) {}
  /// Reads exactly `count` bytes; fewer when the client goes away or the server stops.
  std::string read(std::size_t count) {
    std::string out;
    while (out.size() < count && wait()) {
      char buffer[4096];
      const ssize_t n = ::recv(fd_, buffer, std::min(sizeof(buffer), count - out.size()), 0);
      if (n <= 0) {
        break;
      }
      out.append(buffer, static_cast<std::size_t>(n));
    }
    return out;
  }
  void write(const std::string& bytes) {
    std::size_t done = 0;
    while (done < bytes.size()) {
      const ssize_t n = ::send(fd_, bytes.data() + done, bytes.size() - done, MSG_NOSIGNAL);
      if (n <= 0) {
        return;
      }
      done += static_cast<std::size_t>(n);
    }
  }
  /// Waits until the client has closed (or the server stops).
  void wait_closed() {
    while (!read(1).empty()) {
    }
  }
  [[nodiscard]] int fd() const { return fd_; }
  /// False once the client has closed or the server stops; bytes that wait to be read count as life.
  [[nodiscard]] bool alive() const {
    char byte = 0;
    return !stop_ && ::recv(fd_, &byte, 1, MSG_PEEK | MSG_DONTWAIT) != 0;
  }

 private:
  bool wait() const {
    while (!stop_) {
      pollfd item{fd_, POLLIN, 0};
      if (::poll(&item, 1, 10) > 0) {
        return true;
      }
    }
    return false;
  }
  int fd_;
  const std::atomic<bool>& stop_;
};

class TinyServer {
 public:
  /// `handle(peer, n)`: n counts connections from 0.
  explicit TinyServer(std::function<void(Peer&, int)> handle, std::uint16_t port = 0) : handle_(std::move(handle)) {
    listener_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const int on = 1;
    ::setsockopt(listener_, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons(port);
    socklen_t size = sizeof(address);
    auto* const raw = reinterpret_cast<sockaddr*>(&address);
    if (::bind(listener_, raw, size) != 0 || ::listen(listener_, 8) != 0 || ::getsockname(listener_, raw, &size) != 0) {
      throw std::runtime_error("cannot listen on 127.0.0.1");
    }
    port_ = ntohs(address.sin_port);
    thread_ = std::thread([this] { serve(); });
  }
  ~TinyServer() {
    stop_ = true;
    thread_.join();
    ::close(listener_);
  }
  TinyServer(const TinyServer&) = delete;
  TinyServer& operator=(const TinyServer&) = delete;
  [[nodiscard]] std::uint16_t port() const { return port_; }
  [[nodiscard]] int connections() const { return connections_; }

 private:
  void serve() {
    while (!stop_) {
      pollfd item{listener_, POLLIN, 0};
      if (::poll(&item, 1, 10) <= 0) {
        continue;
      }
      const int fd = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
      if (fd >= 0) {
        Peer peer(fd, stop_);
        handle_(peer, connections_++);
        ::close(fd);
      }
    }
  }
  std::function<void(Peer&, int)> handle_;
  int listener_ = -1;
  std::uint16_t port_ = 0;
  std::atomic<bool> stop_{false};
  std::atomic<int> connections_{0};
  std::thread thread_;
};

/// A port on which nobody listens.
inline std::uint16_t closed_port() {
  return TinyServer([](Peer&, int) {}).port();
}

}  // namespace tacho::recorder::test
