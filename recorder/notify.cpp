#include "recorder/notify.hpp"

#include <fmt/format.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <charconv>
#include <cstddef>
#include <cstdlib>
#include <cstring>

#include "schema/time.hpp"

namespace tacho::recorder {

namespace {

std::optional<Micros> number_in(const char* variable) {
  const char* const text = std::getenv(variable);
  Micros value = 0;
  if (text == nullptr || std::from_chars(text, text + std::strlen(text), value).ec != std::errc{} || value <= 0) {
    return std::nullopt;
  }
  return value;
}

}  // namespace

Notifier::Notifier() {
  const char* const address = std::getenv("NOTIFY_SOCKET");
  if (address == nullptr || (address[0] != '/' && address[0] != '@') ||
      std::strlen(address) >= sizeof(sockaddr_un::sun_path)) {
    return;
  }
  address_ = address;
  if (address_[0] == '@') {
    address_[0] = '\0';  // a name without a file
  }
  socket_ = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  const std::optional<Micros> process = number_in("WATCHDOG_PID");
  if (!process || *process == getpid()) {
    watchdog_us_ = number_in("WATCHDOG_USEC");
  }
}

Notifier::~Notifier() {
  if (socket_ >= 0) {
    close(socket_);
  }
}

void Notifier::tell(std::string_view text) const {
  if (socket_ < 0) {
    return;
  }
  sockaddr_un to{};
  to.sun_family = AF_UNIX;
  std::memcpy(to.sun_path, address_.data(), address_.size());
  const std::size_t size = offsetof(sockaddr_un, sun_path) + address_.size();
  // A service manager that does not listen must not hold up a recording.
  (void)sendto(socket_, text.data(), text.size(), MSG_NOSIGNAL, reinterpret_cast<const sockaddr*>(&to),
               static_cast<socklen_t>(size));
}

void Notifier::status(std::string_view text) const { tell(fmt::format("STATUS={}", text)); }

void Notifier::reloading() const { tell(fmt::format("RELOADING=1\nMONOTONIC_USEC={}", mono_now_us())); }

void Notifier::alive(Micros mono_us) {
  if (watchdog_us_ && mono_us >= next_us_) {
    next_us_ = mono_us + *watchdog_us_ / 3;
    tell("WATCHDOG=1");
  }
}

}  // namespace tacho::recorder
