#include "analyzer/math/poisson.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>

namespace tacho::math {
namespace {

constexpr double kEpsilon = std::numeric_limits<double>::epsilon();
constexpr int kMaxTerms = 100'000;

/// std::lgamma writes the global signgam; analyses may run in parallel.
double log_gamma(double a) {
  int sign = 0;
  return lgamma_r(a, &sign);
}

/// x^a e^-x / Gamma(a)
double prefix(double a, double x) { return std::exp(a * std::log(x) - x - log_gamma(a)); }

/// A&S 6.5.29, good for x < a + 1.
double p_series(double a, double x) {
  double term = 1.0 / a;
  double sum = term;
  for (int n = 1; n < kMaxTerms; ++n) {
    term *= x / (a + n);
    sum += term;
    if (term < sum * kEpsilon) {
      break;
    }
  }
  return sum * prefix(a, x);
}

/// A&S 6.5.31 by the modified Lentz method, good for x >= a + 1.
double q_fraction(double a, double x) {
  constexpr double kTiny = 1e-300;
  double b = x + 1.0 - a;
  double c = 1.0 / kTiny;
  double d = 1.0 / b;
  double h = d;
  for (int n = 1; n < kMaxTerms; ++n) {
    const double an = -n * (n - a);
    b += 2.0;
    d = an * d + b;
    d = std::abs(d) < kTiny ? 1.0 / kTiny : 1.0 / d;
    c = b + an / c;
    c = std::abs(c) < kTiny ? kTiny : c;
    const double factor = c * d;
    h *= factor;
    if (std::abs(factor - 1.0) < 2.0 * kEpsilon) {
      break;
    }
  }
  return h * prefix(a, x);
}

/// Upper end of a bracket: P(a, result) >= p.
double bracket_end(double a, double p) {
  double hi = a + 10.0 * std::sqrt(a) + 10.0;
  while (gamma_p(a, hi) < p && hi < 1e300) {
    hi *= 2.0;
  }
  return hi;
}

}  // namespace

double gamma_p(double a, double x) {
  assert(a > 0.0 && x >= 0.0);
  if (x <= 0.0) {
    return 0.0;
  }
  return x < a + 1.0 ? p_series(a, x) : 1.0 - q_fraction(a, x);
}

double gamma_q(double a, double x) {
  assert(a > 0.0 && x >= 0.0);
  if (x <= 0.0) {
    return 1.0;
  }
  return x < a + 1.0 ? 1.0 - p_series(a, x) : q_fraction(a, x);
}

double gamma_p_inverse(double a, double p) {
  assert(a > 0.0 && p >= 0.0 && p < 1.0);
  if (p <= 0.0) {
    return 0.0;
  }
  // P(a, x) <= x^a / Gamma(a + 1), so this is below the root, and for small p or a next to it.
  double lo = std::exp((std::log(p) + log_gamma(a + 1.0)) / a);
  double hi = bracket_end(a, p);
  double x = a < 1.0 ? lo : std::clamp(a, lo, hi);
  for (int i = 0; i < 200; ++i) {
    // Q is used in the upper half so that p near 1 keeps its digits.
    const double error = p < 0.5 ? gamma_p(a, x) - p : (1.0 - p) - gamma_q(a, x);
    (error > 0.0 ? hi : lo) = x;
    const double slope = prefix(a, x) / x;
    double next = slope > 0.0 ? x - error / slope : lo;
    if (!(next > lo && next < hi)) {
      next = (lo + hi) / 2.0;  // Newton left the bracket
    }
    const bool done = std::abs(next - x) <= 4.0 * kEpsilon * std::max(next, 1e-300);
    x = next;
    if (done) {
      break;
    }
  }
  return x;
}

double chi_square_quantile(double p, double dof) { return 2.0 * gamma_p_inverse(dof / 2.0, p); }

Limits garwood(double k, double alpha) {
  assert(k >= 0.0 && alpha > 0.0 && alpha < 1.0);
  const double lo = k > 0.0 ? chi_square_quantile(alpha / 2.0, 2.0 * k) / 2.0 : 0.0;
  return {lo, chi_square_quantile(1.0 - alpha / 2.0, 2.0 * k + 2.0) / 2.0};
}

Rate poisson_rate(double k, double exposure, double dispersion) {
  assert(exposure > 0.0);
  const Limits limits = garwood(k);
  Rate rate{k, exposure, k / exposure, limits.lo / exposure, limits.hi / exposure, dispersion > kOverdispersed};
  if (rate.widened) {
    const double root = std::sqrt(dispersion);
    rate.lo = std::max(0.0, rate.value - root * (rate.value - rate.lo));
    rate.hi = rate.value + root * (rate.hi - rate.value);
  }
  return rate;
}

Limits scaled_limits(double sum, double squares, double alpha) {
  assert(sum > 0.0 && squares > 0.0);
  const double k = sum * sum / squares;
  const Limits limits = garwood(k, alpha);
  return {sum * limits.lo / k, sum * limits.hi / k};
}

double poisson_upper_tail(double k, double mean) {
  assert(k >= 0.0 && mean >= 0.0);
  return k <= 0.0 ? 1.0 : gamma_p(k, mean);
}

}  // namespace tacho::math
