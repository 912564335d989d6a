#include "analyzer/math/robust.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numeric>

namespace tacho {

double median(std::vector<double> values) { return quantile(std::move(values), 0.5); }

double quantile(std::vector<double> values, double share) {
  if (values.empty()) {
    return std::numeric_limits<double>::quiet_NaN();
  }
  const double rank = share * static_cast<double>(values.size() - 1);
  const auto low = static_cast<std::ptrdiff_t>(std::floor(rank));
  std::nth_element(values.begin(), values.begin() + low, values.end());
  const double below = values[static_cast<std::size_t>(low)];
  const double part = rank - static_cast<double>(low);
  if (part == 0.0) {
    return below;
  }
  const double above = *std::min_element(values.begin() + low + 1, values.end());
  return below + part * (above - below);
}

double median_absolute_deviation(const std::vector<double>& values) {
  const double middle = median(values);
  std::vector<double> distance(values.size());
  std::transform(values.begin(), values.end(), distance.begin(), [middle](double v) { return std::abs(v - middle); });
  return median(std::move(distance));
}

double weighted_median(std::span<const double> values, std::span<const double> weights) {
  assert(values.size() == weights.size());
  std::vector<std::size_t> order(values.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return values[a] < values[b]; });
  const double half = std::accumulate(weights.begin(), weights.end(), 0.0) / 2.0;
  double sum = 0.0;
  for (std::size_t k = 0; half > 0.0 && k < order.size(); ++k) {
    sum += weights[order[k]];
    if (sum > half || k + 1 == order.size()) {
      return values[order[k]];
    }
    if (sum == half) {
      return (values[order[k]] + values[order[k + 1]]) / 2.0;
    }
  }
  return std::numeric_limits<double>::quiet_NaN();
}

}  // namespace tacho
