#include "analyzer/math/poisson.hpp"

#include "tests/support/catch.hpp"

using namespace tacho::math;

TEST_CASE("chi-square quantiles agree with the printed tables") {
  // Abramowitz & Stegun table 26.8, and R's qchisq for the extreme ones.
  struct Row {
    double p, dof, x;
  };
  const Row rows[] = {{0.95, 1, 3.841458820694124},   {0.975, 2, 7.377758908227871},  {0.025, 2, 0.05063561596857975},
                      {0.5, 10, 9.341817765591959},   {0.99, 30, 50.89218131151707},  {0.005, 20, 7.433844263098234},
                      {0.95, 100, 124.3421134095009}, {0.025, 200, 162.7279825018463}};
  for (const Row& row : rows) {
    CAPTURE(row.p, row.dof);
    CHECK(chi_square_quantile(row.p, row.dof) == Approx(row.x).epsilon(1e-9));
  }
}

TEST_CASE("Garwood limits agree with the published table") {
  struct Row {
    double k, lo, hi;
  };
  // Pearson & Hartley, Biometrika Tables vol. 1, table 40 (95 %).
  const Row rows[] = {{1, 0.0253, 5.57}, {2, 0.242, 7.22},   {3, 0.619, 8.77},  {5, 1.62, 11.67},
                      {10, 4.80, 18.39}, {20, 12.22, 30.89}, {50, 37.11, 65.92}};
  for (const Row& row : rows) {
    CAPTURE(row.k);
    CHECK(garwood(row.k).lo == Approx(row.lo).epsilon(0.004));
    CHECK(garwood(row.k).hi == Approx(row.hi).epsilon(0.002));
  }
}

TEST_CASE("no event in an exposure bounds the rate by 3.69 / exposure") {
  const Rate rate = poisson_rate(0, 24.0);
  CHECK(rate.value == 0.0);
  CHECK(rate.lo == 0.0);
  CHECK(rate.hi * 24.0 == Approx(3.688879454113936).epsilon(1e-12));
}

TEST_CASE("the limits of a count are where its tails hold alpha / 2") {
  for (const double k : {1.0, 4.0, 17.0, 250.0, 20'000.0}) {
    CAPTURE(k);
    const Limits limits = garwood(k);
    CHECK(poisson_upper_tail(k, limits.lo) == Approx(0.025).epsilon(1e-8));
    CHECK(1.0 - poisson_upper_tail(k + 1, limits.hi) == Approx(0.025).epsilon(1e-8));
  }
}

TEST_CASE("the incomplete gamma inverse undoes the function from tiny to large arguments") {
  for (const double a : {0.05, 0.5, 1.0, 3.7, 42.0, 900.0, 1e5}) {
    for (const double p : {1e-9, 0.01, 0.3, 0.5, 0.8, 0.999, 1.0 - 1e-9}) {
      CAPTURE(a, p);
      const double x = gamma_p_inverse(a, p);
      if (p < 0.5) {
        CHECK(gamma_p(a, x) == Approx(p).epsilon(1e-8));
      } else {
        CHECK(gamma_q(a, x) == Approx(1.0 - p).epsilon(1e-7));
      }
    }
  }
  CHECK(gamma_p_inverse(2.0, 0.0) == 0.0);
}

TEST_CASE("the two halves of the incomplete gamma function add up to one") {
  for (const double a : {0.3, 2.0, 55.0}) {
    for (const double x : {0.0, 0.01, 1.0, 3.0, 54.0, 56.0, 57.0, 400.0}) {
      CHECK(gamma_p(a, x) + gamma_q(a, x) == Approx(1.0).epsilon(1e-13));
    }
  }
}

TEST_CASE("the upper tail is the sum of Poisson terms") {
  const double mean = 2.5;
  double below = 0.0;
  double term = std::exp(-mean);
  for (int k = 0; k < 12; ++k) {
    CHECK(poisson_upper_tail(k, mean) == Approx(1.0 - below).epsilon(1e-9));
    below += term;
    term *= mean / (k + 1);
  }
  CHECK(poisson_upper_tail(0, 0.0) == 1.0);
  CHECK(poisson_upper_tail(3, 0.0) == 0.0);
}

TEST_CASE("over-dispersion above 1.5 widens the limits by its root and below changes nothing") {
  const Rate plain = poisson_rate(40, 10.0);
  const Rate calm = poisson_rate(40, 10.0, 1.49);
  const Rate wild = poisson_rate(40, 10.0, 4.0);
  CHECK(calm.lo == plain.lo);
  CHECK(calm.hi == plain.hi);
  CHECK_FALSE(calm.widened);
  CHECK(wild.widened);
  CHECK(wild.value == plain.value);
  CHECK(wild.hi - wild.value == Approx(2.0 * (plain.hi - plain.value)));
  CHECK(wild.value - wild.lo == Approx(2.0 * (plain.value - plain.lo)));
  CHECK(poisson_rate(1, 10.0, 100.0).lo == 0.0);
}

TEST_CASE("equal amounts per event have the limits of their count") {
  const Limits counted = garwood(7);
  const Limits amounts = scaled_limits(7 * 12.0, 7 * 12.0 * 12.0);
  CHECK(amounts.lo == Approx(12.0 * counted.lo));
  CHECK(amounts.hi == Approx(12.0 * counted.hi));
  // Unequal amounts with the same sum are less certain.
  CHECK(scaled_limits(84.0, 78.0 * 78.0 + 6.0).hi > amounts.hi);
}
