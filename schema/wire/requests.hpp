#pragma once
// The only requests that exist: 1100 and 1013 on the status port. (Modbus: FC4 and FC2, in recorder/link.)

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
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

/// 1100 for kPoseKeys.
std::string pose_request_body();

/// Keys of the object that the body is, as they are written; none when it is no object.
std::vector<std::string_view> member_keys(std::string_view body);
/// The controller sent the whole answer although only `asked` keys were asked for. A few more are no sign of it:
/// create_on, ret_code and whatever a firmware adds to every answer.
bool ignores_keys(std::string_view body, std::size_t asked);

}  // namespace tacho::wire
