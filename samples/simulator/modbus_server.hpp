#pragma once
// Modbus TCP of one simulated robot: reads input registers 1-140 (FC4) and discrete inputs 1-80 (FC2), gaps as 0; every
// other function is an exception, another unit than the robot's gets silence.

#include <memory>
#include <thread>
#include <vector>

#include "samples/simulator/live_robot.hpp"
#include "samples/simulator/net.hpp"

namespace tacho::sim {

/// Answers on a thread of its own from construction to destruction.
class ModbusServer {
 public:
  ModbusServer(LiveRobot& robot, Descriptor listener);
  ~ModbusServer();
  ModbusServer(const ModbusServer&) = delete;
  ModbusServer& operator=(const ModbusServer&) = delete;

 private:
  struct Protocol;
  LiveRobot& robot_;
  Descriptor listener_;
  Wakeup stop_;
  std::unique_ptr<Protocol> protocol_;
  std::vector<Descriptor> clients_;
  std::jthread thread_;

  void run();
  bool serve(const Descriptor& client);
};

}  // namespace tacho::sim
