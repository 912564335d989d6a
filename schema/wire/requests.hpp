#pragma once
// The only requests that exist: 1100 and 1013 on the status port. (Modbus: FC4 and FC2, in recorder/link.)

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace tacho::wire {

/// Every parameter of request 1100 (robot_status_all1_req). Unset = not sent. `timeout` is documented but would raise
/// alarm 55011 on the robot when the recorder stops, so it does not exist here.
struct StatusRequest {
  std::vector<std::string> keys;             ///< empty = all keys
  std::optional<bool> return_laser = false;  ///< 94 % of a default answer is laser beams
  std::optional<bool> return_beams3d;
  std::optional<bool> return_mid360;  ///< gone in firmware 3.4.6.1802 and later
  std::optional<std::string> language;
};

/// Body of request 1100: compact JSON in the key order of the vendor's document.
std::string status_request_body(const StatusRequest& request);

}  // namespace tacho::wire
