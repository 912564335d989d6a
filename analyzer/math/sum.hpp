#pragma once
// Sums whose error does not grow with the number of terms (Neumaier 1974): about one rounding of the result, so that
// two ways to the same total can be compared to 1e-12 after millions of terms.

#include <cmath>

namespace tacho {

class Sum {
 public:
  void add(double term) {
    const double next = sum_ + term;
    carry_ += std::abs(sum_) >= std::abs(term) ? (sum_ - next) + term : (term - next) + sum_;
    sum_ = next;
  }
  [[nodiscard]] double value() const { return sum_ + carry_; }

 private:
  double sum_ = 0.0;
  double carry_ = 0.0;
};

}  // namespace tacho
