#pragma once
// Trends that do not claim too much: Mann-Kendall with ties, its correction for autocorrelation, and the slope of Sen /
// Theil with limits. Definitions: Mann 1945, Kendall 1975, Sen 1968, Hamed & Rao 1998; the variance factor f is that of
// an AR(1) series, from the ranks of the series without its Sen slope.
//
// Everything is deterministic; NaN must be left out by the caller.

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "analyzer/math/theil_sen.hpp"

namespace tacho {

/// Pairs i < j with values[i] > values[j], by merge sort.
std::uint64_t inversions(std::vector<double> values);

/// Ranks from 1; equal values share their mean rank.
std::vector<double> mean_ranks(std::span<const double> values);

struct MannKendall {
  std::int64_t s = 0;     ///< pairs that rise minus pairs that fall
  double variance = 0.0;  ///< of S without trend and without autocorrelation, ties counted
  /// Standard score with continuity correction, its variance multiplied by `factor` (> 0). 0 when nothing varies.
  [[nodiscard]] double z(double factor = 1.0) const;
  /// Two-sided.
  [[nodiscard]] double p(double factor = 1.0) const;
};
MannKendall mann_kendall(std::span<const double> y);

/// f = 1 + 2 sum_{k<n} (1 - k/n) rho^k, at least 0.1, with rho = min(0.98, (n rho1 + 2) / (n - 4)) and rho1 the lag-1
/// correlation of the ranks of `detrended`. 1 for n < 5, and for a series without variation.
double variance_factor(std::span<const double> detrended);

/// 1 + 2 / (n (n-1) (n-2)) * sum (n-k)(n-k-1)(n-k-2) r_k over the lags k <= max_lag whose rank correlation r_k is
/// significant at 5 %. Can be <= 0, then there is no Hamed-Rao p.
double hamed_rao_factor(std::span<const double> detrended, std::size_t max_lag);

/// Steps 1 to 4 of the trend engine.
struct Trend {
  std::size_t n = 0;
  MannKendall test;
  SlopeLine line;  ///< limits widened by `factor`
  double factor = 1.0;
  double p = 1.0;                     ///< the headline: corrected by `factor`
  double p_plain = 1.0;               ///< without correction, for comparison with published values
  std::optional<double> p_hamed_rao;  ///< empty when its variance is not positive
};

/// `x` ascending. Needs at least 5 points.
std::optional<Trend> find_trend(std::span<const double> x, std::span<const double> y);

}  // namespace tacho
