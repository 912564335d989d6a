#pragma once
// A12: JSON against Modbus. Each JSON interval takes the register row nearest to one of its ends; JSON is interpolated
// (poses on SE(2)) to the register's time and |difference| compared with a tolerance:
//   odo, today_odo  ulp32/2 + 0.0005 + v_max (u_J + u_M) + i
//   x, y            ulp32/2 + 5e-5 + v (u_J + u_M) + i + noise      angle  1e-4 + w (u_J + u_M) + i_w + noise, mod 2 pi
//   vx, vy, w       ulp32/2 + 5e-5 + a (u_J + u_M) + s              SoC    1 % (integer percent and JSON rounding)
//   total_time      ulp32(hours) 1800 s + 0.001 s + u_J + u_M
// i = max(a dt / 2, |dv|) f (1-f) dt and s = what interpolation between two polls can miss with |dv/dt| <= a (99.9
// percentile so far, at least the floor) and for a speed that changes anyhow between its ends; noise = max(10 mm,
// 6 sqrt2 sigma_p), max(10 mrad, 6 sqrt2 sigma_theta): two estimates of one pose. Where a dt reaches the fastest speed
// so far, what happens between two polls is not resolved: the fastest speed replaces |dv|, and speeds are not compared.
// A pair that says nothing is not used: i above 0.25 m or 0.25 rad. States (localisation, task, block reason) go
// through maps of their codes, must be the same at both ends of the JSON interval, and may lag by one poll. Station:
// "JSON empty, register set" is right (0.30 m against 0.50 m). Alarms: first codes of the registers must be in JSON
// within one poll on both sides.
//
// Lag of the register cache: s that minimises sum |odo_M(t) - odo_J(t - s)| while moving, to first order the median of
// (odo_J - odo_M)/v weighted with v. Most odometers off by more than half their value: wrong byte or word order.

#include <deque>
#include <vector>

#include "analyzer/analyses/odometry_rows.hpp"
#include "analyzer/analyses/odometry_standstill.hpp"

namespace tacho::odometry {

enum class Compared : std::uint8_t {
  odo,
  today_odo,
  x,
  y,
  angle,
  vx,
  vy,
  w,
  soc,
  total_time,
  localisation,
  task,
  block_reason,
  station,
  alarms
};
inline constexpr std::size_t kComparedCount = 15;
std::string_view compared_name(Compared what);
std::string_view compared_unit(Compared what);

struct CrossCount {
  std::uint64_t n = 0;
  std::uint64_t outside = 0;
  double worst = 0;    ///< largest |difference| outside, or largest at all
  double allowed = 0;  ///< tolerance there
  Micros worst_us = 0;
  double tolerance_sum = 0;
};

struct CrossResult {
  std::array<CrossCount, kComparedCount> counts{};
  std::uint64_t n = 0;
  std::uint64_t outside = 0;
  Quantity share;  ///< outside / n with Wilson limits
  Quantity lag_s;  ///< of the registers behind JSON
  bool word_order = false;
  std::string reason;  ///< why nothing could be compared
};

/// p99.9 of a stream so far; the maximum until 200 values.
class RunningBound {
 public:
  explicit RunningBound(double floor) : floor_(floor), value_(floor) {}
  void add(double v);
  [[nodiscard]] double value() const { return value_; }

 private:
  double floor_;
  double value_;
  double max_ = 0.0;
  std::uint64_t n_ = 0;
  std::array<std::uint32_t, 256> bins_{};
};

class CrossFold {
 public:
  explicit CrossFold(const Config& config)
      : config_(config), accel_(config.accel_floor_mps2), turn_accel_(config.turn_accel_floor_radps2) {}
  /// Rows of each source in order; `joined`: nothing was cut between the JSON row and the one before.
  void add_json(const CrossRow& row, bool joined);
  void add_registers(const CrossRow& row) { registers_.push_back(row); }
  /// All rows received up to `t_us` have been added.
  void settle(Micros t_us);
  [[nodiscard]] CrossResult finish(const StandstillResult& still);

 private:
  struct JsonRow {
    CrossRow row;
    bool joined = false;
    double accel = 0, turn_accel = 0;      ///< bounds as of this row
    double fastest = 0, fastest_turn = 0;  ///< so far
  };
  /// A pose difference that noise must explain.
  struct Excess {
    Micros t_us = 0;
    float difference = 0;
    float tolerance = 0;  ///< without noise
    Compared what = Compared::x;
  };
  struct Pair {
    const JsonRow& a;
    const JsonRow& b;
    const CrossRow& m;
    double f, dt, u;
  };

  Config config_;
  RunningBound accel_;
  RunningBound turn_accel_;
  double fastest_ = 0;
  double fastest_turn_ = 0;
  std::deque<JsonRow> json_;
  std::deque<CrossRow> registers_;
  std::size_t next_ = 0;  ///< start of the next interval in json_; the row before it is kept
  CrossResult result_;
  std::vector<Excess> excess_;
  std::vector<float> lag_;
  std::vector<float> lag_weight_;
  std::uint64_t odo_absurd_ = 0;

  void advance();
  void compare_interval(std::size_t k);
  void compare(const Pair& pair);
  /// What interpolating a counter or an angle can miss: |rate of change| <= accel, and a rate that moves by `change`.
  static double path_doubt(const Pair& pair, double accel, double change);
  void compare_motion(const Pair& pair);
  void compare_states(const Pair& pair, std::size_t k);
  void count(Compared what, Micros t_us, double difference, double tolerance);
  void count_pose(Compared what, Micros t_us, double difference, double tolerance);
};

}  // namespace tacho::odometry
