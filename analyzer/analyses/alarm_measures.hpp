#pragma once
// Measures over alarm intervals: floods, chattering, fleeting and stale alarms, scatter of daily counts. Pure
// functions. Standards: flood and rate figures as in ANSI/ISA-18.2-2016, IEC 62682:2014 and EEMUA 191.

#include <span>
#include <vector>

#include "analyzer/analyses/alarm_tracker.hpp"

namespace tacho {

/// An onset that counts, with its bounds.
struct Raise {
  Micros lo_us = 0;
  Micros hi_us = 0;
  AlarmKey key;
  std::size_t robot = 0;  ///< index of the robot it belongs to
  [[nodiscard]] Micros mid_us() const { return lo_us + (hi_us - lo_us) / 2; }
};

/// The onsets that count (AlarmInterval::counts), by their middle.
std::vector<Raise> raises_of(std::span<const AlarmInterval> intervals, std::size_t robot);
void sort_by_middle(std::vector<Raise>& raises);

struct FloodRule {
  Micros window_us = 600'000'000;
  std::size_t above = 10;  ///< starts when more than this many fall into the window
  std::size_t below = 5;   ///< ends when fewer than this many are left in it
};
struct Flood {
  Micros from_us = 0;
  Micros to_us = 0;
  std::size_t raises = 0;  ///< from the oldest in the first window to the last before the end
  std::size_t peak = 0;    ///< most in one window
  Raise first_out;         ///< oldest in the window that started it
};
/// `raises` sorted by middle; floods that last to the end of the record stop at `end_us`.
std::vector<Flood> find_floods(std::span<const Raise> raises, const FloodRule& rule, Micros end_us);

struct ChatterRule {
  Micros window_us = 60'000'000;
  std::size_t raises = 3;
};
struct Chatter {
  bool sure = false;      ///< whatever the true onsets inside their bounds
  bool possible = false;  ///< for some onsets inside their bounds
  std::size_t most = 0;   ///< most onset middles in one window
  std::size_t runs = 0;   ///< separate times of chattering, by middles
  double index = 0.0;     ///< sum of P_r / r over run lengths r >= 1 s, from middles
  double index_lo = 0.0;
  double index_hi = 0.0;
  Micros from_us = 0;  ///< first time of chattering, if any
  Micros to_us = 0;
};
/// `raises` of one key of one robot, sorted by middle.
Chatter chattering(std::span<const Raise> raises, const ChatterRule& rule);

struct Lasting {
  std::int64_t sure = 0;
  std::int64_t possible = 0;  ///< sure ones included
};
/// Alarms shorter than `limit_s`. Those whose end is not known can only be possible ones.
Lasting fleeting(std::span<const AlarmInterval> intervals, double limit_s);
/// Alarms active for longer than `limit_s`.
Lasting stale(std::span<const AlarmInterval> intervals, double limit_s);

/// Variance over mean of counts that have unequal exposures: Pearson chi-square over degrees of freedom. 1 for a
/// Poisson process; empty below five intervals or five events.
std::optional<double> dispersion(std::span<const double> counts, std::span<const double> exposures);

}  // namespace tacho
