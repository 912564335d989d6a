#pragma once
// What the robot's sensors and counters show: one value per row of the field table, in its SI unit, with the scenario's
// scales and noise, before rounding. JSON answers and registers are both written from it.

#include <array>

#include "samples/simulator/motion.hpp"
#include "samples/simulator/robot.hpp"
#include "samples/simulator/robot_clock.hpp"
#include "schema/fields.hpp"

namespace tacho::sim {

struct Readings {
  std::array<double, kFieldCount> value{};
  Pose pose;  ///< as localised
  ClockReading clock;
  [[nodiscard]] double operator[](FieldIndex f) const { return value[f]; }
};

/// Noise depends on the seed and on the controller's cycle (50 ms) that state.t_us is in.
void read_sensors(const Scenario& scenario, const RobotState& state, Readings& out);

inline constexpr int kInputCount = 25;
inline constexpr int kOutputCount = 18;
inline constexpr int kNormalInputs = 24;  ///< the last input is virtual
inline constexpr int kNormalOutputs = 16;
bool digital_input(const RobotState& state, int id);
bool digital_output(const RobotState& state, int id);

}  // namespace tacho::sim
