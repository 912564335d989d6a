#pragma once
// Small linear least squares on Eigen, with the guards that field data need.

#include <Eigen/Core>
#include <string>

namespace tacho {

struct LinearFit {
  Eigen::VectorXd coefficients;
  double condition = 0.0;  ///< largest / smallest singular value after scaling the columns to unit rms
  std::string problem;     ///< empty when the fit can be used
  [[nodiscard]] bool ok() const { return problem.empty(); }
};

/// Solves A c = y in the least-squares sense. Columns are scaled to unit rms first; a singular-value ratio above
/// `max_condition` (50 in METHODS A6), fewer rows than columns, or a zero column gives a problem instead of numbers.
LinearFit least_squares(const Eigen::MatrixXd& a, const Eigen::VectorXd& y, double max_condition = 50.0);

/// Weighted least squares with coefficients >= 0, exact, for at most four columns: every subset of columns is solved
/// and the best one whose coefficients are all >= 0 is taken. Weights multiply squared residuals.
Eigen::VectorXd non_negative_least_squares(const Eigen::MatrixXd& a, const Eigen::VectorXd& y,
                                           const Eigen::VectorXd& weights);

}  // namespace tacho
