#pragma once
// Modbus TCP of one simulated robot: reads input registers 1-140 (FC4) and discrete inputs 1-80 (FC2), gaps as 0; every
// other function is an exception, another unit than the robot's gets silence.

#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "samples/simulator/link_faults.hpp"
#include "samples/simulator/live_robot.hpp"
#include "samples/simulator/net.hpp"

namespace tacho::sim {

/// Answers from construction to destruction. Throws Error when libmodbus has no memory.
class ModbusServer {
 public:
  /// `robot` and `faults` must outlive it.
  ModbusServer(LiveRobot& robot, const FaultPlan& faults, Listener listener);
  ~ModbusServer();

 private:
  struct Protocol;
  struct Client {
    std::string previous;  // answer
    int answers = 0;
  };
  LiveRobot& robot_;
  const FaultPlan& faults_;
  std::unique_ptr<Protocol> protocol_;
  ClientLoop loop_;

  ClientLoop::Serve welcome(Script& out);
  bool serve(const Descriptor& socket, Client& client, Script& out);
  [[nodiscard]] std::string answer(std::span<const std::uint8_t> request);
};

}  // namespace tacho::sim
