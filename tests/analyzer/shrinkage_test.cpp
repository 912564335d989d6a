#include "analyzer/math/shrinkage.hpp"

#include "tests/support/catch.hpp"

using namespace tacho::math;

TEST_CASE("places that differ by chance only are drawn wholly to the mean") {
  const std::vector<double> k{1, 1, 1, 1};
  const std::vector<double> e{10, 10, 10, 10};
  const Shrinkage s = shrinkage(k, e);
  CHECK(s.mean == Approx(0.1));
  CHECK(s.between == 0.0);
  CHECK(s.rate(1, 10) == Approx(0.1));
  CHECK(s.weight(10) == 0.0);
}

TEST_CASE("theta follows the written formula") {
  const std::vector<double> k{30, 1, 0, 1};
  const std::vector<double> e{100, 100, 50, 150};
  const Shrinkage s = shrinkage(k, e);
  const double m = 32.0 / 400.0;
  CHECK(s.mean == Approx(m));
  const double spread = (100 * (0.30 - m) * (0.30 - m) + 100 * (0.01 - m) * (0.01 - m) + 50 * m * m +
                         150 * (1.0 / 150 - m) * (1.0 / 150 - m)) /
                        400.0;
  const double a = spread - m / 100.0;
  CHECK(s.between == Approx(a));
  CHECK(s.rate(30, 100) == Approx(m + a / (a + m / 100) * (0.30 - m)));
  CHECK(s.weight(100) == Approx(a / (a + m / 100)));
}

TEST_CASE("more exposure means more weight, none means the mean") {
  const Shrinkage s = shrinkage(std::vector<double>{30, 0, 0}, std::vector<double>{100, 100, 100});
  CHECK(s.weight(10) < s.weight(100));
  CHECK(s.rate(0, 0) == Approx(s.mean));
  const double theta = s.rate(30, 100);
  CHECK(theta > s.mean);
  CHECK(theta < 0.3);
  const Shrinkage none = shrinkage(std::vector<double>{0, 0}, std::vector<double>{0, 5});
  CHECK(none.mean == 0.0);
  CHECK(none.rate(0, 5) == 0.0);
  CHECK(shrinkage({}, {}).mean == 0.0);
}

TEST_CASE("q values are those of Benjamini and Hochberg and keep the order of the p values") {
  const std::vector<double> p{0.01, 0.04, 0.03, 0.5};
  const std::vector<double> q = false_discovery_rates(p);
  CHECK(q[0] == Approx(0.04));
  CHECK(q[1] == Approx(0.04 * 4 / 3));
  CHECK(q[2] == Approx(0.04 * 4 / 3));  // 0.06 alone, but never above a less significant one
  CHECK(q[3] == Approx(0.5));
  CHECK(false_discovery_rates({}).empty());
}
