#pragma once
// The Robokit status port (19204) of one simulated robot, as FIELD-FACTS of real robots have it: sequence echoed,
// request number in reserved bytes 10-11, error frames 60001 and 60002, one 19204 frame with ret_code 61001 for a
// client too many, silent disconnect on a malformed header or a request over 10 MB.

#include "samples/simulator/link_faults.hpp"
#include "samples/simulator/live_robot.hpp"
#include "samples/simulator/net.hpp"
#include "schema/wire/frame.hpp"

namespace tacho::sim {

/// Answers from construction to destruction.
class StatusServer {
 public:
  /// `robot` and `faults` must outlive it.
  StatusServer(LiveRobot& robot, const FaultPlan& faults, Listener listener, int max_clients);

 private:
  /// What is known of one client.
  struct Client {
    wire::FrameDecoder decoder;
    std::string previous;  // answer
    int answers = 0;
  };
  LiveRobot& robot_;
  const FaultPlan& faults_;
  int max_clients_;
  ClientLoop loop_;

  ClientLoop::Serve welcome(std::size_t clients, Script& out);
  bool serve(const Descriptor& socket, Client& client, Script& out);
  [[nodiscard]] std::string answer(const wire::Frame& request);
};

}  // namespace tacho::sim
