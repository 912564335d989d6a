#include "samples/simulator/net.hpp"

#include <arpa/inet.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

#include "schema/error.hpp"

namespace tacho::sim {

void Descriptor::reset() {
  if (fd_ >= 0) {
    ::close(std::exchange(fd_, -1));
  }
}

namespace {

std::string what(const std::string& bind, std::uint16_t port) {
  return "cannot listen on " + bind + ":" + std::to_string(port);
}

// Several sockets of one process may be bound to a port as long as at most one of them listens.
Descriptor bound(const std::string& bind, std::uint16_t port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  if (inet_pton(AF_INET, bind.c_str(), &address.sin_addr) != 1) {
    throw Error(what(bind, port), "not an IPv4 address", "for example 127.0.0.1, or 0.0.0.0 for all");
  }
  Descriptor socket(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  const int on = 1;
  ::setsockopt(socket.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  if (!socket.open() || ::bind(socket.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    throw Error(what(bind, port), std::strerror(errno), "choose another port, or 0 for any free one");
  }
  return socket;
}

std::uint16_t port_of(const Descriptor& socket) {
  sockaddr_in address{};
  socklen_t size = sizeof address;
  ::getsockname(socket.get(), reinterpret_cast<sockaddr*>(&address), &size);
  return ntohs(address.sin_port);
}

}  // namespace

Listener::Listener(const std::string& bind, std::uint16_t port) : bind_(bind), port_(port), held_(bound(bind, port)) {
  port_ = port_of(held_);
  listen();
}

void Listener::listen() {
  socket_ = bound(bind_, port_);
  if (::listen(socket_.get(), 16) != 0) {
    socket_.reset();
    throw Error(what(bind_, port_), std::strerror(errno), "choose another port, or 0 for any free one");
  }
}

Descriptor accept_client(const Descriptor& listener) {
  Descriptor socket(::accept4(listener.get(), nullptr, nullptr, SOCK_CLOEXEC));
  if (socket.open()) {
    const int on = 1;
    ::setsockopt(socket.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    const timeval patience{1, 0};
    ::setsockopt(socket.get(), SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
  }
  return socket;
}

bool send_all(const Descriptor& socket, std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t sent = ::send(socket.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (sent < 0 && errno == EINTR) {
      continue;
    }
    if (sent <= 0) {
      return false;
    }
    bytes.remove_prefix(static_cast<std::size_t>(sent));
  }
  return true;
}

Wakeup::Wakeup() : event_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {}

void Wakeup::signal() {
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t written = ::write(event_.get(), &one, sizeof one);
}

namespace {

constexpr int kOpenCheckMs = 5;

void reset_connection(const Descriptor& socket) {
  const linger now{1, 0};
  ::setsockopt(socket.get(), SOL_SOCKET, SO_LINGER, &now, sizeof now);
}

// False when the connection is over.
bool take_step(const Action& step, const Descriptor& socket) {
  switch (step.kind) {
    case Action::Kind::send:
      return send_all(socket, step.bytes);
    case Action::Kind::half_close:
      ::shutdown(socket.get(), SHUT_WR);
      return true;
    case Action::Kind::reset:
      reset_connection(socket);
      return false;
    case Action::Kind::close:
      return false;
  }
  return false;
}

}  // namespace

ClientLoop::ClientLoop(Listener listener, Welcome welcome, Open open, Repeat repeat)
    : listener_(std::move(listener)),
      welcome_(std::move(welcome)),
      open_(std::move(open)),
      repeat_(std::move(repeat)),
      thread_([this] { run(); }) {}

ClientLoop::~ClientLoop() { stop_.signal(); }

void ClientLoop::append(Script script, Client& client) {
  Clock::time_point at = client.steps.empty() ? Clock::now() : std::max(Clock::now(), client.steps.back().at);
  for (Action& step : script) {
    at += step.after;
    client.steps.push_back({std::move(step), at});
  }
}

// Does what is due; false when the connection is over.
bool ClientLoop::act(Client& client) {
  while (!client.steps.empty() && client.steps.front().at <= Clock::now()) {
    if (!take_step(client.steps.front().step, client.socket)) {
      return false;
    }
    client.steps.pop_front();
  }
  return true;
}

int ClientLoop::patience_ms() const {
  Clock::duration least = std::chrono::hours(1);
  for (const Client& client : clients_) {
    if (!client.steps.empty()) {
      least = std::min(least, std::max(Clock::duration::zero(), client.steps.front().at - Clock::now()));
    }
  }
  if (repeat_.make) {
    least = std::min(least, std::max(Clock::duration::zero(), repeat_at_ - Clock::now()));
  }
  const auto ms = static_cast<int>(std::chrono::ceil<std::chrono::milliseconds>(least).count());
  return open_ ? std::min(ms, kOpenCheckMs) : ms;
}

void ClientLoop::open_or_refuse() {
  if (!open_ || open_() == listener_.listens()) {
    return;
  }
  if (listener_.listens()) {
    listener_.refuse();
    clients_.clear();
  } else {
    listener_.listen();
  }
}

void ClientLoop::run() {
  std::vector<pollfd> fds;
  while (true) {
    open_or_refuse();
    fds.assign({{stop_.fd(), POLLIN, 0}, {listener_.socket().get(), POLLIN, 0}});
    for (const Client& client : clients_) {
      fds.push_back({client.socket.get(), POLLIN, 0});
    }
    if (::poll(fds.data(), fds.size(), patience_ms()) < 0 && errno != EINTR) {
      return;
    }
    if (fds[0].revents != 0) {
      return;
    }
    repeat();
    for (std::size_t i = clients_.size(); i-- > 0;) {
      Client& client = clients_[i];
      Script script;
      const bool lives = fds[i + 2].revents == 0 || client.serve(client.socket, script);
      append(std::move(script), client);
      if (!lives || !act(client)) {
        clients_.erase(clients_.begin() + static_cast<std::ptrdiff_t>(i));
      }
    }
    if (fds[1].revents != 0) {
      accept_one();
    }
  }
}

void ClientLoop::repeat() {
  if (!repeat_.make || Clock::now() < repeat_at_) {
    return;
  }
  repeat_at_ += repeat_.period;
  const Script script = repeat_.make();
  for (Client& client : clients_) {
    append(script, client);
  }
}

void ClientLoop::accept_one() {
  Descriptor socket = accept_client(listener_.socket());
  if (!socket.open()) {
    return;
  }
  Script script;
  Client client{std::move(socket), welcome_(clients_.size(), script), {}};
  append(std::move(script), client);
  if (act(client)) {
    clients_.push_back(std::move(client));
  }
}

bool ignore_client(const Descriptor& socket, Script&) {
  std::array<char, 4096> buffer;
  const ssize_t got = ::recv(socket.get(), buffer.data(), buffer.size(), MSG_DONTWAIT);
  return got > 0 || (got < 0 && (errno == EAGAIN || errno == EINTR));
}

}  // namespace tacho::sim
