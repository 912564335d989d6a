#pragma once
// The Robokit status port (19204) of one simulated robot, as FIELD-FACTS of real robots have it: sequence echoed,
// request number in reserved bytes 10-11, error frames 60001 and 60002, one 19204 frame with ret_code 61001 for a
// client too many, silent disconnect on a malformed header or a request over 10 MB.

#include "samples/simulator/live_robot.hpp"
#include "samples/simulator/net.hpp"
#include "schema/wire/frame.hpp"

namespace tacho::sim {

/// Answers from construction to destruction.
class StatusServer {
 public:
  StatusServer(LiveRobot& robot, Descriptor listener, int max_clients);

 private:
  LiveRobot& robot_;
  int max_clients_;
  ClientLoop loop_;

  ClientLoop::Serve welcome(const Descriptor& client, std::size_t clients);
  bool serve(const Descriptor& client, wire::FrameDecoder& decoder);
  bool answer(const Descriptor& client, const wire::Frame& request);
};

}  // namespace tacho::sim
