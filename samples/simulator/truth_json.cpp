#include <cerrno>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>

#include "samples/simulator/robot.hpp"
#include "schema/error.hpp"

namespace tacho::sim {

std::string truth_json(const std::string& robot, const Truth& truth) {
  nlohmann::ordered_json j;
  j["robot"] = robot;
  j["t0_us"] = truth.t0_us;
  j["t1_us"] = truth.t1_us;
  j["odo_scale"] = truth.odo_scale;
  j["twist_scale"] = truth.twist_scale;
  j["angular_scale"] = truth.angular_scale;
  j["path_m"] = truth.path_m;
  j["counter_m"] = truth.counter_m;
  j["charged_ah"] = truth.charged_ah;
  j["discharged_ah"] = truth.discharged_ah;
  j["equivalent_full_cycles_soc"] = truth.equivalent_full_cycles_soc;
  j["charge_sessions"] = truth.charge_sessions;
  j["capacity_ah_per_day"] = truth.capacity_ah_per_day;
  j["alarms"] = nlohmann::ordered_json::array();
  for (const TrueAlarm& alarm : truth.alarms) {
    j["alarms"].push_back({{"level", alarm_level_name(alarm.level)},
                           {"code", alarm.code},
                           {"from_us", alarm.from_us},
                           {"to_us", alarm.to_us}});
  }
  j["blocked"] = nlohmann::ordered_json::array();
  for (const TrueEpisode& episode : truth.blocked) {
    j["blocked"].push_back({{"from_us", episode.from_us},
                            {"to_us", episode.to_us},
                            {"x_m", episode.x_m},
                            {"y_m", episode.y_m},
                            {"obstacle_x_m", episode.obstacle_x_m},
                            {"obstacle_y_m", episode.obstacle_y_m},
                            {"reason", episode.reason}});
  }
  j["jumps"] = nlohmann::ordered_json::array();
  for (const TrueJump& jump : truth.jumps) {
    j["jumps"].push_back({{"t_us", jump.t_us}, {"dx_m", jump.dx_m}, {"dy_m", jump.dy_m}});
  }
  j["slips"] = nlohmann::ordered_json::array();
  for (const TrueSlip& slip : truth.slips) {
    j["slips"].push_back({{"from_us", slip.from_us}, {"to_us", slip.to_us}, {"metres", slip.metres}});
  }
  return j.dump(1);
}

void write_truth(const std::filesystem::path& file, std::span<const std::string> robots,
                 std::span<const Truth> truths) {
  std::ofstream out(file, std::ios::binary);
  for (std::size_t i = 0; i < robots.size(); ++i) {
    out << (i == 0 ? "[" : ",\n") << truth_json(robots[i], truths[i]);
  }
  out << "]\n";
  if (!out.flush()) {
    throw Error("cannot write " + file.string(), std::strerror(errno), "is the folder there and writable?");
  }
}

}  // namespace tacho::sim
