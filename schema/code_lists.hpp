#pragma once
// The code lists, as printed in the vendor's documents (11100, input registers) and seen on real robots.
// Values are the robot's; names are ours. Append only: names are stored in logs and printed in reports.

#include "schema/codes.hpp"

namespace tacho {

// clang-format off
/// Union of the 11100 answer (0-8) and of input registers 44 and 84 (0-10).
inline constexpr auto kObstacleCodes = std::to_array<Code>({
  {0,  "ultrasonic",          "ultrasonic sensor"},
  {1,  "laser",               "laser scanner"},
  {2,  "falldown",            "drop-off sensor"},
  {3,  "collision",           "bumper"},
  {4,  "infrared",            "infrared sensor"},
  {5,  "lock",                "lock switch"},
  {6,  "dynamic_obstacle",    "moving obstacle"},
  {7,  "virtual_laser_point", "virtual laser point"},
  {8,  "camera_3d",           "3D camera"},
  {9,  "distance_sensor",     "distance sensor (registers only)"},
  {10, "di_ultrasonic",       "ultrasonic sensor on a digital input (registers only)"},
});

/// Union of 11100 task_status (0-6) and of input register 9 (0-7).
inline constexpr auto kTaskStatusCodes = std::to_array<Code>({
  {0, "none",      "no task"},
  {1, "waiting",   "waiting to start"},
  {2, "running",   "running"},
  {3, "suspended", "suspended"},
  {4, "completed", "arrived"},
  {5, "failed",    "failed"},
  {6, "canceled",  "cancelled"},
  {7, "timeout",   "timed out (registers only)"},
});

inline constexpr auto kTaskTypeCodes = std::to_array<Code>({
  {0,   "none",            "no navigation"},
  {1,   "free_to_point",   "free navigation to a point"},
  {2,   "free_to_station", "free navigation to a station"},
  {3,   "path_to_station", "path navigation to a station"},
  {7,   "translate_rotate","straight move or turn"},
  {100, "other",           "other"},
});

/// reloc_status of 11100. Value 3 is not documented there but reported by real robots.
inline constexpr auto kRelocCodes = std::to_array<Code>({
  {0, "initialising", "relocalisation is initialising"},
  {1, "success",      "localised"},
  {2, "relocating",   "relocalising"},
  {3, "unconfirmed",  "relocalised, waiting for confirmation"},
});

/// Input register 8: another list than reloc_status, though numbers overlap.
inline constexpr auto kRelocRegisterCodes = std::to_array<Code>({
  {0, "failed",      "localisation failed"},
  {1, "success",     "localised"},
  {2, "relocating",  "relocalising"},
  {3, "unconfirmed", "relocalised, waiting for confirmation"},
});

inline constexpr auto kLoadMapCodes = std::to_array<Code>({
  {0, "failed",  "map could not be loaded"},
  {1, "success", "map loaded"},
  {2, "loading", "map is loading"},
});

inline constexpr auto kSlamCodes = std::to_array<Code>({
  {0, "none",       "not mapping"},
  {1, "offline_2d", "mapping offline"},
  {2, "live_2d",    "mapping live"},
  {3, "offline_3d", "3D mapping offline"},
  {4, "live_3d",    "3D mapping live"},
});

inline constexpr auto kLocMethodCodes = std::to_array<Code>({
  {0, "natural",       "natural contours"},
  {1, "reflector",     "reflectors"},
  {2, "qr_code",       "QR codes"},
  {3, "odometry",      "odometry only: the pose is not independent of it"},
  {4, "three_d",       "3D"},
  {5, "sky_code",      "ceiling codes"},
  {6, "feature",       "features"},
  {7, "feature_3d",    "3D features"},
  {8, "kalman_3d",     "3D Kalman filter"},
});

inline constexpr auto kRollerCodes = std::to_array<Code>({
  {1,    "standby", "standby"},
  {2,    "running", "running"},
  {3,    "done",    "done"},
  {0xFF, "failed",  "failed"},
});

inline constexpr auto kJackCodes = std::to_array<Code>({
  {0,    "rising",   "rising"},
  {1,    "raised",   "raised"},
  {2,    "lowering", "lowering"},
  {3,    "lowered",  "lowered"},
  {4,    "stopped",  "stopped"},
  {0xFF, "failed",   "failed"},
});

inline constexpr auto kDispatchCodes = std::to_array<Code>({
  {0, "single",   "on its own"},
  {1, "dispatch", "under a fleet manager"},
});

inline constexpr auto kJoystickCodes = std::to_array<Code>({
  {0, "unplugged", "no joystick"},
  {1, "plugged",   "joystick plugged in, not active"},
  {2, "active",    "driven by joystick"},
});

inline constexpr auto kPreemptedCodes = std::to_array<Code>({
  {0, "own",      "held by the robot's own system or by nobody"},
  {1, "external", "taken by somebody else"},
});

inline constexpr auto kSrcModeCodes = std::to_array<Code>({
  {0, "control", "control"},
  {1, "listen",  "listen"},
});

/// ret_code of the API (0 and the codes of the protocol document, chapter 8, and later additions).
inline constexpr auto kReturnCodes = std::to_array<Code>({
  {0,     "success",            "success"},
  {40000, "request_unavailable","request not available"},
  {40001, "parameter_missing",  "required parameter missing"},
  {40002, "parameter_type",     "parameter of the wrong type"},
  {40003, "parameter_illegal",  "parameter not allowed"},
  {40004, "mode_error",         "not in this mode"},
  {40005, "map_name_illegal",   "illegal map name"},
  {40012, "dispatching",        "robot is under a fleet manager"},
  {40015, "manual_charging",    "robot is charging manually"},
  {40016, "emergency_stop",     "emergency stop is pressed"},
  {40020, "control_taken",      "control is taken by somebody else"},
  {40051, "map_absent",         "map does not exist"},
  {61001, "client_limit",       "too many clients on this port"},
});
// clang-format on

struct CodeList {
  std::string_view name;
  std::span<const Code> codes;
};

/// Every list, for the `code` table of a log and for the field reference.
inline constexpr auto kCodeLists = std::to_array<CodeList>({
    {"obstacle", kObstacleCodes},
    {"task_status", kTaskStatusCodes},
    {"task_type", kTaskTypeCodes},
    {"reloc", kRelocCodes},
    {"reloc_register", kRelocRegisterCodes},
    {"load_map", kLoadMapCodes},
    {"slam", kSlamCodes},
    {"loc_method", kLocMethodCodes},
    {"roller", kRollerCodes},
    {"jack", kJackCodes},
    {"dispatch", kDispatchCodes},
    {"joystick", kJoystickCodes},
    {"preempted", kPreemptedCodes},
    {"src_mode", kSrcModeCodes},
    {"return_code", kReturnCodes},
});

}  // namespace tacho
