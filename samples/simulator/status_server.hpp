#pragma once
// The Robokit status port (19204) of one simulated robot, as FIELD-FACTS of real robots have it: sequence echoed,
// request number in reserved bytes 10-11, error frames 60001 and 60002, one 19204 frame with ret_code 61001 for a
// client too many, silent disconnect on a malformed header or a request over 10 MB.

#include <memory>
#include <thread>
#include <vector>

#include "samples/simulator/live_robot.hpp"
#include "samples/simulator/net.hpp"
#include "schema/wire/frame.hpp"

namespace tacho::sim {

/// Answers on a thread of its own from construction to destruction.
class StatusServer {
 public:
  StatusServer(LiveRobot& robot, Descriptor listener, int max_clients);
  ~StatusServer();
  StatusServer(const StatusServer&) = delete;
  StatusServer& operator=(const StatusServer&) = delete;

 private:
  struct Client {
    Descriptor socket;
    wire::FrameDecoder decoder;
  };

  LiveRobot& robot_;
  Descriptor listener_;
  int max_clients_;
  Wakeup stop_;
  std::vector<Client> clients_;
  std::jthread thread_;

  void run();
  void welcome();
  bool serve(Client& client);
  bool answer(Client& client, const wire::Frame& request);
};

}  // namespace tacho::sim
