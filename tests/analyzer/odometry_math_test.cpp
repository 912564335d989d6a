#include <cmath>
#include <vector>

#include "analyzer/math/bootstrap.hpp"
#include "analyzer/math/least_squares.hpp"
#include "analyzer/math/proportion.hpp"
#include "analyzer/math/robust.hpp"
#include "analyzer/math/se2.hpp"
#include "tests/support/catch.hpp"

using namespace tacho;

namespace {

struct Draw {
  SplitMix random{7};
  double in(double lo, double hi) { return lo + (hi - lo) * random.uniform(); }
  Pose pose() { return {in(-50, 50), in(-50, 50), in(-3.1, 3.1)}; }
  Twist twist() { return {in(-2, 2), in(-2, 2), in(-3, 3)}; }
};

void same(const Pose& a, const Pose& b, double tolerance = 1e-9) {
  CHECK(std::abs(a.x - b.x) < tolerance);
  CHECK(std::abs(a.y - b.y) < tolerance);
  CHECK(std::abs(wrap_pi(a.angle - b.angle)) < tolerance);
}

}  // namespace

TEST_CASE("wrap_pi gives the same direction in (-pi, pi]") {
  Draw draw;
  for (int i = 0; i < 500; ++i) {
    const double angle = draw.in(-40, 40);
    const double wrapped = wrap_pi(angle);
    CHECK(wrapped > -kPi);
    CHECK(wrapped <= kPi);
    CHECK(std::cos(wrapped) == Approx(std::cos(angle)).margin(1e-12));
    CHECK(std::sin(wrapped) == Approx(std::sin(angle)).margin(1e-12));
  }
  CHECK(wrap_pi(-kPi) == kPi);
}

TEST_CASE("log undoes exp, exp of halves composes to exp of the whole") {
  Draw draw;
  for (int i = 0; i < 500; ++i) {
    const Twist twist = draw.twist();
    const double dt = draw.in(0.001, 1.0);
    const Twist back = log_se2(exp_se2(twist, dt));
    CHECK(back.vx == Approx(twist.vx * dt).margin(1e-12));
    CHECK(back.vy == Approx(twist.vy * dt).margin(1e-12));
    CHECK(back.w == Approx(twist.w * dt).margin(1e-12));
    same(compose(exp_se2(twist, 0.5 * dt), exp_se2(twist, 0.5 * dt)), exp_se2(twist, dt));
  }
}

TEST_CASE("the series for small angles meets the closed form") {
  for (const double phi : {0.999e-4, 1.001e-4, -0.999e-4, -1.001e-4}) {
    const ArcTerms t = arc_terms(phi);
    const double half = std::sin(phi / 2.0);
    CHECK(t.a == Approx(std::sin(phi) / phi).epsilon(1e-15));
    CHECK(t.c == Approx(2.0 * half * half / phi).epsilon(1e-12));
  }
  CHECK(arc_terms(0.0).a == 1.0);
  CHECK(arc_terms(0.0).c == 0.0);
}

TEST_CASE("a quarter circle ends where geometry says") {
  const Pose end = exp_se2({kPi / 2.0, 0.0, kPi / 2.0}, 1.0);  // radius 1, length pi/2
  same(end, {1.0, 1.0, kPi / 2.0}, 1e-12);
}

TEST_CASE("poses form a group, and turning the frame changes no relative pose") {
  Draw draw;
  for (int i = 0; i < 300; ++i) {
    const Pose a = draw.pose();
    const Pose b = draw.pose();
    const Pose c = draw.pose();
    same(compose(compose(a, b), c), compose(a, compose(b, c)));
    same(compose(a, inverse(a)), {});
    same(compose(a, between(a, b)), b);
    same(between(compose(c, a), compose(c, b)), between(a, b));
  }
}

TEST_CASE("interpolation starts at a, ends at b, and its parts add up to the whole") {
  Draw draw;
  for (int i = 0; i < 300; ++i) {
    const Pose a = draw.pose();
    const Pose b = compose(a, exp_se2(draw.twist(), 0.9));
    same(interpolate(a, b, 0.0), a);
    same(interpolate(a, b, 1.0), b);
    const double f = draw.in(0.1, 0.9);
    const double g = draw.in(0.1, 0.9);
    same(interpolate(a, interpolate(a, b, f), g), interpolate(a, b, f * g), 1e-8);
  }
}

TEST_CASE("median and quantiles agree with hand-made examples") {
  CHECK(median({3, 1, 2}) == 2);
  CHECK(median({4, 1, 2, 3}) == 2.5);
  CHECK(quantile({0, 10}, 0.25) == 2.5);
  CHECK(quantile({5, 1, 3}, 0.0) == 1);
  CHECK(quantile({5, 1, 3}, 1.0) == 5);
  CHECK(std::isnan(median({})));
  CHECK(median_absolute_deviation({1, 2, 3, 4, 100}) == 1);
}

TEST_CASE("a weighted median with whole weights is the median with repetitions") {
  const std::vector<double> values{5, 1, 9, 3};
  const std::vector<double> weights{2, 1, 1, 3};
  CHECK(weighted_median(values, weights) == median({5, 5, 1, 9, 3, 3, 3}));
  CHECK(weighted_median(std::vector<double>{1, 2}, std::vector<double>{1, 1}) == 1.5);
  CHECK(weighted_median(std::vector<double>{1, 2, 1e9}, std::vector<double>{1, 1, 0.5}) == 2);
  CHECK(std::isnan(weighted_median(std::vector<double>{1}, std::vector<double>{0})));
}

TEST_CASE("the bootstrap is the same every time and covers the truth of independent data") {
  int covered = 0;
  for (std::uint64_t run = 0; run < 200; ++run) {
    SplitMix random(run);
    std::vector<double> top;
    std::vector<double> bottom;
    for (int i = 0; i < 100; ++i) {
      bottom.push_back(1.0 + random.uniform());
      top.push_back(2.0 * bottom.back() + random.uniform() - 0.5);
    }
    const Limits limits = bootstrap_ratio(top, bottom, {});
    covered += limits.lo <= 2.0 && 2.0 <= limits.hi ? 1 : 0;
    const Limits again = bootstrap_ratio(top, bottom, {});
    CHECK(limits.lo == again.lo);
    CHECK(limits.hi == again.hi);
  }
  CHECK(covered >= 180);
  CHECK(covered < 200);
}

TEST_CASE("blocks see the dependence that single draws miss") {
  SplitMix random(3);
  std::vector<double> values;
  double state = 0.0;
  for (int i = 0; i < 2000; ++i) {
    state = 0.95 * state + random.uniform() - 0.5;
    values.push_back(state);
  }
  const std::vector<double> ones(values.size(), 1.0);
  BootstrapOptions blocks;
  blocks.block = 60;
  const Limits single = bootstrap_ratio(values, ones, {});
  const Limits block = bootstrap_ratio(values, ones, blocks);
  CHECK(block.hi - block.lo > 2.0 * (single.hi - single.lo));
}

TEST_CASE("bootstrap limits of a weighted median lie round it; of one value they are that value") {
  SplitMix random(11);
  std::vector<double> values;
  std::vector<double> weights;
  for (int i = 0; i < 400; ++i) {
    values.push_back(random.uniform());
    weights.push_back(1.0);
  }
  const Limits limits = bootstrap_weighted_median(values, weights, {});
  const double middle = weighted_median(values, weights);
  CHECK(limits.lo < middle);
  CHECK(limits.hi > middle);
  CHECK(limits.hi - limits.lo == Approx(4.0 * 0.5 / 20.0).epsilon(0.4));
  const Limits one = bootstrap_weighted_median(std::vector<double>{3.0}, std::vector<double>{1.0}, {});
  CHECK(one.lo == 3.0);
  CHECK(one.hi == 3.0);
}

TEST_CASE("a sample of one block has no interval, and two blocks that share nothing are the least") {
  CHECK(too_few_to_draw(1, 1) == "no interval: one stretch only");
  CHECK(too_few_to_draw(2, 2) == "no interval: one stretch only");
  CHECK_FALSE(too_few_to_draw(3, 2).empty());
  CHECK(too_few_to_draw(4, 2).empty());
}

TEST_CASE("limits are widened to hold a value that rounding put outside") {
  const Limits limits = around(3.054912139924, {3.05491213992709199, 3.05491213992709199});
  CHECK(limits.lo == 3.054912139924);
  CHECK(limits.hi == 3.05491213992709199);
}

TEST_CASE("least squares finds exact coefficients and refuses effects it cannot tell apart") {
  Eigen::MatrixXd a(40, 2);
  Eigen::VectorXd y(40);
  SplitMix random(5);
  for (Eigen::Index i = 0; i < 40; ++i) {
    a(i, 0) = random.uniform();
    a(i, 1) = 1000.0 * random.uniform();
    y(i) = 2.0 * a(i, 0) - 0.003 * a(i, 1);
  }
  const LinearFit fit = least_squares(a, y);
  REQUIRE(fit.ok());
  CHECK(fit.coefficients(0) == Approx(2.0));
  CHECK(fit.coefficients(1) == Approx(-0.003));
  CHECK(fit.condition < 5.0);

  a.col(1) = a.col(0) * 3.0;
  CHECK_FALSE(least_squares(a, y).ok());
  a.col(1).setZero();
  CHECK_FALSE(least_squares(a, y).ok());
  CHECK_FALSE(least_squares(a.topRows(1), y.head(1)).ok());
}

TEST_CASE("non-negative least squares keeps good coefficients and drops those that would be negative") {
  Eigen::MatrixXd a(6, 2);
  Eigen::VectorXd y(6);
  const Eigen::VectorXd w = Eigen::VectorXd::Ones(6);
  for (Eigen::Index i = 0; i < 6; ++i) {
    const double l = static_cast<double>(i + 1);
    a(i, 0) = l;
    a(i, 1) = l * l;
    y(i) = 3.0 * l + 0.5 * l * l;
  }
  Eigen::VectorXd c = non_negative_least_squares(a, y, w);
  CHECK(c(0) == Approx(3.0));
  CHECK(c(1) == Approx(0.5));
  y = a.col(1) - 0.5 * a.col(0);
  c = non_negative_least_squares(a, y, w);
  CHECK(c(0) == 0.0);
  CHECK(c(1) == Approx((a.col(1).dot(y)) / a.col(1).squaredNorm()));
  c = non_negative_least_squares(a, -y, w);
  CHECK(c.isZero());
}

TEST_CASE("Wilson limits hold the share, and none of n still leaves room for some") {
  const Limits none = wilson(0, 100);
  CHECK(none.lo == 0.0);
  CHECK(none.hi == Approx(0.0370).epsilon(0.01));
  const Limits half = wilson(50, 100);
  CHECK(half.lo == Approx(0.4038).epsilon(0.001));
  CHECK(half.hi == Approx(0.5962).epsilon(0.001));
  CHECK(wilson(100, 100).hi == 1.0);
}
