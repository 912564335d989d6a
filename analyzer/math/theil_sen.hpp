#pragma once
// Line through points by the median of all pair slopes (Theil 1950, Sen 1968), with limits, without listing the pairs.

#include <cstdint>
#include <optional>
#include <span>

namespace tacho {

/// slope and median(y) - slope * median(x).
struct SlopeLine {
  double slope = 0.0;
  double intercept = 0.0;
  double lo = 0.0;  ///< 95 % limits of the slope: ranks (N -+ 1.96 sqrt(f Var)) / 2 of the N pair slopes, rounded as
  double hi = 0.0;  ///< scipy.stats.theilslopes does; Var is Kendall's, ties counted
  std::uint64_t pairs = 0;  ///< N: pairs with different x
};

struct SlopeOptions {
  double factor = 1.0;                  ///< f: variance factor for autocorrelation (trend.hpp)
  std::uint64_t brute_pairs = 200'000;  ///< up to so many pairs are simply listed; both ways give the same numbers
  std::uint64_t seed = 1;               ///< of the random pairs; changes the time taken, not the result
};

/// Exact in O(n log n) by randomised interval selection over merge-sort counts (Matousek 1991). Any order of x, ties
/// allowed, no NaN, fewer than 2^32 points; empty when no two x differ.
std::optional<SlopeLine> theil_sen(std::span<const double> x, std::span<const double> y, SlopeOptions options = {});

/// Variance of Kendall's S for these values without trend: (n(n-1)(2n+5) - sum over ties t(t-1)(2t+5)) / 18.
double kendall_variance(std::span<const double> values);

}  // namespace tacho
