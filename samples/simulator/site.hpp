#pragma once
// The hall: a loop of corridors (36 m x 16 m, two rounded corners, two driven by turning on the spot), eight stations
// and a charging dock. Half of the stations are bays beside the corridor, entered forwards and left backwards.

#include <array>
#include <string_view>
#include <variant>
#include <vector>

#include "samples/simulator/motion.hpp"

namespace tacho::sim {

struct Station {
  std::string_view id;  ///< its digits are the number in the registers
  double loop_m;        ///< where on the loop, counter-clockwise from the corner (2, 2)
  double bay_m = 0;     ///< depth of the bay; 0 = on the corridor
  int side = 1;         ///< bay to the left (+1, inside) or right (-1) of counter-clockwise travel
};

inline constexpr std::array<Station, 9> kStations{{{"LM1", 6.0},
                                                   {"LM2", 18.0, 2.5, 1},
                                                   {"LM3", 30.0},
                                                   {"LM4", 43.0, 2.0, -1},
                                                   {"LM5", 58.0},
                                                   {"LM6", 70.0, 2.5, -1},
                                                   {"LM7", 80.0, 3.0, 1},
                                                   {"LM8", 92.0},
                                                   {"CP9", 98.0, 1.5, 1}}};
inline constexpr int kDock = 8;

/// Position of a station, and the heading of a robot that stands in its bay (on the corridor: of counter-clockwise
/// travel).
Pose station_pose(int station);
/// The nearest station within `radius_m`, or -1.
int station_near(double x_m, double y_m, double radius_m);
/// The number in a station's id.
int station_number(int station);

struct Turn {
  double to_heading_rad;  ///< absolute
};
struct Drive {
  Run run;
  int direction = 1;
};
using Step = std::variant<Turn, Drive>;

struct SpeedLimits {
  double corridor_mps = 1;
  double arc_mps = 0.6;
  double bay_mps = 0.4;
};
/// Steps from one station to another, round the loop counter-clockwise or clockwise.
std::vector<Step> route(int from, int to, bool counter_clockwise, const SpeedLimits& limits);

}  // namespace tacho::sim
