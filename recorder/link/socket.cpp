#include "recorder/link/socket.hpp"

#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <system_error>
#include <utility>

#include "schema/time.hpp"

namespace tacho::recorder {

namespace {

constexpr Micros kFirstAttempt = 500'000;

bool would_block(int error) { return error == EAGAIN || error == EWOULDBLOCK || error == EINTR; }

std::string words(int error) { return std::generic_category().message(error); }

Failure failure(int error, const std::string& address) {
  switch (error) {
    case ECONNREFUSED:
      return {true, Cause::connect_refused,
              fmt::format("{}: connection refused; is the port right, and does the robot offer it?", address)};
    case ETIMEDOUT:
      return {true, Cause::connect_timeout,
              fmt::format("{}: no answer to the connection attempt; is the robot on and this host in its network?",
                          address)};
    case ENETUNREACH:
    case EHOSTUNREACH:
    case EHOSTDOWN:
    case ENETDOWN:
      return {true, Cause::unreachable,
              fmt::format("{}: {}; is the robot on and this host in its network?", address, words(error))};
    case ECONNRESET:
      return {true, Cause::closed, fmt::format("{}: closed by the robot while connecting", address)};
    case EMFILE:
    case ENFILE:
    case ENOBUFS:
    case ENOMEM:
      return {true, Cause::unreachable,
              fmt::format("{}: {}; this host is at its limit, not the robot (see LimitNOFILE)", address, words(error))};
    default:
      return {true, Cause::unreachable, fmt::format("{}: {}", address, words(error))};
  }
}

std::string numeric(const addrinfo& address) {
  char text[NI_MAXHOST] = {};
  if (getnameinfo(address.ai_addr, address.ai_addrlen, text, sizeof(text), nullptr, 0, NI_NUMERICHOST) != 0) {
    return {};
  }
  return text;
}

/// Robots drop dead peers by TCP keep-alive; so do we, and requests are single small packets that must not wait.
void set_options(int fd) {
  const int on = 1;
  const int idle_s = 10;
  const int interval_s = 5;
  const int probes = 3;
  setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
  setsockopt(fd, SOL_SOCKET, SO_KEEPALIVE, &on, sizeof(on));
  setsockopt(fd, IPPROTO_TCP, TCP_KEEPIDLE, &idle_s, sizeof(idle_s));
  setsockopt(fd, IPPROTO_TCP, TCP_KEEPINTVL, &interval_s, sizeof(interval_s));
  setsockopt(fd, IPPROTO_TCP, TCP_KEEPCNT, &probes, sizeof(probes));
}

}  // namespace

int remaining_ms(Micros deadline_us) {
  const Micros left = deadline_us - mono_now_us();
  return left <= 0 ? 0 : static_cast<int>(std::min<Micros>((left + 999) / 1000, 3'600'000));
}

Micros attempt_deadline(Micros now_us, Micros deadline_us, std::size_t left) {
  return deadline_us <= now_us ? deadline_us : now_us + (deadline_us - now_us) / static_cast<Micros>(left);
}

Socket::Socket(std::string host, std::uint16_t port, Resolver::Lookup lookup)
    : host_(std::move(host)), port_(port), resolver_(host_, port_, std::move(lookup)) {}

Socket::~Socket() { close(); }

std::string Socket::address() const {
  return host_.find(':') == std::string::npos ? fmt::format("{}:{}", host_, port_)
                                              : fmt::format("[{}]:{}", host_, port_);
}

bool Socket::adopt(int fd) {
  const std::lock_guard lock(mutex_);
  if (interrupted_) {
    ::close(fd);
    return false;
  }
  fd_ = fd;
  return true;
}

void Socket::close() {
  const std::lock_guard lock(mutex_);
  if (fd_ >= 0) {
    ::close(fd_);
    fd_ = -1;
  }
}

void Socket::interrupt() {
  {
    const std::lock_guard lock(mutex_);
    interrupted_ = true;
    if (fd_ >= 0) {
      ::shutdown(fd_, SHUT_RDWR);  // wakes poll(2) in the owner thread; the owner closes
    }
  }
  resolver_.interrupt();
}

bool Socket::interrupted() const {
  const std::lock_guard lock(mutex_);
  return interrupted_;
}

bool Socket::wait(short events, Micros deadline_us) const {
  pollfd item{fd_, events, 0};
  for (;;) {
    const int ready = ::poll(&item, 1, remaining_ms(deadline_us));
    if (ready >= 0 || errno != EINTR) {
      return ready != 0;  // an error of poll itself shows in the next call on the socket
    }
  }
}

Failure Socket::try_address(const addrinfo& address, Micros deadline_us) {
  const Micros now_us = mono_now_us();
  const Failure first = attempt(address, now_us + std::min(kFirstAttempt, (deadline_us - now_us) / 2));
  return first.cause == Cause::connect_timeout && first.failed ? attempt(address, deadline_us) : first;
}

Failure Socket::attempt(const addrinfo& address, Micros deadline_us) {
  const int fd = ::socket(address.ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (fd < 0) {
    return failure(errno, this->address());
  }
  if (!adopt(fd)) {
    return {true, Cause::shutdown, "stopping"};
  }
  set_options(fd);
  int error = ::connect(fd, address.ai_addr, address.ai_addrlen) == 0 ? 0 : errno;
  if (error == EINPROGRESS) {
    error = ETIMEDOUT;
    if (wait(POLLOUT, deadline_us)) {
      socklen_t size = sizeof(error);
      ::getsockopt(fd, SOL_SOCKET, SO_ERROR, &error, &size);
    }
  }
  if (error == 0 && interrupted()) {
    error = ECANCELED;
  }
  if (error != 0) {
    close();
    return failure(error, this->address());
  }
  peer_ = numeric(address);
  return {};
}

Failure Socket::connect(Micros deadline_us) {
  close();
  const Resolver::Found found = resolver_.find(deadline_us);
  if (interrupted()) {
    return {true, Cause::shutdown, "stopping"};
  }
  if (!found.addresses) {
    return {true, Cause::unreachable, fmt::format("{}: {}", address(), found.problem)};
  }
  return connect(found.addresses.get(), deadline_us);
}

Failure Socket::connect(const addrinfo* addresses, Micros deadline_us) {
  close();
  std::size_t left = 0;
  for (const addrinfo* item = addresses; item != nullptr; item = item->ai_next) {
    ++left;
  }
  Failure last{true, Cause::unreachable, address() + ": no address"};
  for (const addrinfo* item = addresses; item != nullptr; item = item->ai_next, --left) {
    last = try_address(*item, attempt_deadline(mono_now_us(), deadline_us, left));
    if (!last.failed || last.cause == Cause::shutdown) {
      break;
    }
  }
  if (last.failed && interrupted()) {
    return {true, Cause::shutdown, "stopping"};
  }
  return last;
}

Failure Socket::send(std::string_view bytes, Micros deadline_us) {
  while (!bytes.empty()) {
    const ssize_t n = ::send(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (n > 0) {
      bytes.remove_prefix(static_cast<std::size_t>(n));
    } else if (!would_block(errno)) {
      return {true, Cause::closed, fmt::format("{}: {}", address(), words(errno))};
    } else if (!wait(POLLOUT, deadline_us)) {
      return {true, Cause::timeout, fmt::format("{}: the request could not be sent in time", address())};
    }
  }
  return {};
}

Received Socket::receive(std::span<char> buffer, Micros deadline_us) {
  for (;;) {
    if (mono_now_us() >= deadline_us || !wait(POLLIN, deadline_us)) {
      return {{true, Cause::timeout, fmt::format("{}: no answer in time", address())}, {}};
    }
    const ssize_t n = ::recv(fd_, buffer.data(), buffer.size(), 0);
    if (n > 0) {
      return {{}, {buffer.data(), static_cast<std::size_t>(n)}};
    }
    if (n == 0 || !would_block(errno)) {
      return {{true, Cause::closed,
               fmt::format("{}: {}", address(), n == 0 ? std::string("closed by the robot") : words(errno))},
              {}};
    }
  }
}

Socket::Idle Socket::idle() const {
  char byte = 0;
  const ssize_t n = ::recv(fd_, &byte, 1, MSG_PEEK | MSG_DONTWAIT);
  if (n > 0) {
    return Idle::unexpected_bytes;
  }
  return n < 0 && would_block(errno) ? Idle::ok : Idle::closed;
}

}  // namespace tacho::recorder
