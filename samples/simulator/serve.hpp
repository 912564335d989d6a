#pragma once
// Simulated robots on 127.0.0.1: Robokit status and push port and Modbus TCP per robot, in real time.

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "samples/simulator/link_faults.hpp"
#include "samples/simulator/robot.hpp"

namespace tacho::sim {

struct ServedRobot {
  Scenario scenario;
  std::uint16_t status_port = 0;  ///< 0 = any free one
  std::uint16_t modbus_port = 0;
  std::uint16_t push_port = 0;
};

struct ServeOptions {
  std::string bind = "127.0.0.1";
  Micros push_period_us = 0;  ///< 0: nobody listens on the push port
  std::string truth_file;  ///< written by finish() or at the end; empty = none
  int max_clients = 10;    ///< further ones get the 19204 / 61001 frame
};

class Server {
 public:
  Server(std::vector<ServedRobot> robots, ServeOptions options);  ///< listens; throws Error when a port is taken
  ~Server();                                                      ///< finishes
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  [[nodiscard]] std::uint16_t status_port(std::size_t robot) const;
  [[nodiscard]] std::uint16_t modbus_port(std::size_t robot) const;
  [[nodiscard]] std::uint16_t push_port(std::size_t robot) const;  ///< 0: none
  /// Closes listeners and connections of one robot, as if it were switched off; `start` brings it back on the same
  /// ports.
  void stop(std::size_t robot);
  void start(std::size_t robot);
  /// From now on, whatever its scenario says; null: none. Thread-safe.
  void fault(std::size_t robot, Port port, const LinkFault* fault);
  /// Stops all robots and writes the truth file, once. Throws Error when it cannot be written.
  void finish();
  [[nodiscard]] Truth truth(std::size_t robot) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tacho::sim
