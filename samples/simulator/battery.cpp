#include "samples/simulator/battery.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace tacho::sim {
namespace {

constexpr double kIdleA = 1.3;      // controller, lasers, radio
constexpr double kPerSpeedA = 4.7;  // per m/s
constexpr double kPerAccelA = 8.0;  // per m/s^2 while speeding up
constexpr double kPerPivotA = 2.5;  // per rad/s on the spot
constexpr double kCutOffSoc = 0.01;
constexpr double kTaperFrom = 0.85;  // state of charge at which the charger reaches its voltage
constexpr double kHeatPerA2 = 0.03;  // K at rest of temperature, per A^2
constexpr double kHeatTimeS = 7200.0;

// Open-circuit voltage over nominal voltage.
struct OcvPoint {
  double soc;
  double ratio;
};
constexpr std::array<OcvPoint, 9> kOcv{{{0.0, 0.85},
                                        {0.05, 0.935},
                                        {0.1, 0.96},
                                        {0.2, 0.985},
                                        {0.5, 1.01},
                                        {0.8, 1.035},
                                        {0.9, 1.05},
                                        {0.95, 1.065},
                                        {1.0, 1.1}}};

double open_circuit_ratio(double soc) {
  std::size_t i = 1;
  while (i + 1 < kOcv.size() && soc > kOcv[i].soc) {
    ++i;
  }
  const OcvPoint& a = kOcv[i - 1];
  const OcvPoint& b = kOcv[i];
  return a.ratio + (b.ratio - a.ratio) * (soc - a.soc) / (b.soc - a.soc);
}

// Drawn or charged since the piece's start, never negative.
double ampere_hours(const BatteryPiece& piece, const Kinematics& k, double tau_s) {
  switch (piece.mode) {
    case BatteryMode::cut_off:
      return 0;
    case BatteryMode::constant:
      return piece.charge_a * tau_s / 3600;
    case BatteryMode::taper:
      return -piece.charge_a * piece.taper_s * std::expm1(-tau_s / piece.taper_s) / 3600;
    case BatteryMode::load:
      break;
  }
  return (piece.drain_a * tau_s + kPerSpeedA * k.path_m + kPerPivotA * k.pivot_rad) / 3600;
}

}  // namespace

Battery::Battery(const Scenario& scenario) : scenario_(scenario) {}

BatteryState Battery::initial() const {
  BatteryState state;
  state.soc = scenario_.soc_start;
  state.capacity_ah = scenario_.capacity_ah;
  return state;
}

BatteryPiece Battery::load(const BatteryState& state, const Piece& motion) const {
  BatteryPiece piece;
  piece.start = state;
  if (state.soc < kCutOffSoc) {
    piece.mode = BatteryMode::cut_off;
    return piece;
  }
  const bool braking = motion.v0_mps * motion.accel_mps2 < 0;
  piece.drain_a = kIdleA + (braking ? 0.0 : kPerAccelA * std::abs(motion.accel_mps2));
  return piece;
}

BatteryPiece Battery::charge(const BatteryState& state, const ChargeStage& stage) {
  BatteryPiece piece;
  piece.start = state;
  piece.mode = stage.mode;
  piece.charge_a = stage.charge_a;
  piece.taper_s = stage.taper_s;
  return piece;
}

std::vector<ChargeStage> Battery::stages(const BatteryState& state) const {
  std::vector<ChargeStage> result;
  const double full_a = scenario_.charge_current_a;
  const double capacity_as = state.capacity_ah * 3600;
  const double constant_until = std::min(kTaperFrom, scenario_.charge_until);
  if (state.soc < constant_until) {
    const double duration_s = (constant_until - state.soc) * capacity_as / full_a;
    result.push_back({std::llround(duration_s * 1e6), BatteryMode::constant, full_a, 0});
  }
  const double from = std::max(state.soc, kTaperFrom);
  if (from < scenario_.charge_until) {
    ChargeStage taper;
    taper.mode = BatteryMode::taper;
    taper.taper_s = (1 - kTaperFrom) * capacity_as / full_a;
    taper.charge_a = full_a * (1 - from) / (1 - kTaperFrom);
    taper.duration_us = std::llround(taper.taper_s * std::log((1 - from) / (1 - scenario_.charge_until)) * 1e6);
    result.push_back(taper);
  }
  return result;
}

void Battery::learn_capacity(BatteryState& state) const {
  const double left = 1 - scenario_.fade_per_efc * state.variation / 2;
  state.capacity_ah = scenario_.capacity_ah * std::max(0.05, left);
}

double Battery::current_a(const BatteryPiece& piece, const Piece& motion, const Kinematics& k, double tau_s) {
  switch (piece.mode) {
    case BatteryMode::cut_off:
      return 0;
    case BatteryMode::constant:
      return piece.charge_a;
    case BatteryMode::taper:
      return piece.charge_a * std::exp(-tau_s / piece.taper_s);
    case BatteryMode::load:
      break;
  }
  const double pivot_radps = std::abs(motion.w0_radps + motion.w_accel * tau_s);
  return -(piece.drain_a + kPerSpeedA * std::abs(k.v_mps) + kPerPivotA * pivot_radps);
}

BatteryState Battery::after(const BatteryPiece& piece, const Kinematics& k, double tau_s) {
  BatteryState state = piece.start;
  if (tau_s <= 0) {
    return state;
  }
  const double ah = ampere_hours(piece, k, tau_s);
  const bool charging = piece.mode == BatteryMode::constant || piece.mode == BatteryMode::taper;
  (charging ? state.charged_ah : state.discharged_ah) += ah;
  const double change = ah / state.capacity_ah;
  state.soc += charging ? change : -change;
  state.variation += change;
  const double mean_a = ah * 3600 / tau_s;
  const double kept = std::exp(-tau_s / kHeatTimeS);
  state.heat_k = kHeatPerA2 * mean_a * mean_a * (1 - kept) + state.heat_k * kept;
  return state;
}

double Battery::voltage_v(double soc, double current_a, double age_s) const {
  const double days = age_s / 86400;
  const double resistance = scenario_.internal_resistance_ohm * (1 + scenario_.resistance_growth_per_day * days);
  return scenario_.nominal_voltage * open_circuit_ratio(soc) + current_a * resistance;
}

double Battery::temperature_c(double heat_k, Micros t_us) {
  constexpr Micros kDay = 86'400'000'000;
  const double hour = static_cast<double>(t_us % kDay) * 24 / static_cast<double>(kDay);
  return 20 + 4 * std::cos(2 * std::numbers::pi * (hour - 15) / 24) + heat_k;
}

}  // namespace tacho::sim
