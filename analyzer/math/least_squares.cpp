#include "analyzer/math/least_squares.hpp"

#include <Eigen/QR>
#include <Eigen/SVD>
#include <cassert>
#include <vector>

namespace tacho {

LinearFit least_squares(const Eigen::MatrixXd& a, const Eigen::VectorXd& y, double max_condition) {
  LinearFit fit;
  if (a.rows() < a.cols()) {
    fit.problem = "fewer observations than unknowns";
    return fit;
  }
  const Eigen::RowVectorXd rms = (a.colwise().squaredNorm() / static_cast<double>(a.rows())).cwiseSqrt();
  if (!(rms.minCoeff() > 0.0)) {
    fit.problem = "one of the effects never occurs";
    return fit;
  }
  const Eigen::MatrixXd scaled = a.array().rowwise() / rms.array();
  // The singular values of A are those of R, which is small.
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(scaled);
  const Eigen::MatrixXd r = qr.matrixQR().topRows(a.cols()).triangularView<Eigen::Upper>();
  const Eigen::VectorXd singular = r.jacobiSvd().singularValues();
  fit.condition = singular(0) / singular(singular.size() - 1);
  if (!(fit.condition <= max_condition)) {
    fit.problem = "the effects cannot be told apart";
    return fit;
  }
  fit.coefficients = qr.solve(y).array() / rms.transpose().array();
  return fit;
}

Eigen::VectorXd non_negative_least_squares(const Eigen::MatrixXd& a, const Eigen::VectorXd& y,
                                           const Eigen::VectorXd& weights) {
  const Eigen::Index columns = a.cols();
  assert(columns <= 4);
  const Eigen::VectorXd root = weights.cwiseSqrt();
  const Eigen::MatrixXd wa = root.asDiagonal() * a;
  const Eigen::VectorXd wy = root.asDiagonal() * y;
  Eigen::VectorXd best = Eigen::VectorXd::Zero(columns);
  double best_cost = wy.squaredNorm();
  for (unsigned subset = 1; subset < (1U << static_cast<unsigned>(columns)); ++subset) {
    std::vector<Eigen::Index> used;
    for (Eigen::Index c = 0; c < columns; ++c) {
      if ((subset >> static_cast<unsigned>(c)) & 1U) {
        used.push_back(c);
      }
    }
    const Eigen::MatrixXd part = wa(Eigen::all, used);
    const Eigen::VectorXd solved = part.colPivHouseholderQr().solve(wy);
    const double cost = (part * solved - wy).squaredNorm();
    if (solved.minCoeff() >= 0.0 && cost < best_cost) {
      best_cost = cost;
      best.setZero();
      best(used) = solved;
    }
  }
  return best;
}

}  // namespace tacho
