#pragma once
// Who a robot says it is. Pure.

#include <string>

#include "schema/records.hpp"
#include "schema/sample.hpp"

namespace tacho::recorder {

/// Empty: not told, which is never a difference: keys may be left out, by the request or by the firmware.
struct Identity {
  std::string vehicle_id;
  std::string mac;
  std::string model_md5;

  /// Something both tell is different: this is another robot, or the same with another model.
  [[nodiscard]] bool differs(const Identity& other) const;
  /// Nothing both tell is different, and vehicle_id or MAC is the same: robots of one kind share their model.
  [[nodiscard]] bool same(const Identity& other) const;
  /// Takes over what the other tells.
  void learn(const Identity& other);
  /// "AMB-1, MAC 00:11.., model 5d41.."
  [[nodiscard]] std::string text() const;
};

Identity identity_of(const Sample& sample);
Identity identity_of(const Robot& robot);
/// The fields that tell it.
const FieldSet& identity_fields();

}  // namespace tacho::recorder
