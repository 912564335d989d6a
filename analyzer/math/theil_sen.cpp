#include "analyzer/math/theil_sen.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>
#include <vector>

#include "analyzer/math/bootstrap.hpp"
#include "analyzer/math/robust.hpp"

namespace tacho {
namespace {

using Index = std::uint32_t;

/// Sorts `values` by merging and calls visit(count_so_far, first, last, right): the left values [first, last) are each
/// inverted with `right`. Returns the number of inversions.
template <class Visit>
std::uint64_t merge_inversions(std::vector<Index>& values, Visit&& visit) {
  std::vector<Index> buffer(values.size());
  std::uint64_t count = 0;
  for (std::size_t width = 1; width < values.size(); width *= 2) {
    for (std::size_t begin = 0; begin < values.size(); begin += 2 * width) {
      const std::size_t middle = std::min(begin + width, values.size());
      const std::size_t end = std::min(begin + 2 * width, values.size());
      std::size_t left = begin;
      std::size_t right = middle;
      for (std::size_t out = begin; out < end; ++out) {
        if (left < middle && (right == end || values[left] < values[right])) {
          buffer[out] = values[left++];
          continue;
        }
        visit(count, &values[left], middle - left, values[right]);
        count += middle - left;
        buffer[out] = values[right++];
      }
    }
    values.swap(buffer);
  }
  return count;
}

/// The points in ascending x, and the order they have along lines of a given slope: a pair of points changes its order
/// exactly when the slope passes the slope of the pair.
class PairSlopes {
 public:
  PairSlopes(std::span<const double> x, std::span<const double> y, const SlopeOptions& options)
      : options_(options), random_(options.seed) {
    std::vector<Index> by_x(x.size());
    std::iota(by_x.begin(), by_x.end(), Index{0});
    std::sort(by_x.begin(), by_x.end(),
              [&](Index a, Index b) { return x[a] != x[b] ? x[a] < x[b] : (y[a] != y[b] ? y[a] < y[b] : a < b); });
    for (const Index i : by_x) {
      x_.push_back(x[i]);
      y_.push_back(y[i]);
    }
    measure();
  }

  [[nodiscard]] std::uint64_t count() const { return count_; }

  /// Mean of the slopes of rank first and last (from 0; last is first or first + 1).
  double between(std::uint64_t first, std::uint64_t last) {
    Bound low{order(-std::numeric_limits<double>::infinity()), 0};
    Bound high{order(std::numeric_limits<double>::infinity()), count_};
    while (high.below - low.below > options_.brute_pairs) {
      const std::uint64_t before = high.below - low.below;
      if (const std::optional<double> tie = narrow(low, high, first, last)) {
        return *tie;
      }
      if (high.below - low.below == before) {
        return stuck(low, high, first, last);
      }
    }
    std::vector<double> slopes;
    slopes.reserve(high.below - low.below);
    std::vector<Index> ranks = ranks_of(low, high);
    merge_inversions(ranks, [&](std::uint64_t, const Index* left, std::size_t n, Index right) {
      for (std::size_t i = 0; i < n; ++i) {
        slopes.push_back(slope(low.order[left[i]], low.order[right]));
      }
    });
    const auto at = [&](std::uint64_t rank) {
      const auto nth = slopes.begin() + static_cast<std::ptrdiff_t>(std::min(rank - low.below, slopes.size() - 1));
      std::nth_element(slopes.begin(), nth, slopes.end());
      return *nth;
    };
    const double a = at(first);
    return first == last ? a : (a + at(last)) / 2;
  }

 private:
  /// A slope as the order of points it makes, and how many pairs are steeper downwards than it.
  struct Bound {
    std::vector<Index> order;
    std::uint64_t below = 0;
  };
  SlopeOptions options_;
  std::mt19937_64 random_;
  std::vector<double> x_, y_;
  std::uint64_t count_ = 0;
  double least_dx_ = std::numeric_limits<double>::infinity();
  double greatest_y_ = 0.0;

  void measure() {
    const std::uint64_t n = x_.size();
    count_ = n * (n - 1) / 2;
    std::uint64_t same = 1;
    for (std::size_t i = 1; i < n; ++i) {
      if (x_[i] == x_[i - 1]) {
        count_ -= same++;
      } else {
        same = 1;
        least_dx_ = std::min(least_dx_, x_[i] - x_[i - 1]);
      }
    }
    for (const double y : y_) {
      greatest_y_ = std::max(greatest_y_, std::abs(y));
    }
  }

  [[nodiscard]] double slope(Index a, Index b) const { return (y_[b] - y_[a]) / (x_[b] - x_[a]); }

  /// Slopes closer to `b` than this may be counted on its wrong side.
  [[nodiscard]] double doubt(double b) const {
    constexpr double kUlps = 8.0 * static_cast<double>(std::numeric_limits<long double>::epsilon());
    const double reach = greatest_y_ + std::abs(b) * (x_.back() - x_.front());
    return std::max(kUlps * reach / least_dx_, std::abs(b) * std::numeric_limits<double>::epsilon());
  }

  [[nodiscard]] std::vector<Index> order(double b) const {
    struct Key {
      long double z;
      Index i;
    };
    std::vector<Key> keys(x_.size());
    for (Index i = 0; i < keys.size(); ++i) {
      const auto dx = static_cast<long double>(x_[i]) - static_cast<long double>(x_[0]);
      keys[i] = {
          std::isinf(b) ? (b < 0 ? dx : -dx) : static_cast<long double>(y_[i]) - static_cast<long double>(b) * dx, i};
    }
    std::sort(keys.begin(), keys.end(), [](const Key& p, const Key& q) { return p.z != q.z ? p.z < q.z : p.i < q.i; });
    std::vector<Index> out(keys.size());
    std::transform(keys.begin(), keys.end(), out.begin(), [](const Key& key) { return key.i; });
    return out;
  }

  [[nodiscard]] Bound bound(double b) const {
    Bound out{order(b), 0};
    std::vector<Index> copy = out.order;
    out.below = merge_inversions(copy, [](std::uint64_t, const Index*, std::size_t, Index) {});
    return out;
  }

  /// The points in the order of `high`, each named by its place in the order of `low`: inversions are the pairs
  /// between.
  static std::vector<Index> ranks_of(const Bound& low, const Bound& high) {
    std::vector<Index> place(low.order.size());
    for (Index r = 0; r < place.size(); ++r) {
      place[low.order[r]] = r;
    }
    std::vector<Index> ranks(place.size());
    std::transform(high.order.begin(), high.order.end(), ranks.begin(), [&](Index i) { return place[i]; });
    return ranks;
  }

  /// Slopes of `size` random pairs between the bounds, sorted.
  std::vector<double> sample(const Bound& low, const Bound& high, std::size_t size) {
    std::vector<std::uint64_t> wanted(size);
    for (std::uint64_t& w : wanted) {
      w = random_() % (high.below - low.below);
    }
    std::sort(wanted.begin(), wanted.end());
    std::vector<double> slopes;
    std::size_t next = 0;
    std::vector<Index> ranks = ranks_of(low, high);
    merge_inversions(ranks, [&](std::uint64_t before, const Index* left, std::size_t n, Index right) {
      for (; next < wanted.size() && wanted[next] < before + n; ++next) {
        slopes.push_back(slope(low.order[left[wanted[next] - before]], low.order[right]));
      }
    });
    std::sort(slopes.begin(), slopes.end());
    return slopes;
  }

  /// Moves the bounds closer round the ranks. Returns the answer when so many pairs share one slope that it must be it.
  std::optional<double> narrow(Bound& low, Bound& high, std::uint64_t first, std::uint64_t last) {
    const std::uint64_t pairs = high.below - low.below;
    const std::vector<double> s = sample(low, high, std::max<std::size_t>(1'000, x_.size()));
    const double m = static_cast<double>(s.size());
    const double middle = (static_cast<double>(first - low.below) + 0.5) / static_cast<double>(pairs) * m;
    const double spread = 2.0 * std::sqrt(m) + 2.0;
    const double a = s[static_cast<std::size_t>(std::clamp(middle - spread, 0.0, m - 1.0))];
    const double c = s[static_cast<std::size_t>(std::clamp(middle + spread, 0.0, m - 1.0))];
    Bound below_a = bound(a - 2 * doubt(a));
    Bound above_c = bound(c + 2 * doubt(c));
    const bool inside = below_a.below <= first && last < above_c.below;
    if (inside && a == c) {
      return a;
    }
    const bool left = last < below_a.below;
    const bool right = above_c.below <= first;
    if (left) {
      high = std::move(below_a);
    } else if (right) {
      low = std::move(above_c);
    } else {
      if (below_a.below <= first && below_a.below > low.below) {
        low = std::move(below_a);
      }
      if (last < above_c.below && above_c.below < high.below) {
        high = std::move(above_c);
      }
    }
    if (high.below - low.below > pairs / 2) {
      split(low, high, a + (c - a) / 2, first, last);
    }
    return std::nullopt;
  }

  /// No cut leaves both ranks on one side, or the remaining slopes differ by roundings only.
  double stuck(const Bound& low, const Bound& high, std::uint64_t first, std::uint64_t last) {
    if (first != last) {
      return (between(first, first) + between(last, last)) / 2;
    }
    const std::vector<double> s = sample(low, high, 1'001);
    const double share = static_cast<double>(first - low.below) / static_cast<double>(high.below - low.below);
    return s[static_cast<std::size_t>(share * 1'000.0)];
  }

  /// Two crowded slopes with the ranks on their border: cut between them.
  void split(Bound& low, Bound& high, double b, std::uint64_t first, std::uint64_t last) {
    Bound cut = bound(b);
    if (last < cut.below) {
      high = std::move(cut);
    } else if (cut.below <= first) {
      low = std::move(cut);
    }
  }
};

}  // namespace

double kendall_variance(std::span<const double> values) {
  std::vector<double> v(values.begin(), values.end());
  std::sort(v.begin(), v.end());
  const auto term = [](double n) { return n * (n - 1) * (2 * n + 5); };
  double sum = term(static_cast<double>(v.size()));
  for (std::size_t begin = 0, end = 0; begin < v.size(); begin = end) {
    while (end < v.size() && v[end] == v[begin]) {
      ++end;
    }
    sum -= end - begin > 1 ? term(static_cast<double>(end - begin)) : 0.0;
  }
  return sum / 18.0;
}

std::optional<SlopeLine> theil_sen(std::span<const double> x, std::span<const double> y, SlopeOptions options) {
  assert(x.size() == y.size());
  if (x.size() < 2) {
    return std::nullopt;
  }
  options.brute_pairs = std::max<std::uint64_t>(options.brute_pairs, 4 * x.size());
  PairSlopes slopes(x, y, options);
  if (slopes.count() == 0) {
    return std::nullopt;
  }
  const std::uint64_t n = slopes.count();
  SlopeLine line;
  line.pairs = n;
  line.slope = slopes.between((n - 1) / 2, n / 2);
  line.intercept = median({y.begin(), y.end()}) - line.slope * median({x.begin(), x.end()});

  // Ties of x and of y both lower the variance, as in scipy.
  const double full = static_cast<double>(x.size());
  const double all = full * (full - 1) * (2 * full + 5) / 18.0;
  const double variance = std::max(0.0, kendall_variance(x) + kendall_variance(y) - all) * options.factor;
  const double reach = kZ95 * std::sqrt(variance);
  const double total = static_cast<double>(n);
  const double low = std::nearbyint((total - reach) / 2) - 1;
  const double high = std::nearbyint((total + reach) / 2);
  const auto rank = [&](double r) { return static_cast<std::uint64_t>(std::clamp(r, 0.0, total - 1)); };
  line.lo = slopes.between(rank(low), rank(low));
  line.hi = slopes.between(rank(high), rank(high));
  return line;
}

}  // namespace tacho
