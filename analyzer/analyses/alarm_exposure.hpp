#pragma once
// How long, how far and in which state a robot was observed: what alarm counts are divided by, and the stops.

#include <array>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "analyzer/analyses/alarm_tracker.hpp"

namespace tacho {

/// Local days and hours of a zone. Looks the offset up once per hour.
class LocalTime {
 public:
  explicit LocalTime(std::string zone) : zone_(std::move(zone)) {}
  /// Whole days since 1970-01-01, local.
  std::int64_t day(Micros t_us) { return floor_div(local_s(t_us), 86'400); }
  /// 0..23, local.
  std::size_t hour(Micros t_us) { return static_cast<std::size_t>(floor_div(local_s(t_us), 3'600) - day(t_us) * 24); }
  /// UTC time at which a local day starts.
  Micros day_start_us(std::int64_t day);

  static std::int64_t floor_div(std::int64_t a, std::int64_t b) { return a / b - (a % b < 0 ? 1 : 0); }

 private:
  std::string zone_;
  std::int64_t cached_hour_ = std::numeric_limits<std::int64_t>::min();
  std::int64_t offset_s_ = 0;
  std::int64_t local_s(Micros t_us);
};

/// What one poll says about the robot.
struct PollState {
  Micros t_send_us = 0;
  Micros t_recv_us = 0;
  std::array<bool, kAlarmLevels> known{};
  std::optional<bool> task_running;
  std::optional<bool> moving;
  std::optional<double> odo_m;
  std::optional<std::size_t> stopping;  ///< oldest active alarm that counts as stopping, as an interval index

  [[nodiscard]] Micros t_mid_us() const { return t_send_us + (t_recv_us - t_send_us) / 2; }
  /// Task running, not moving; empty when one of them is not known.
  [[nodiscard]] std::optional<bool> stopped() const;
  [[nodiscard]] std::optional<bool> down() const;
};

/// A stop by an alarm: task running, not moving, a stopping alarm active.
struct Down {
  Micros onset_lo_us = 0, onset_hi_us = 0;
  Micros end_lo_us = 0, end_hi_us = 0;
  std::size_t interval = 0;  ///< the alarm that stood first
  bool cut = false;          ///< its start or end lies in a gap or outside the record
  double observed_s = 0.0;
};

/// Sums over the pauses between polls that are not gaps. A state that differs at the two ends holds for half the pause.
class AlarmExposure {
 public:
  AlarmExposure(const std::string& zone, double v_max_mps) : local_(zone), v_max_mps_(v_max_mps) {}
  /// `near`: the pause before this poll is no gap.
  void step(const PollState& now, bool near);
  /// Closes a stop that lasts to the end.
  void finish();

  double observed_s = 0.0;
  std::array<double, kAlarmLevels> level_s{};
  double km = 0.0;
  bool has_odo = false;
  double moving_s = 0.0;
  double task_s = 0.0;  ///< task running, and moving or not known
  double down_s = 0.0;
  bool task_known = false;  ///< task and motion were known at least once
  std::uint64_t polls = 0;
  std::uint64_t near_steps = 0;
  std::map<std::int64_t, double> ten_minutes;  ///< observed seconds per 600 s bin since 1970
  std::map<std::int64_t, double> days;         ///< observed seconds per local day
  std::array<double, 24> hours{};              ///< observed seconds per local hour of day
  std::vector<Down> downs;
  Micros first_us = 0;
  Micros last_us = 0;

 private:
  LocalTime local_;
  double v_max_mps_;
  std::optional<PollState> before_;
  std::optional<Down> open_;
  void share(const PollState& now, double dt_s);
  void stops(const PollState& now, bool near, double dt_s);
};

}  // namespace tacho
