#include "analyzer/math/trend.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numeric>

#include "analyzer/math/bootstrap.hpp"

namespace tacho {
namespace {

/// Correlation of `v` with itself `lag` later, normalised by the variance of all of `v` (0 when nothing varies).
class Autocorrelation {
 public:
  explicit Autocorrelation(std::vector<double> v) : v_(std::move(v)) {
    const double mean = std::accumulate(v_.begin(), v_.end(), 0.0) / static_cast<double>(v_.size());
    for (double& x : v_) {
      x -= mean;
    }
    power_ = std::inner_product(v_.begin(), v_.end(), v_.begin(), 0.0);
  }
  [[nodiscard]] double at(std::size_t lag) const {
    if (power_ <= 0.0) {
      return 0.0;
    }
    const auto end = v_.end() - static_cast<std::ptrdiff_t>(lag);
    return std::inner_product(v_.begin(), end, v_.begin() + static_cast<std::ptrdiff_t>(lag), 0.0) / power_;
  }
  [[nodiscard]] bool flat() const { return power_ <= 0.0; }

 private:
  std::vector<double> v_;
  double power_ = 0.0;
};

}  // namespace

std::uint64_t inversions(std::vector<double> values) {
  std::vector<double> buffer(values.size());
  std::uint64_t count = 0;
  for (std::size_t width = 1; width < values.size(); width *= 2) {
    for (std::size_t begin = 0; begin < values.size(); begin += 2 * width) {
      const std::size_t middle = std::min(begin + width, values.size());
      const std::size_t end = std::min(begin + 2 * width, values.size());
      std::size_t left = begin;
      std::size_t right = middle;
      for (std::size_t out = begin; out < end; ++out) {
        if (left < middle && (right == end || values[left] <= values[right])) {
          buffer[out] = values[left++];
        } else {
          count += middle - left;
          buffer[out] = values[right++];
        }
      }
    }
    values.swap(buffer);
  }
  return count;
}

std::vector<double> mean_ranks(std::span<const double> values) {
  std::vector<std::size_t> order(values.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return values[a] < values[b]; });
  std::vector<double> ranks(values.size());
  for (std::size_t begin = 0, end = 0; begin < order.size(); begin = end) {
    while (end < order.size() && values[order[end]] == values[order[begin]]) {
      ++end;
    }
    for (std::size_t i = begin; i < end; ++i) {
      ranks[order[i]] = static_cast<double>(begin + 1 + end) / 2.0;
    }
  }
  return ranks;
}

double MannKendall::z(double factor) const {
  const double scaled = variance * factor;
  if (s == 0 || scaled <= 0.0) {
    return 0.0;
  }
  return static_cast<double>(s > 0 ? s - 1 : s + 1) / std::sqrt(scaled);
}

double MannKendall::p(double factor) const { return std::erfc(std::abs(z(factor)) / std::sqrt(2.0)); }

MannKendall mann_kendall(std::span<const double> y) {
  std::vector<double> sorted(y.begin(), y.end());
  std::sort(sorted.begin(), sorted.end());
  const auto pairs = [](std::size_t n) {
    return static_cast<std::int64_t>(n) * (static_cast<std::int64_t>(n) - 1) / 2;
  };
  std::int64_t different = pairs(y.size());
  for (std::size_t begin = 0, end = 0; begin < sorted.size(); begin = end) {
    while (end < sorted.size() && sorted[end] == sorted[begin]) {
      ++end;
    }
    different -= pairs(end - begin);
  }
  const auto falls = static_cast<std::int64_t>(inversions({y.begin(), y.end()}));
  return {different - 2 * falls, kendall_variance(y)};
}

double variance_factor(std::span<const double> detrended) {
  const double n = static_cast<double>(detrended.size());
  if (detrended.size() < 5) {
    return 1.0;
  }
  const Autocorrelation ranks(mean_ranks(detrended));
  if (ranks.flat()) {
    return 1.0;
  }
  const double rho = std::min(0.98, (n * ranks.at(1) + 2.0) / (n - 4.0));
  double factor = 1.0;
  double power = 1.0;
  for (std::size_t k = 1; k < detrended.size() && std::abs(power) > 1e-17; ++k) {
    power *= rho;
    factor += 2.0 * (1.0 - static_cast<double>(k) / n) * power;
  }
  return std::max(0.1, factor);
}

double hamed_rao_factor(std::span<const double> detrended, std::size_t max_lag) {
  if (detrended.size() < 3) {
    return 1.0;
  }
  const double n = static_cast<double>(detrended.size());
  const Autocorrelation ranks(mean_ranks(detrended));
  const double significant = kZ95 / std::sqrt(n);
  double sum = 0.0;
  for (std::size_t lag = 1; lag <= std::min(max_lag, detrended.size() - 1); ++lag) {
    const double k = static_cast<double>(lag);
    const double r = ranks.at(lag);
    sum += std::abs(r) > significant ? (n - k) * (n - k - 1) * (n - k - 2) * r : 0.0;
  }
  return 1.0 + 2.0 / (n * (n - 1) * (n - 2)) * sum;
}

std::optional<Trend> find_trend(std::span<const double> x, std::span<const double> y) {
  assert(x.size() == y.size());
  if (x.size() < 5) {
    return std::nullopt;
  }
  std::optional<SlopeLine> line = theil_sen(x, y);
  if (!line) {
    return std::nullopt;
  }
  std::vector<double> rest(y.begin(), y.end());
  for (std::size_t i = 0; i < rest.size(); ++i) {
    rest[i] -= line->slope * x[i];
  }
  Trend trend;
  trend.n = x.size();
  trend.test = mann_kendall(y);
  trend.factor = variance_factor(rest);
  SlopeOptions options;
  options.factor = trend.factor;
  trend.line = *theil_sen(x, y, options);
  trend.p = trend.test.p(trend.factor);
  trend.p_plain = trend.test.p();
  constexpr std::size_t kLags = 1'000;
  const double hamed_rao = hamed_rao_factor(rest, kLags);
  if (hamed_rao > 0.0) {
    trend.p_hamed_rao = trend.test.p(hamed_rao);
  }
  return trend;
}

}  // namespace tacho
