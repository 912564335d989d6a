#pragma once
// Limits of a share k of n (Wilson 1927): good also for k = 0 and k = n, where the other limit is n/(n + z^2).

#include <cmath>

#include "analyzer/math/bootstrap.hpp"

namespace tacho {

/// 95 % limits; n > 0.
inline Limits wilson(double k, double n) {
  const double p = k / n;
  const double z2 = kZ95 * kZ95;
  const double centre = (p + z2 / (2.0 * n)) / (1.0 + z2 / n);
  const double half = kZ95 * std::sqrt(p * (1.0 - p) / n + z2 / (4.0 * n * n)) / (1.0 + z2 / n);
  return {k == 0.0 ? 0.0 : centre - half, k == n ? 1.0 : centre + half};
}

}  // namespace tacho
