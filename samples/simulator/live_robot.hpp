#pragma once
// A simulated robot in real time, asked by several server threads.

#include <array>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "samples/simulator/answers.hpp"

namespace tacho::sim {

/// Thread-safe. Its time starts at the host's wall clock and then follows the monotonic one.
class LiveRobot {
 public:
  /// Throws Error when a body file cannot be read.
  explicit LiveRobot(const Scenario& scenario);

  std::string status(std::span<const std::string> keys, bool lasers);
  std::string io();
  std::string push();
  std::array<std::uint16_t, 140> registers();
  std::array<std::uint8_t, 80> inputs();
  Truth truth();
  [[nodiscard]] const Scenario& scenario() const { return scenario_; }

 private:
  const RobotState& now();

  Scenario scenario_;
  std::string body_;
  std::string io_body_;
  std::mutex mutex_;
  Micros t0_us_;
  Micros mono0_us_;
  Robot robot_;
  AnswerMaker answers_;
};

}  // namespace tacho::sim
