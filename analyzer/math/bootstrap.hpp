#pragma once
// Moving-block bootstrap: limits for statistics of series whose neighbours are not independent.
//
// A draw strings together blocks of `block` consecutive elements, each starting at a random place, until it has as many
// elements as the series (the last block is cut). Limits are the 2.5 and 97.5 percentiles over all draws. The same
// input, seed and options give the same limits on every machine: the generator is our own, no std distribution is used.

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

namespace tacho {

/// 97.5 % of a standard normal variable lie below it: 95 % limits are +- so many standard deviations.
inline constexpr double kZ95 = 1.959963984540054;

struct Limits {
  double lo = 0.0;
  double hi = 0.0;
};

struct BootstrapOptions {
  std::size_t block = 1;  ///< elements; longer than the reach of the dependence
  int draws = 999;
  std::uint64_t seed = 20260101;
};

/// Why draws of so many elements would say nothing about how they vary; empty when they do. Two blocks that share no
/// element are the least: of one block every draw is the same, and limits would be as wide as nothing.
std::string too_few_to_draw(std::size_t elements, std::size_t block);

/// The limits, widened where rounding or a skewed sample left the value outside.
Limits around(double value, Limits limits);

/// splitmix64: small, fast, and the same everywhere.
class SplitMix {
 public:
  explicit SplitMix(std::uint64_t seed) : state_(seed) {}
  std::uint64_t next() {
    std::uint64_t z = (state_ += 0x9E3779B97F4A7C15U);
    z = (z ^ (z >> 30U)) * 0xBF58476D1CE4E5B9U;
    z = (z ^ (z >> 27U)) * 0x94D049BB133111EBU;
    return z ^ (z >> 31U);
  }
  /// Uniform in 0 .. bound-1; bound > 0 and below 2^32.
  std::size_t below(std::size_t bound) { return static_cast<std::size_t>(((next() >> 32U) * bound) >> 32U); }
  double uniform() { return static_cast<double>(next() >> 11U) * 0x1.0p-53; }

 private:
  std::uint64_t state_;
};

/// Limits of sum(numerator) / sum(denominator). A mean is a ratio with counts below.
Limits bootstrap_ratio(std::span<const double> numerator, std::span<const double> denominator,
                       const BootstrapOptions& options);

/// Limits of weighted_median(values, weights).
Limits bootstrap_weighted_median(std::span<const double> values, std::span<const double> weights,
                                 const BootstrapOptions& options);

/// Limits of a and b in y = a u + b v by least squares without constant term.
struct PairLimits {
  Limits a;
  Limits b;
};
PairLimits bootstrap_two_slopes(std::span<const double> y, std::span<const double> u, std::span<const double> v,
                                const BootstrapOptions& options);

}  // namespace tacho
