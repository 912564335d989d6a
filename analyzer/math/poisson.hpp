#pragma once
// Counts of rare events: exact limits for a rate, tails, over-dispersion. Formula sources: Garwood 1936 (limits),
// Abramowitz & Stegun 6.5 and 26.4 (incomplete gamma, chi-square).

namespace tacho::math {

/// Regularised lower incomplete gamma function P(a, x) for a > 0, x >= 0; relative error about 1e-14.
double gamma_p(double a, double x);
/// 1 - P(a, x), accurate also where it is tiny.
double gamma_q(double a, double x);
/// x with P(a, x) = p, for 0 <= p < 1.
double gamma_p_inverse(double a, double p);
/// Quantile of the chi-square distribution, dof > 0, 0 <= p < 1.
double chi_square_quantile(double p, double dof);

struct Limits {
  double lo = 0.0;
  double hi = 0.0;
};

/// Garwood limits of the mean of a Poisson count k: chi2(alpha/2, 2k)/2 and chi2(1-alpha/2, 2k+2)/2. For k = 0 the
/// lower one is 0 and the upper one 3.69 (alpha = 0.05). k need not be whole (see scaled_limits).
Limits garwood(double k, double alpha = 0.05);

/// A rate k / exposure with its Garwood limits. `dispersion` (variance / mean of the counts) above kOverdispersed
/// widens both limits about the rate by its root.
struct Rate {
  double k = 0.0;
  double exposure = 0.0;
  double value = 0.0;
  double lo = 0.0;
  double hi = 0.0;
  bool widened = false;
};
inline constexpr double kOverdispersed = 1.5;
/// `exposure` > 0.
Rate poisson_rate(double k, double exposure, double dispersion = 1.0);

/// Limits of the mean of a sum of k independent amounts (seconds lost per event) from the sum and the sum of squares:
/// the scaled Poisson approximation, k_eff = sum^2 / squares (Bohm & Zech 2014). Needs sum > 0.
Limits scaled_limits(double sum, double squares, double alpha = 0.05);

/// P(X >= k) for X ~ Poisson(mean).
double poisson_upper_tail(double k, double mean);

}  // namespace tacho::math
