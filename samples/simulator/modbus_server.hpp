#pragma once
// Modbus TCP of one simulated robot: reads input registers 1-140 (FC4) and discrete inputs 1-80 (FC2), gaps as 0; every
// other function is an exception, another unit than the robot's gets silence.

#include <memory>

#include "samples/simulator/live_robot.hpp"
#include "samples/simulator/net.hpp"

namespace tacho::sim {

/// Answers from construction to destruction. Throws Error when libmodbus has no memory.
class ModbusServer {
 public:
  ModbusServer(LiveRobot& robot, Descriptor listener);
  ~ModbusServer();

 private:
  struct Protocol;
  LiveRobot& robot_;
  std::unique_ptr<Protocol> protocol_;
  ClientLoop loop_;

  bool serve(const Descriptor& client);
};

}  // namespace tacho::sim
