#pragma once
// The path of SoC: turning points, equivalent full cycles two ways (B2), rainflow (B3), and what gaps may have hidden.
//
// EFC by SoC = 1/2 sum |dSoC| of the turning points after a hysteresis h = max(quantum, 1 %), raised to 6 sigma when
// SoC is noisy. Quantum and noise are only known at the end, so a small ladder of h runs beside each other; two finer
// rungs tell how much the hysteresis may have swallowed.
//
// A gap is bridged by its change of SoC (a lower bound, "bridged"). What may have happened inside is bounded: with
// charge rate c and discharge rate d, a gap of T hours with change x has time a = (x + d T) / (c + d) of charging, so
// the variation is c a + d (T - a). Mean rates of the record give the estimate ("hidden"), the fastest quarter of an
// hour seen gives the upper limit.

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "analyzer/analyses/battery_rows.hpp"
#include "analyzer/math/rainflow.hpp"
#include "analyzer/math/sum.hpp"

namespace tacho::battery {

inline constexpr std::array<double, 5> kHysteresis{0.01, 0.02, 0.05, 0.10, 0.25};
using PerRung = std::array<double, kHysteresis.size()>;

struct SocGap {
  Micros from_us = 0;
  Micros to_us = 0;
  double change = 0.0;
  [[nodiscard]] double hours() const { return static_cast<double>(to_us - from_us) / 3.6e9; }
};

/// Resolution of the reported SoC: the largest of a ladder of which 99.9 % of the values are whole multiples.
class SocQuantum {
 public:
  void add(double soc);
  /// With fewer than 20 changes at most 1 %: a short record must not look coarser than a robot's SoC can be.
  [[nodiscard]] double value() const;
  [[nodiscard]] std::uint64_t changes() const { return changes_; }

 private:
  static constexpr std::array<double, 13> kSteps{0.25,  0.2,   0.1,  0.05, 0.02, 0.01, 0.005,
                                                 0.002, 0.001, 5e-4, 2e-4, 1e-4, 1e-5};
  std::array<std::uint64_t, kSteps.size()> fits_{};
  std::uint64_t changes_ = 0;
  double last_ = kNone;
};

/// Result for one pack.
struct Cycles {
  double quantum = 0.0;
  double sigma_soc = 0.0;  ///< quantum / sqrt 12 and 0.5 % of the battery's own noise
  double noise = 0.0;      ///< of SoC from reading to reading
  std::size_t rung = 0;    ///< of kHysteresis
  double hysteresis = 0.0;
  double by_soc = 0.0;       ///< 1/2 sum |dSoC|, gaps bridged
  double by_rainflow = 0.0;  ///< sum range * count of the same turning points
  double bridged = 0.0;      ///< the part of by_soc that lies in gaps
  double hidden = 0.0;       ///< estimate of what gaps hid on top of that
  double lo = 0.0;           ///< of total(): hard limits for rounding, hysteresis, polling and gaps
  double hi = 0.0;
  std::size_t turns = 0;
  double observed_h = 0.0;
  double gap_h = 0.0;         ///< bridged gaps
  double left_out_h = 0.0;    ///< gaps longer than bridge_max_h
  double charge_per_h = 0.0;  ///< mean rates of SoC, rising and falling
  double discharge_per_h = 0.0;
  double mean_soc = kNone;  ///< of cycles, weighted by their charge
  double largest = 0.0;     ///< range
  std::vector<RainflowCycle> cycles;
  std::vector<SocGap> gaps;
  [[nodiscard]] double total() const { return by_soc + hidden; }
};

class SocPath {
 public:
  explicit SocPath(const Config& config);
  void step(const Row& row, std::int32_t day);
  /// Ends the record. Call once.
  Cycles finish();
  /// EFC so far on each rung, gaps bridged.
  [[nodiscard]] PerRung so_far() const;
  /// EFC of each day on each rung.
  [[nodiscard]] const std::map<std::int32_t, PerRung>& days() const { return days_; }
  [[nodiscard]] bool any() const { return any_; }

 private:
  struct Rung {
    TurningPoints filter{0.0};
    Rainflow flow;
    std::vector<RainflowCycle> cycles;
    double last_turn = kNone;
    Sum variation;      // of turning points
    double path = 0.0;  // of the filtered path, runs ahead of variation
    double bridged = 0.0;
    double risen = 0.0;  // observed variation and time, rising and falling
    double fallen = 0.0;
    double rising_s = 0.0;
    double falling_s = 0.0;
    double mark_s = 0.0;
    std::size_t turns = 0;
  };
  Config config_;
  std::array<Rung, kHysteresis.size()> rungs_;
  static constexpr std::array<double, 2> kFine{0.0025, 0.005};
  std::array<TurningPoints, kFine.size()> fine_;
  std::array<double, kFine.size()> fine_path_{};
  std::map<std::int32_t, PerRung> days_;
  std::vector<SocGap> gaps_;
  std::uint64_t steps_ = 0;  // joined
  SocQuantum quantum_;
  bool any_ = false;
  Micros t_us_ = 0;
  double soc_ = kNone;
  double before_ = kNone;  // the reading before soc_, when joined
  double observed_s_ = 0.0;
  double left_out_s_ = 0.0;
  double window_s_ = 0.0;  // of the quarter of an hour being measured
  double window_soc_ = kNone;
  double fastest_up_ = 0.0;  // per hour
  double fastest_down_ = 0.0;
  static constexpr std::size_t kBins = 61;  // second differences, ten per decade from 1e-6 up
  std::array<std::uint64_t, kBins> bends_{};
  std::uint64_t bend_count_ = 0;

  void restart();
  void push(const Row& row, PerRung& day, bool bridge);
  void turn(Rung& rung, double value, Micros at);
  void measure(const Row& row);
  [[nodiscard]] double noise() const;
  void bound(Cycles& out, double swallowed) const;
  [[nodiscard]] double hysteresis(std::size_t rung) const;
};

}  // namespace tacho::battery
