#include "analyzer/math/trend.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>
#include <vector>

#include "tests/support/catch.hpp"

using namespace tacho;

namespace {

std::vector<double> brute_slopes(const std::vector<double>& x, const std::vector<double>& y) {
  std::vector<double> slopes;
  for (std::size_t i = 0; i < x.size(); ++i) {
    for (std::size_t j = i + 1; j < x.size(); ++j) {
      if (x[i] != x[j]) {
        slopes.push_back((y[j] - y[i]) / (x[j] - x[i]));
      }
    }
  }
  std::sort(slopes.begin(), slopes.end());
  return slopes;
}

double middle(const std::vector<double>& sorted) {
  return (sorted[(sorted.size() - 1) / 2] + sorted[sorted.size() / 2]) / 2;
}

std::vector<double> counted(std::size_t n) {
  std::vector<double> x(n);
  std::iota(x.begin(), x.end(), 0.0);
  return x;
}

/// The randomised way for any size.
SlopeOptions selecting(std::uint64_t seed) {
  SlopeOptions options;
  options.brute_pairs = 0;
  options.seed = seed;
  return options;
}

std::vector<double> ar1(std::mt19937& random, std::size_t n, double phi) {
  std::normal_distribution<double> noise;
  std::vector<double> y(n);
  double state = noise(random) / std::sqrt(1 - phi * phi);
  for (double& v : y) {
    v = state;
    state = phi * state + noise(random);
  }
  return y;
}

}  // namespace

TEST_CASE("inversions agree with counting all pairs") {
  std::mt19937 random(1);
  for (int round = 0; round < 300; ++round) {
    std::vector<double> v(random() % 70);
    for (double& x : v) {
      x = static_cast<double>(random() % 20);
    }
    std::uint64_t expected = 0;
    for (std::size_t i = 0; i < v.size(); ++i) {
      for (std::size_t j = i + 1; j < v.size(); ++j) {
        expected += v[i] > v[j] ? 1U : 0U;
      }
    }
    REQUIRE(inversions(v) == expected);
  }
}

TEST_CASE("Mann-Kendall S is the sum of the signs of all pairs, ties give 0") {
  std::mt19937 random(2);
  for (int round = 0; round < 300; ++round) {
    std::vector<double> y(random() % 50);
    for (double& v : y) {
      v = static_cast<double>(random() % 8);
    }
    std::int64_t s = 0;
    for (std::size_t i = 0; i < y.size(); ++i) {
      for (std::size_t j = i + 1; j < y.size(); ++j) {
        s += y[j] > y[i] ? 1 : (y[j] < y[i] ? -1 : 0);
      }
    }
    const MannKendall test = mann_kendall(y);
    REQUIRE(test.s == s);
    std::vector<double> reversed(y.rbegin(), y.rend());
    REQUIRE(mann_kendall(reversed).s == -s);
    REQUIRE(mann_kendall(reversed).p() == test.p());
  }
}

TEST_CASE("the variance of S is that of all orders of the values") {
  // Exact by listing the permutations of six values with one tie of two and one of three.
  std::vector<double> y{1, 1, 2, 3, 3, 3};
  double sum = 0.0;
  double orders = 0.0;
  do {
    const double s = static_cast<double>(mann_kendall(y).s);
    sum += s * s;
    orders += 1;
  } while (std::next_permutation(y.begin(), y.end()));
  CHECK(mann_kendall(y).variance == Approx(sum / orders));
  CHECK(mann_kendall(std::vector<double>{1, 2, 3, 4, 5}).variance == Approx(5.0 * 4.0 * 15.0 / 18.0));
}

TEST_CASE("a rising series of ten has the published S, z and p") {
  const MannKendall test = mann_kendall(counted(10));
  CHECK(test.s == 45);
  CHECK(test.variance == Approx(125.0));
  CHECK(test.z() == Approx(44.0 / std::sqrt(125.0)));
  CHECK(test.p() == Approx(8.3034e-5).epsilon(1e-3));
}

TEST_CASE("a constant series has no trend and divides nothing by zero") {
  const std::vector<double> y(20, 3.5);
  CHECK(mann_kendall(y).z() == 0.0);
  CHECK(mann_kendall(y).p() == 1.0);
  CHECK(variance_factor(y) == 1.0);
  const std::optional<Trend> trend = find_trend(counted(20), y);
  REQUIRE(trend);
  CHECK(trend->line.slope == 0.0);
  CHECK(trend->line.intercept == 3.5);
  CHECK(trend->p == 1.0);
}

TEST_CASE("the slope is the median of all pair slopes, listed or selected") {
  std::mt19937 random(3);
  std::normal_distribution<double> noise;
  for (int round = 0; round < 200; ++round) {
    const std::size_t n = 2 + random() % 200;
    const int kind = round % 5;
    std::vector<double> x(n);
    std::vector<double> y(n);
    for (std::size_t i = 0; i < n; ++i) {
      x[i] = kind == 0 ? static_cast<double>(i) : kind == 1 ? noise(random) : static_cast<double>(random() % 9);
      y[i] = kind <= 1   ? noise(random)
             : kind == 2 ? static_cast<double>(random() % 4)
             : kind == 3 ? 1e6 + noise(random)
                         : 7.0;
    }
    const std::vector<double> all = brute_slopes(x, y);
    const std::optional<SlopeLine> listed = theil_sen(x, y);
    const std::optional<SlopeLine> selected = theil_sen(x, y, selecting(static_cast<std::uint64_t>(round)));
    REQUIRE(listed.has_value() == !all.empty());
    if (all.empty()) {
      continue;
    }
    REQUIRE(listed->pairs == all.size());
    REQUIRE(listed->slope == middle(all));
    REQUIRE(selected->slope == middle(all));
    REQUIRE(selected->lo == listed->lo);
    REQUIRE(selected->hi == listed->hi);
    REQUIRE(std::binary_search(all.begin(), all.end(), listed->lo));
    REQUIRE(listed->lo <= listed->slope);
    REQUIRE(listed->slope <= listed->hi);
  }
}

TEST_CASE("selection is exact on 1500 points, smooth, noisy or full of ties") {
  std::mt19937 random(4);
  std::normal_distribution<double> noise;
  const std::size_t n = 1'500;
  const std::vector<double> x = counted(n);
  for (int kind = 0; kind < 4; ++kind) {
    std::vector<double> y(n);
    for (std::size_t i = 0; i < n; ++i) {
      const double t = static_cast<double>(i);
      y[i] = kind == 0   ? noise(random)
             : kind == 1 ? std::floor(t / 500)
             : kind == 2 ? static_cast<double>(random() % 2)
                         : std::sin(t / 400) + 1e-3 * noise(random);
    }
    const std::vector<double> all = brute_slopes(x, y);
    const SlopeLine line = *theil_sen(x, y, selecting(5));
    CHECK(line.slope == middle(all));
    CHECK(line.pairs == all.size());
    CHECK(line.slope == theil_sen(x, y, selecting(99))->slope);
  }
}

TEST_CASE("limits are the ranks that scipy takes") {
  // x = 0..9, y below: sorted slopes and ranks worked out by hand from scipy.stats.theilslopes' formula.
  const std::vector<double> x = counted(10);
  const std::vector<double> y{1.0, 2.1, 2.9, 4.2, 5.1, 5.8, 7.2, 8.1, 8.8, 10.3};
  const std::vector<double> all = brute_slopes(x, y);
  const double sigma = std::sqrt(10.0 * 9.0 * 25.0 / 18.0);
  const auto lower = static_cast<std::size_t>(std::nearbyint((45.0 - 1.959963984540054 * sigma) / 2)) - 1;
  const auto upper = static_cast<std::size_t>(std::nearbyint((45.0 + 1.959963984540054 * sigma) / 2));
  CHECK(lower == 11);
  CHECK(upper == 33);
  const SlopeLine line = *theil_sen(x, y);
  CHECK(line.lo == all[lower]);
  CHECK(line.hi == all[upper]);
  CHECK(line.intercept == Approx(5.45 - line.slope * 4.5));
}

TEST_CASE("the line follows shifts and scales of its points") {
  std::mt19937 random(5);
  std::normal_distribution<double> noise;
  std::vector<double> x(60);
  std::vector<double> y(60);
  for (std::size_t i = 0; i < x.size(); ++i) {
    x[i] = noise(random);
    y[i] = 3 * x[i] + noise(random);
  }
  const SlopeLine line = *theil_sen(x, y);
  std::vector<double> x2 = x;
  std::vector<double> y2 = y;
  for (std::size_t i = 0; i < x.size(); ++i) {
    x2[i] = 2 * x[i] + 10;
    y2[i] = -4 * y[i] + 1;
  }
  const SlopeLine turned = *theil_sen(x2, y2);
  CHECK(turned.slope == Approx(-2 * line.slope));
  std::reverse(x.begin(), x.end());
  std::reverse(y.begin(), y.end());
  CHECK(theil_sen(x, y)->slope == line.slope);
}

TEST_CASE("points with one x have no slope") {
  const std::vector<double> x(5, 2.0);
  CHECK_FALSE(theil_sen(x, counted(5)));
  CHECK_FALSE(theil_sen({}, {}));
  CHECK_FALSE(find_trend(counted(4), counted(4)));
}

TEST_CASE("the variance factor is 1 without memory, large with it, never below 0.1") {
  std::mt19937 random(6);
  double plain = 0.0;
  double sticky = 0.0;
  for (int round = 0; round < 100; ++round) {
    plain += variance_factor(ar1(random, 365, 0.0)) / 100;
    sticky += variance_factor(ar1(random, 365, 0.7)) / 100;
  }
  CHECK(plain == Approx(1.02).margin(0.05));
  CHECK(sticky == Approx(1.7 / 0.3).epsilon(0.15));
  std::vector<double> saw(40);
  for (std::size_t i = 0; i < saw.size(); ++i) {
    saw[i] = i % 2 == 0 ? 1.0 : -1.0;
  }
  CHECK(variance_factor(saw) >= 0.1);
  CHECK(variance_factor(saw) < 0.2);
}

TEST_CASE("Hamed-Rao counts only significant lags") {
  std::mt19937 random(7);
  const std::vector<double> noise = ar1(random, 100, 0.0);
  const std::vector<double> sticky = ar1(random, 100, 0.8);
  CHECK(hamed_rao_factor(noise, 1) == Approx(1.0).margin(0.6));
  CHECK(hamed_rao_factor(sticky, 3) > 2.0);
  CHECK(hamed_rao_factor(sticky, 3) > hamed_rao_factor(sticky, 1));
}

TEST_CASE("series without trend are called trends about one time in twenty, with memory too") {
  std::mt19937 random(11);
  const std::vector<double> x = counted(120);
  for (const double phi : {0.0, 0.4, 0.7}) {
    int corrected = 0;
    int plain = 0;
    const int runs = 200;
    for (int round = 0; round < runs; ++round) {
      const Trend trend = *find_trend(x, ar1(random, 120, phi));
      corrected += trend.p < 0.05 ? 1 : 0;
      plain += trend.p_plain < 0.05 ? 1 : 0;
    }
    INFO("phi " << phi << ": corrected " << corrected << ", plain " << plain << " of " << runs);
    CHECK(corrected <= runs * 0.10);
    CHECK((phi < 0.3 || plain > 2 * corrected));
  }
}

TEST_CASE("a real trend is found, and its limits contain it as often as they say") {
  std::mt19937 random(12);
  const std::vector<double> x = counted(60);
  int inside = 0;
  int found = 0;
  for (int round = 0; round < 200; ++round) {
    std::vector<double> y = ar1(random, 60, 0.3);
    for (std::size_t i = 0; i < y.size(); ++i) {
      y[i] += 0.1 * x[i];
    }
    const Trend trend = *find_trend(x, y);
    inside += trend.line.lo <= 0.1 && 0.1 <= trend.line.hi ? 1 : 0;
    found += trend.p < 0.05 ? 1 : 0;
  }
  CHECK(found >= 195);
  CHECK(inside >= 180);
}
