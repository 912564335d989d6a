#include "analyzer/math/rainflow.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <vector>

#include "analyzer/math/sum.hpp"
#include "tests/support/catch.hpp"

using tacho::Rainflow;
using tacho::RainflowCycle;
using tacho::TurningPoints;

namespace {

std::vector<RainflowCycle> count(const std::vector<double>& values) {
  std::vector<RainflowCycle> cycles;
  Rainflow flow;
  const auto keep = [&](const RainflowCycle& c) { cycles.push_back(c); };
  for (std::size_t i = 0; i < values.size(); ++i) {
    flow.push(values[i], static_cast<std::int64_t>(i), keep);
  }
  flow.finish(keep);
  return cycles;
}

std::map<double, double> by_range(const std::vector<RainflowCycle>& cycles) {
  std::map<double, double> out;
  for (const RainflowCycle& c : cycles) {
    out[c.range] += c.count;
  }
  return out;
}

/// ASTM E1049-85 5.4.4 word by word on a whole list: look for the first pair of ranges with X >= Y, from the start,
/// again and again.
std::map<double, double> textbook(const std::vector<double>& values) {
  std::vector<double> peaks;
  for (const double v : values) {
    if (!peaks.empty() && v == peaks.back()) {
      continue;
    }
    if (peaks.size() >= 2 && (peaks.back() > peaks[peaks.size() - 2]) == (v > peaks.back())) {
      peaks.back() = v;
    } else {
      peaks.push_back(v);
    }
  }
  std::map<double, double> out;
  std::size_t read = 3;
  while (read <= peaks.size()) {
    const double x = std::abs(peaks[read - 1] - peaks[read - 2]);
    const double y = std::abs(peaks[read - 2] - peaks[read - 3]);
    if (x < y) {
      ++read;
    } else if (read == 3) {
      out[y] += 0.5;
      peaks.erase(peaks.begin());
    } else {
      out[y] += 1.0;
      peaks.erase(peaks.begin() + static_cast<std::ptrdiff_t>(read - 3),
                  peaks.begin() + static_cast<std::ptrdiff_t>(read - 1));
      read = std::max<std::size_t>(3, read - 2);
    }
  }
  for (std::size_t i = 0; i + 1 < peaks.size(); ++i) {
    out[std::abs(peaks[i + 1] - peaks[i])] += 0.5;
  }
  return out;
}

double half_variation(const std::vector<double>& values) {
  tacho::Sum sum;
  for (std::size_t i = 1; i < values.size(); ++i) {
    sum.add(std::abs(values[i] - values[i - 1]) / 2);
  }
  return sum.value();
}

double weighted(const std::vector<RainflowCycle>& cycles) {
  tacho::Sum sum;
  for (const RainflowCycle& c : cycles) {
    sum.add(c.range * c.count);
  }
  return sum.value();
}

}  // namespace

TEST_CASE("the example of ASTM E1049 gives the published counts") {
  const std::map<double, double> expected{{3, 0.5}, {4, 1.5}, {6, 0.5}, {8, 1.0}, {9, 0.5}};
  CHECK(by_range(count({-2, 1, -3, 5, -1, 3, -4, 4, -2})) == expected);
}

TEST_CASE("a constant series has no cycle, two values are half a cycle, plateaus count once") {
  CHECK(count({}).empty());
  CHECK(count({0.4}).empty());
  CHECK(count({0.4, 0.4, 0.4}).empty());
  const std::vector<RainflowCycle> half = count({0.9, 0.4});
  REQUIRE(half.size() == 1);
  CHECK(half[0].count == 0.5);
  CHECK(half[0].range == Approx(0.5));
  CHECK(half[0].mean == Approx(0.65));
  CHECK(by_range(count({0, 1, 1, 1, 0, 0, 2})) == by_range(count({0, 1, 0, 2})));
}

TEST_CASE("a cycle carries the labels of its two turning points in time order") {
  for (const RainflowCycle& c : count({0, 5, 2, 4, 1, 6})) {
    CHECK(c.from < c.to);
  }
  Rainflow flow;
  std::vector<RainflowCycle> cycles;
  const auto keep = [&](const RainflowCycle& c) { cycles.push_back(c); };
  std::int64_t t = 100;
  for (const double v : {0.0, 10.0, 4.0, 7.0, -1.0}) {
    flow.push(v, t, keep);
    t += 100;
  }
  flow.finish(keep);
  const auto inner = std::find_if(cycles.begin(), cycles.end(), [](const RainflowCycle& c) { return c.count == 1.0; });
  REQUIRE(inner != cycles.end());
  CHECK(inner->range == 3.0);
  CHECK(inner->from == 300);
  CHECK(inner->to == 400);
}

TEST_CASE("streaming gives the counts of the textbook procedure on random series") {
  std::mt19937 random(7);
  for (int round = 0; round < 3'000; ++round) {
    const std::size_t n = random() % 60;
    const std::size_t levels = 2 + random() % 12;
    std::vector<double> values(n);
    for (double& v : values) {
      v = static_cast<double>(random() % levels);
    }
    REQUIRE(by_range(count(values)) == textbook(values));
  }
}

TEST_CASE("range times count is half the total variation, whatever the series") {
  std::mt19937 random(8);
  std::uniform_real_distribution<double> step(-0.01, 0.01);
  for (int round = 0; round < 20; ++round) {
    std::vector<double> values{0.5};
    for (int i = 0; i < 20'000; ++i) {
      values.push_back(std::clamp(values.back() + step(random), 0.0, 1.0));
    }
    const double expected = half_variation(values);
    CHECK(std::abs(weighted(count(values)) - expected) <= 1e-12 * expected);
  }
}

TEST_CASE("memory is the residue, not the record") {
  std::mt19937 random(9);
  std::uniform_real_distribution<double> step(-0.01, 0.01);
  Rainflow flow;
  double v = 0.5;
  std::size_t most = 0;
  for (int i = 0; i < 1'000'000; ++i) {
    v = std::clamp(v + step(random), 0.0, 1.0);
    flow.push(v, i, [](const RainflowCycle&) {});
    most = std::max(most, flow.residue());
  }
  CHECK(most < 60);
}

TEST_CASE("small movements are no turning points, extremes are kept as they were") {
  std::vector<double> turns;
  TurningPoints filter(0.01);
  const auto turn = [&](double v, std::int64_t) { turns.push_back(v); };
  std::int64_t t = 0;
  for (const double v : {0.90, 0.895, 0.90, 0.80, 0.805, 0.50, 0.509, 0.50, 0.70, 0.695, 0.95, 0.945}) {
    filter.push(v, t++, turn);
  }
  filter.finish(turn);
  CHECK(turns == std::vector<double>{0.90, 0.50, 0.95, 0.945});
}

TEST_CASE("the growth of the filtered path adds up to the variation of its turning points") {
  std::mt19937 random(10);
  std::uniform_real_distribution<double> step(-0.01, 0.01);
  for (const double hysteresis : {0.0, 0.005, 0.02, 0.3}) {
    for (const int n : {0, 1, 2, 3, 50, 5'000}) {
      std::vector<double> turns;
      const auto turn = [&](double v, std::int64_t) { turns.push_back(v); };
      TurningPoints filter(hysteresis);
      double growth = 0.0;
      double v = 0.5;
      for (int i = 0; i < n; ++i) {
        v += step(random);
        growth += filter.push(v, i, turn);
      }
      growth += filter.finish(turn);
      CHECK(growth == Approx(2 * half_variation(turns)).margin(1e-12));
      if (n > 0) {
        CHECK(turns.back() == Approx(v).margin(hysteresis));
      }
    }
  }
}

TEST_CASE("without hysteresis the filter changes nothing that rainflow counts") {
  std::mt19937 random(11);
  for (int round = 0; round < 300; ++round) {
    std::vector<double> values(random() % 80);
    for (double& v : values) {
      v = static_cast<double>(random() % 9);
    }
    std::vector<double> turns;
    const auto turn = [&](double v, std::int64_t) { turns.push_back(v); };
    TurningPoints filter(0.0);
    for (std::size_t i = 0; i < values.size(); ++i) {
      filter.push(values[i], static_cast<std::int64_t>(i), turn);
    }
    filter.finish(turn);
    REQUIRE(by_range(count(turns)) == by_range(count(values)));
  }
}
