#pragma once
// A TCP client socket all of whose calls have a deadline. Both links connect, send and receive here, and nothing else
// in the recorder sends to a robot.

#include <cstddef>
#include <cstdint>
#include <mutex>
#include <span>
#include <string>
#include <string_view>

#include "recorder/link/resolver.hpp"
#include "schema/records.hpp"

namespace tacho::recorder {

/// Milliseconds from now until a monotonic deadline, rounded up, never negative: an argument for poll(2).
int remaining_ms(Micros deadline_us);

/// Deadline of the next attempt when the time until `deadline_us` is shared evenly by `left` addresses (at least 1): an
/// address that never answers leaves the others their share, one that fails at once leaves them all of its own.
[[nodiscard]] Micros attempt_deadline(Micros now_us, Micros deadline_us, std::size_t left);

struct Failure {
  bool failed = false;
  Cause cause = Cause::connect_refused;
  std::string detail;  ///< the system's words and what to look at; empty when nothing failed
};

struct Received {
  Failure failure;
  std::string_view bytes;  ///< in the caller's buffer; at least one when nothing failed
};

/// One owner thread; only interrupt() may be called from another.
class Socket {
 public:
  /// `lookup`: Resolver.
  Socket(std::string host, std::uint16_t port, Resolver::Lookup lookup = {});
  ~Socket();
  Socket(const Socket&) = delete;
  Socket& operator=(const Socket&) = delete;

  /// Connects until `deadline_us` (monotonic). A host name is looked up again before every attempt. Of several
  /// addresses each gets its share of the time: attempt_deadline(). A silent one is tried twice in it, because the
  /// kernel repeats a lost SYN only after a second, and a robot that has just come back should not be missed by that.
  Failure connect(Micros deadline_us);
  /// The same to addresses that are resolved already, in their order.
  Failure connect(const addrinfo* addresses, Micros deadline_us);
  [[nodiscard]] bool connected() const { return fd_ >= 0; }
  /// Sends all of it, or fails with `timeout` at the deadline or `closed`.
  Failure send(std::string_view bytes, Micros deadline_us);
  /// Waits for some bytes. Fails with `timeout` at the deadline, however many bytes keep coming, or with `closed`.
  Received receive(std::span<char> buffer, Micros deadline_us);
  void close();
  void interrupt();
  [[nodiscard]] bool interrupted() const;
  [[nodiscard]] std::string address() const;  ///< "host:port"
  /// Numeric address of the peer once connected, "" before.
  [[nodiscard]] const std::string& peer() const { return peer_; }

  enum class Idle { ok, closed, unexpected_bytes };
  /// What an idle connection holds: nothing, an end of file, or bytes nobody asked for.
  [[nodiscard]] Idle idle() const;

 private:
  bool adopt(int fd);
  [[nodiscard]] bool wait(short events, Micros deadline_us) const;
  Failure try_address(const addrinfo& address, Micros deadline_us);
  Failure attempt(const addrinfo& address, Micros deadline_us);

  std::string host_;
  std::uint16_t port_;
  Resolver resolver_;
  std::string peer_;
  int fd_ = -1;               // written under mutex_, read freely by the owner thread
  mutable std::mutex mutex_;  // between owner and interrupt()
  bool interrupted_ = false;
};

}  // namespace tacho::recorder
