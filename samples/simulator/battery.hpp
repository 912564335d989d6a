#pragma once
// The battery in closed form: charge drawn is linear in time, metres and turning; charging is constant current, then an
// exponential taper. Currents are at the terminals, discharge negative.

#include "samples/simulator/motion.hpp"
#include "samples/simulator/scenario.hpp"

namespace tacho::sim {

struct BatteryState {
  double soc = 0;  ///< of the present capacity
  double capacity_ah = 0;
  double charged_ah = 0;  ///< since the start
  double discharged_ah = 0;
  double variation = 0;  ///< sum of |change of soc|; half of it = equivalent full cycles
  double heat_k = 0;     ///< above ambient
};

enum class BatteryMode { load, cut_off, constant, taper };

/// How the battery is used during a motion piece.
struct BatteryPiece {
  BatteryState start;
  BatteryMode mode = BatteryMode::load;
  double drain_a = 0;   ///< load: constant part
  double charge_a = 0;  ///< at the piece's start
  double taper_s = 0;   ///< charge current = charge_a exp(-tau / taper_s)
};

/// One stage of charging: how long, and how the battery is used in it.
struct ChargeStage {
  Micros duration_us = 0;
  BatteryMode mode = BatteryMode::constant;
  double charge_a = 0;
  double taper_s = 0;
};

class Battery {
 public:
  explicit Battery(const Scenario& scenario);

  [[nodiscard]] BatteryState initial() const;
  /// Use during `motion`. An empty battery's management cuts off: nothing is drawn below 1 %.
  [[nodiscard]] BatteryPiece load(const BatteryState& state, const Piece& motion) const;
  [[nodiscard]] static BatteryPiece charge(const BatteryState& state, const ChargeStage& stage);
  /// Stages from `state` to the scenario's charge_until.
  [[nodiscard]] std::vector<ChargeStage> stages(const BatteryState& state) const;
  /// After a charge: the capacity that is left after all equivalent full cycles so far.
  void learn_capacity(BatteryState& state) const;

  /// `k` is the motion since the piece's start, after tau_s.
  [[nodiscard]] static double current_a(const BatteryPiece& piece, const Piece& motion, const Kinematics& k,
                                        double tau_s);
  [[nodiscard]] static BatteryState after(const BatteryPiece& piece, const Kinematics& k, double tau_s);
  [[nodiscard]] double voltage_v(double soc, double current_a, double age_s) const;
  /// Ambient follows the UTC day: 20 C +- 4 K, warmest at 15:00.
  [[nodiscard]] static double temperature_c(double heat_k, Micros t_us);

 private:
  const Scenario& scenario_;
};

}  // namespace tacho::sim
