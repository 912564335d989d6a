#include "recorder/pace.hpp"

#include <algorithm>
#include <cstdlib>
#include <utility>

namespace tacho::recorder {

namespace {

constexpr Micros kShortest = 10'000;  // pushes that were waiting together come at once

Micros rounded(Micros us) {
  const Micros step = us < 100'000 ? 1'000 : 10'000;
  return std::max(kShortest, (us + step / 2) / step * step);
}

}  // namespace

std::optional<Micros> Pace::hear(Micros mono_us) {
  const std::optional<Micros> before = std::exchange(last_us_, mono_us);
  if (!before) {
    return std::nullopt;
  }
  intervals_[count_++ % kIntervals] = mono_us - *before;
  if (count_ < kIntervals) {
    return std::nullopt;
  }
  std::array<Micros, kIntervals> sorted = intervals_;
  std::sort(sorted.begin(), sorted.end());
  const Micros median = rounded(sorted[kIntervals / 2]);
  if (std::abs(median - period_us_) * 5 <= period_us_) {
    return std::nullopt;
  }
  count_ = 0;
  return period_us_ = median;
}

}  // namespace tacho::recorder
