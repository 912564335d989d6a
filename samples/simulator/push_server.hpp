#pragma once
// The Robokit push port (19301) of one simulated robot: every client gets everything the robot says, unasked, in the
// shape of a push. What clients send is read and not heeded.

#include <chrono>

#include "samples/simulator/link_faults.hpp"
#include "samples/simulator/live_robot.hpp"
#include "samples/simulator/net.hpp"

namespace tacho::sim {

/// Pushes from construction to destruction.
class PushServer {
 public:
  /// `robot` and `faults` must outlive it.
  PushServer(LiveRobot& robot, const FaultPlan& faults, Listener listener, std::chrono::microseconds period);

 private:
  Script push();

  LiveRobot& robot_;
  const FaultPlan& faults_;
  std::string previous_;
  int pushes_ = 0;
  ClientLoop loop_;  // last: its thread uses the rest
};

}  // namespace tacho::sim
