#pragma once
// The Robokit push port (19301), read and never written to: what a robot pushes, and how often, is set on the robot or
// by another client, and a request for other fields would change it for everybody.
//
// Nothing is asked, so nothing can be answered late: silence alone does not close the connection until it has lasted
// longer than the slowest push a robot can be set to (PublishInterval, 15 s). A frame of another type, or half a frame
// that does not go on, does.

#include <string>

#include "recorder/link/link.hpp"
#include "recorder/link/socket.hpp"
#include "schema/wire/frame.hpp"

namespace tacho::recorder {

class PushLink final : public Link {
 public:
  PushLink(std::string host, std::uint16_t port) : socket_(std::move(host), port) {}

  /// Waits for the next push; t_send_us is when it came, too.
  PollResult poll(Source source, std::chrono::milliseconds timeout) override;
  [[nodiscard]] bool connected() const override { return socket_.connected(); }
  void close() override;
  void interrupt() override { socket_.interrupt(); }

 private:
  Failure receive(wire::Frame& frame, Micros deadline_us);
  void judge(wire::Frame frame, PollResult& result);

  Socket socket_;
  wire::FrameDecoder decoder_;
  Micros silent_since_us_ = 0;  // monotonic
  bool cut_ = false;            // half a push stood at the last deadline
  std::string last_error_;      // so that a standing refusal is one event
};

}  // namespace tacho::recorder
