#include "analyzer/math/bootstrap.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

#include "analyzer/math/robust.hpp"

namespace tacho {

namespace {

/// Calls visit(begin, end) for the blocks of one draw.
template <class Visit>
void draw_blocks(SplitMix& random, std::size_t n, std::size_t block, const Visit& visit) {
  block = std::clamp<std::size_t>(block, 1, n);
  for (std::size_t taken = 0; taken < n;) {
    const std::size_t begin = random.below(n - block + 1);
    const std::size_t length = std::min(block, n - taken);
    visit(begin, begin + length);
    taken += length;
  }
}

Limits percentiles(const std::vector<double>& results) {
  std::vector<double> finite;
  std::copy_if(results.begin(), results.end(), std::back_inserter(finite), [](double v) { return std::isfinite(v); });
  return {quantile(finite, 0.025), quantile(finite, 0.975)};
}

std::vector<double> prefix_sums(std::span<const double> values) {
  std::vector<double> sums(values.size() + 1, 0.0);
  std::partial_sum(values.begin(), values.end(), sums.begin() + 1);
  return sums;
}

}  // namespace

std::string too_few_to_draw(std::size_t elements, std::size_t block) {
  if (elements >= 2 * block) {
    return "";
  }
  return elements <= block ? "no interval: one stretch only" : "no interval: fewer than two independent stretches";
}

Limits around(double value, Limits limits) { return {std::min(limits.lo, value), std::max(limits.hi, value)}; }

Limits bootstrap_ratio(std::span<const double> numerator, std::span<const double> denominator,
                       const BootstrapOptions& options) {
  assert(numerator.size() == denominator.size());
  const std::vector<double> top = prefix_sums(numerator);
  const std::vector<double> bottom = prefix_sums(denominator);
  std::vector<double> results;
  SplitMix random(options.seed);
  for (int draw = 0; draw < options.draws && !numerator.empty(); ++draw) {
    double a = 0.0;
    double b = 0.0;
    draw_blocks(random, numerator.size(), options.block, [&](std::size_t begin, std::size_t end) {
      a += top[end] - top[begin];
      b += bottom[end] - bottom[begin];
    });
    results.push_back(a / b);
  }
  return percentiles(results);
}

Limits bootstrap_weighted_median(std::span<const double> values, std::span<const double> weights,
                                 const BootstrapOptions& options) {
  assert(values.size() == weights.size());
  const std::size_t n = values.size();
  std::vector<std::size_t> order(n);
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return values[a] < values[b]; });
  std::vector<double> drawn(n);
  std::vector<double> results;
  SplitMix random(options.seed);
  for (int draw = 0; draw < options.draws && n > 0; ++draw) {
    std::fill(drawn.begin(), drawn.end(), 0.0);
    double total = 0.0;
    draw_blocks(random, n, options.block, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        drawn[i] += weights[i];
        total += weights[i];
      }
    });
    double sum = 0.0;
    const auto middle = std::find_if(order.begin(), order.end(), [&](std::size_t i) {
      sum += drawn[i];
      return sum >= total / 2.0;
    });
    results.push_back(values[middle == order.end() ? order.back() : *middle]);
  }
  return percentiles(results);
}

PairLimits bootstrap_two_slopes(std::span<const double> y, std::span<const double> u, std::span<const double> v,
                                const BootstrapOptions& options) {
  assert(y.size() == u.size() && y.size() == v.size());
  std::vector<double> as;
  std::vector<double> bs;
  SplitMix random(options.seed);
  for (int draw = 0; draw < options.draws && !y.empty(); ++draw) {
    double uu = 0.0, uv = 0.0, vv = 0.0, uy = 0.0, vy = 0.0;
    draw_blocks(random, y.size(), options.block, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        uu += u[i] * u[i];
        uv += u[i] * v[i];
        vv += v[i] * v[i];
        uy += u[i] * y[i];
        vy += v[i] * y[i];
      }
    });
    const double det = uu * vv - uv * uv;
    as.push_back((vv * uy - uv * vy) / det);
    bs.push_back((uu * vy - uv * uy) / det);
  }
  return {percentiles(as), percentiles(bs)};
}

}  // namespace tacho
