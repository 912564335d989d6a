#pragma once
// The Robokit status port (19204): requests 1100 (whole, or its pose alone) and 1013, nothing else.
//
// One connection, held. An answer is taken only when it is a frame of the expected type with the sequence number of the
// request; any other frame closes the connection, and so does a timeout (an error frame with the right number does not:
// a robot that refuses 1013 goes on answering 1100). A robot that answers with another number on three
// fresh connections in a row does not echo sequence numbers: the number is then not compared (answers cannot be
// mixed up, as every connection has at most one request under way), and an event says so. Three right numbers in a row
// end that.

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "recorder/link/link.hpp"
#include "recorder/link/link_memory.hpp"
#include "recorder/link/socket.hpp"
#include "schema/wire/frame.hpp"

namespace tacho::recorder {

struct TcpLinkOptions {
  std::string host;
  std::uint16_t port = 19204;
  std::uint8_t version = 1;                    ///< 1 for RBK 3.4, 2 for RBK 3.5; answers of any version are taken
  std::string status_body;                     ///< body of request 1100 (wire::status_request_body)
  std::shared_ptr<StatusHint> hint = nullptr;  ///< told every status answer; may be null
  std::string ring_body = {};                  ///< of request 1100 for the ring
};

class TcpLink final : public Link {
 public:
  explicit TcpLink(TcpLinkOptions options);

  /// `source`: status, io, pose or ring. A controller that answers pose with everything it knows is not asked for it
  /// again: PollResult::give_up.
  PollResult poll(Source source, std::chrono::milliseconds timeout) override;
  [[nodiscard]] bool connected() const override { return socket_.connected(); }
  void close() override;
  void interrupt() override { socket_.interrupt(); }
  [[nodiscard]] bool echoes_sequence() const { return echoes_; }

 private:
  Failure ready(Micros deadline_us);
  Failure receive(wire::Frame& frame, Micros deadline_us);
  [[nodiscard]] std::string_view body_of(Source source) const;
  void judge(const wire::Frame& frame, bool first, Source source, PollResult& result);
  void judge_sequence(const wire::Frame& frame, bool first, PollResult& result);
  void note_error(const wire::Frame& frame, Source source, EventKind kind, PollResult& result);

  TcpLinkOptions options_;
  Socket socket_;
  wire::FrameDecoder decoder_;
  std::uint16_t sequence_ = 0;
  bool fresh_ = false;           // no answer yet on this connection
  int strange_connections_ = 0;  // fresh connections in a row whose first answer had another sequence number
  bool echoes_ = true;
  int matches_ = 0;  // answers in a row with the right number, counted while numbers are not compared
  std::array<std::string, kSourceCount> last_error_;  // so that a standing refusal is one event, not one per poll
};

}  // namespace tacho::recorder
