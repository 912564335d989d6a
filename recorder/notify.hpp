#pragma once
// Talks to the service manager as sd_notify(3) describes: a datagram to the socket named in NOTIFY_SOCKET. Ours rather
// than libsystemd's: it is one sendto(), and a build without the library would time out under a unit of Type=notify.

#include <optional>
#include <string>
#include <string_view>

#include "schema/sample.hpp"

namespace tacho::recorder {

class Notifier {
 public:
  /// Reads NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID of the environment. Without the first nothing is ever sent.
  Notifier();
  ~Notifier();
  Notifier(const Notifier&) = delete;
  Notifier& operator=(const Notifier&) = delete;

  void ready() const { tell("READY=1"); }
  /// A sentence for `systemctl status`.
  void status(std::string_view text) const;
  /// Before a configuration is read again; ready() ends it.
  void reloading() const;
  void stopping() const { tell("STOPPING=1"); }
  /// Once per tick while all is well. Sends when a third of the watchdog's time has passed.
  void alive(Micros mono_us);
  /// How long the service manager waits for a sign of life; empty: it does not.
  [[nodiscard]] std::optional<Micros> watchdog_us() const { return watchdog_us_; }

 private:
  void tell(std::string_view text) const;
  std::string address_;  // of the socket; a leading '@' is replaced by NUL
  int socket_ = -1;
  std::optional<Micros> watchdog_us_;
  Micros next_us_ = 0;
};

}  // namespace tacho::recorder
