#pragma once
// Locations and scales that a few wild values do not move.

#include <span>
#include <vector>

namespace tacho {

/// Makes a standard deviation of a median absolute deviation, for normal data.
inline constexpr double kMadToSigma = 1.4826;

/// Middle value; mean of the two middle ones for an even count. NaN for an empty input.
double median(std::vector<double> values);

/// Linear interpolation between order statistics (type 7). `share` in 0..1. NaN for an empty input.
double quantile(std::vector<double> values, double share);

/// Median of |value - median(values)|, not scaled.
double median_absolute_deviation(const std::vector<double>& values);

/// The value at which half of the total weight is reached; the mean of two values when exactly half lies on each side.
/// Weights must not be negative; NaN when they sum to 0.
double weighted_median(std::span<const double> values, std::span<const double> weights);

}  // namespace tacho
