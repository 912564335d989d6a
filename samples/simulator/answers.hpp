#pragma once
// A robot's state -> bytes of its answers, shaped like real ones (197 keys, four alarm shapes, -0.0, nulls, absent
// reason keys). Adds the scenario's noise and the controller's rounding.

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "samples/simulator/robot.hpp"

namespace tacho::sim {

class AnswerMaker {
 public:
  explicit AnswerMaker(const Scenario& scenario);
  ~AnswerMaker();
  AnswerMaker(AnswerMaker&&) noexcept;

  /// What is recorded of an answer of that source: one of the bodies below, or an image of the documented ranges.
  std::string body(Source source, const RobotState& state);
  /// Body of 11100. `keys` empty = everything; lasers only with `lasers`.
  std::string status(const RobotState& state, std::span<const std::string> keys = {}, bool lasers = false);
  /// Body of a push: the same values, with jack, roller, hook and fork in objects of their own, and a few more keys.
  std::string push(const RobotState& state);
  /// Body of 11013.
  std::string io(const RobotState& state);
  /// Registers [3x] 1-140; index 0 is documented address 1.
  std::array<std::uint16_t, 140> registers(const RobotState& state);
  /// Discrete inputs [1x] 1-80, one byte per bit.
  std::array<std::uint8_t, 80> inputs(const RobotState& state);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tacho::sim
