#include "analyzer/math/shrinkage.hpp"

#include <algorithm>
#include <numeric>

namespace tacho::math {

double Shrinkage::weight(double exposure) const {
  if (!(exposure > 0.0) || between <= 0.0) {
    return 0.0;
  }
  return between / (between + mean / exposure);
}

double Shrinkage::rate(double k, double exposure) const {
  return exposure > 0.0 ? mean + weight(exposure) * (k / exposure - mean) : mean;
}

Shrinkage shrinkage(std::span<const double> counts, std::span<const double> exposures) {
  double k = 0.0;
  double e = 0.0;
  double places = 0.0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    if (exposures[i] > 0.0) {
      k += counts[i];
      e += exposures[i];
      places += 1.0;
    }
  }
  Shrinkage out;
  if (!(e > 0.0)) {
    return out;
  }
  out.mean = k / e;
  double spread = 0.0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    if (exposures[i] > 0.0) {
      const double off = counts[i] / exposures[i] - out.mean;
      spread += exposures[i] * off * off;
    }
  }
  out.between = std::max(0.0, spread / e - out.mean / (e / places));
  return out;
}

std::vector<double> false_discovery_rates(std::span<const double> p_values) {
  std::vector<std::size_t> order(p_values.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return p_values[a] < p_values[b]; });
  std::vector<double> q(p_values.size());
  double least = 1.0;
  for (std::size_t rank = order.size(); rank > 0; --rank) {
    const std::size_t i = order[rank - 1];
    least = std::min(least, p_values[i] * static_cast<double>(order.size()) / static_cast<double>(rank));
    q[i] = least;
  }
  return q;
}

}  // namespace tacho::math
