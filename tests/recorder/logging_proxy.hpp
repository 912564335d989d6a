#pragma once
// Stands between the recorder and a robot's port, passes everything on, and keeps what the recorder sent.

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>

#include <array>
#include <cerrno>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "samples/simulator/net.hpp"

namespace tacho::recorder::test {

class LoggingProxy {
 public:
  explicit LoggingProxy(std::uint16_t robot_port) : robot_port_(robot_port), thread_([this] { run(); }) {}
  ~LoggingProxy() { stop_.signal(); }
  LoggingProxy(const LoggingProxy&) = delete;
  LoggingProxy& operator=(const LoggingProxy&) = delete;

  [[nodiscard]] std::uint16_t port() const { return listener_.port(); }
  /// What was sent to the robot, per connection.
  [[nodiscard]] std::vector<std::string> sent() const {
    const std::lock_guard lock(mutex_);
    return sent_;
  }

 private:
  struct Pair {
    sim::Descriptor client;
    sim::Descriptor robot;
    std::size_t log;
  };

  void run() {
    std::vector<pollfd> fds;
    while (true) {
      fds.assign({{stop_.fd(), POLLIN, 0}, {listener_.socket().get(), POLLIN, 0}});
      for (const Pair& pair : pairs_) {
        fds.push_back({pair.client.get(), POLLIN, 0});
        fds.push_back({pair.robot.get(), POLLIN, 0});
      }
      if ((::poll(fds.data(), fds.size(), -1) < 0 && errno != EINTR) || fds[0].revents != 0) {
        return;
      }
      for (std::size_t i = pairs_.size(); i-- > 0;) {
        const bool up = fds[2 + 2 * i].revents == 0 || pass(pairs_[i].client, pairs_[i].robot, &pairs_[i]);
        const bool down = fds[3 + 2 * i].revents == 0 || pass(pairs_[i].robot, pairs_[i].client, nullptr);
        if (!up || !down) {
          pairs_.erase(pairs_.begin() + static_cast<std::ptrdiff_t>(i));
        }
      }
      if (fds[1].revents != 0) {
        accept_one();
      }
    }
  }

  /// False when either end is gone.
  bool pass(const sim::Descriptor& from, const sim::Descriptor& to, const Pair* logged) {
    std::array<char, 16384> buffer;
    const ssize_t got = ::recv(from.get(), buffer.data(), buffer.size(), MSG_DONTWAIT);
    if (got <= 0) {
      return got < 0 && (errno == EAGAIN || errno == EINTR);
    }
    const std::string_view bytes(buffer.data(), static_cast<std::size_t>(got));
    if (logged != nullptr) {
      const std::lock_guard lock(mutex_);
      sent_[logged->log] += bytes;
    }
    return sim::send_all(to, bytes);
  }

  void accept_one() {
    sim::Descriptor client = sim::accept_client(listener_.socket());
    sim::Descriptor robot(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(robot_port_);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (::connect(robot.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
      return;
    }
    const std::lock_guard lock(mutex_);
    sent_.emplace_back();
    pairs_.push_back({std::move(client), std::move(robot), sent_.size() - 1});
  }

  std::uint16_t robot_port_;
  sim::Listener listener_{"127.0.0.1", 0};
  sim::Wakeup stop_;
  std::vector<Pair> pairs_;
  mutable std::mutex mutex_;  // sent_
  std::vector<std::string> sent_;
  std::jthread thread_;  // last: joined before the rest goes
};

}  // namespace tacho::recorder::test
