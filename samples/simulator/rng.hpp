#pragma once
// Random numbers that are the same everywhere: SplitMix64 and inverse transforms instead of std:: distributions, whose
// output depends on the library.

#include <cmath>
#include <cstdint>
#include <numbers>

namespace tacho::sim {

constexpr std::uint64_t mix64(std::uint64_t z) {
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
  return z ^ (z >> 31);
}

/// 0 <= value < 1 from the upper 53 bits.
constexpr double unit_interval(std::uint64_t bits) { return static_cast<double>(bits >> 11) * 0x1p-53; }

/// A sequence. Each part of a robot has its own `stream`, so that a change in one does not move the others.
class Rng {
 public:
  Rng(std::uint64_t seed, std::uint64_t stream) : state_(mix64(seed) ^ mix64(stream * 0xD1342543DE82EF95u + 1)) {}
  std::uint64_t next() { return mix64(state_ += 0x9E3779B97F4A7C15u); }
  double uniform() { return unit_interval(next()); }
  double uniform(double lo, double hi) { return lo + (hi - lo) * uniform(); }
  double exponential(double mean) { return -mean * std::log1p(-uniform()); }
  bool chance(double probability) { return uniform() < probability; }

 private:
  std::uint64_t state_;
};

/// Noise as a function of (seed, time, channel): asking twice, or asking less often, gives the same values.
class Noise {
 public:
  Noise(std::uint64_t seed, std::int64_t t_us) : key_(mix64(mix64(seed) + static_cast<std::uint64_t>(t_us))) {}
  [[nodiscard]] double uniform(std::uint64_t channel) const { return unit_interval(bits(2 * channel)); }
  /// Standard normal (Box-Muller).
  [[nodiscard]] double normal(std::uint64_t channel) const {
    const double u = unit_interval(bits(2 * channel));
    return std::sqrt(-2.0 * std::log1p(-u)) * std::cos(2.0 * std::numbers::pi * unit_interval(bits(2 * channel + 1)));
  }

 private:
  std::uint64_t key_;
  [[nodiscard]] std::uint64_t bits(std::uint64_t i) const { return mix64(key_ + 0x9E3779B97F4A7C15u * (i + 1)); }
};

}  // namespace tacho::sim
