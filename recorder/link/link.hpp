#pragma once
// One held connection to one robot by one protocol. A link never throws for what the robot or the network does: every
// outcome is a value. Not thread-safe, but for interrupt(); its poller owns it.

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "schema/records.hpp"
#include "schema/sample.hpp"

namespace tacho::recorder {

/// Something a link noticed, to become an event row. The poller adds robot, session, source, seq and time.
struct LinkNote {
  EventKind kind = EventKind::error_frame;
  std::string subject;
  std::string old_value;
  std::string new_value;
  std::string detail;
};

/// Outcome of one poll. `ok`: `body` is the answer (for registers, an image; `partial` tells which ranges are missing).
struct PollResult {
  bool ok = false;
  Cause cause = Cause::timeout;  ///< why not, when !ok or partial
  bool partial = false;
  std::string detail;  ///< words for the gap row: system error, robot's error text, exception, ranges
  std::string body;
  std::string header;    ///< unusual frame header, else empty
  Micros t_send_us = 0;  ///< both by the wall clock that stood at the answer
  Micros t_recv_us = 0;
  std::vector<LinkNote> notes;
  std::optional<WordOrder> word_order;  ///< set when the link has just decided on one
  std::string give_up;                  ///< non-empty: why this source must not be asked again
};

class Link {
 public:
  virtual ~Link() = default;
  /// Connects when not connected, asks, waits at most until the deadline. After any timeout or malformed answer the
  /// connection is closed before returning, so that a late answer can never be taken for the next one.
  virtual PollResult poll(Source source, std::chrono::milliseconds timeout) = 0;
  [[nodiscard]] virtual bool connected() const = 0;
  virtual void close() = 0;
  /// From any thread: ends a poll() in progress at once and makes later ones fail. For shutting down.
  virtual void interrupt() = 0;
};

}  // namespace tacho::recorder
