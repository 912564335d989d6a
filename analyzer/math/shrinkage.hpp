#pragma once
// Rates of many places with little data each, drawn towards the common rate (empirical Bayes, method of moments), and
// the Benjamini-Hochberg correction for testing all of them.

#include <span>
#include <vector>

namespace tacho::math {

/// Rates k_i / E_i of places with exposures E_i.
struct Shrinkage {
  double mean = 0.0;     ///< m = sum k / sum E
  double between = 0.0;  ///< A = max(0, sum E (r - m)^2 / sum E - m / mean E): variance of true rates
  /// A / (A + m / E): how much a place's own data count, 0..1.
  [[nodiscard]] double weight(double exposure) const;
  /// m + weight (k / E - m).
  [[nodiscard]] double rate(double k, double exposure) const;
};
/// Places without exposure are left out.
Shrinkage shrinkage(std::span<const double> counts, std::span<const double> exposures);

/// q value of each p value: the false discovery rate at which it would just be called significant.
std::vector<double> false_discovery_rates(std::span<const double> p_values);

}  // namespace tacho::math
