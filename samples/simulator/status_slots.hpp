#pragma once
// Writers for the @{name} slots of the answer templates.

#include <string>
#include <string_view>

#include "samples/simulator/readings.hpp"

namespace tacho::sim {

/// What a robot says about itself, made up from its name.
struct Identity {
  std::string mac;
  std::string model_md5;
  std::string map_md5;
};
Identity make_identity(const Scenario& scenario);

/// Everything an answer is written from.
struct Moment {
  const Scenario& scenario;
  const Identity& identity;
  const RobotState& state;
  const Readings& readings;
};

using SlotWriter = void (*)(std::string& out, const Moment& moment);
/// The writer of a slot; the name must exist (assert).
SlotWriter slot_writer(std::string_view name);

}  // namespace tacho::sim
