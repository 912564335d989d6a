#pragma once
// Rainflow counting (ASTM E1049-85, 5.4.4), one value at a time, and the hysteresis filter that goes before it.
//
// First and last values are reversals, plateaus collapse, a constant series gives nothing, two different values give
// one half cycle. The steps left over at the end are half cycles. Hence exactly, in real arithmetic,
//     sum of range * count = 1/2 * sum |v[k+1] - v[k]|
// for every series: nothing is lost and nothing is counted twice. Memory is the residue, not the record.

#include <cmath>
#include <cstdint>
#include <vector>

namespace tacho {

struct RainflowCycle {
  double range = 0.0;     ///< > 0
  double mean = 0.0;      ///< of the two turning points
  double count = 0.0;     ///< 1 or 0.5
  std::int64_t from = 0;  ///< label of the earlier turning point
  std::int64_t to = 0;    ///< label of the later one
};

/// Turning points in, cycles out. `at` is any label (a time); it is only handed through.
class Rainflow {
 public:
  /// Calls `emit(const RainflowCycle&)` for each cycle that is complete. Any finite value will do, also one that
  /// continues the last direction.
  template <class Emit>
  void push(double value, std::int64_t at, Emit&& emit) {
    if (!started_) {
      started_ = true;
      stack_.push_back({value, at});
      return;
    }
    const double last = has_tip_ ? tip_.value : stack_.back().value;
    if (value == last) {
      return;
    }
    const bool up = value > last;
    if (has_tip_ && up != rising_) {
      stack_.push_back(tip_);
      reduce(emit);
    }
    tip_ = {value, at};
    has_tip_ = true;
    rising_ = up;
  }

  /// The last value becomes a reversal, and what is left becomes half cycles. The counter is then as new.
  template <class Emit>
  void finish(Emit&& emit) {
    if (has_tip_) {
      stack_.push_back(tip_);
      reduce(emit);
    }
    for (std::size_t i = 0; i + 1 < stack_.size(); ++i) {
      emit(cycle(stack_[i], stack_[i + 1], 0.5));
    }
    *this = Rainflow{};
  }

  /// Turning points held.
  [[nodiscard]] std::size_t residue() const { return stack_.size() + (has_tip_ ? 1 : 0); }

 private:
  struct Point {
    double value = 0.0;
    std::int64_t at = 0;
  };
  std::vector<Point> stack_;
  Point tip_;  // last value: a reversal only if the next one turns
  bool has_tip_ = false;
  bool rising_ = false;
  bool started_ = false;

  static RainflowCycle cycle(const Point& a, const Point& b, double count) {
    return {std::abs(b.value - a.value), (a.value + b.value) / 2, count, a.at, b.at};
  }

  template <class Emit>
  void reduce(Emit&& emit) {
    while (stack_.size() >= 3) {
      const std::size_t n = stack_.size();
      const double x = std::abs(stack_[n - 1].value - stack_[n - 2].value);
      const double y = std::abs(stack_[n - 2].value - stack_[n - 3].value);
      if (x < y) {
        return;
      }
      if (n == 3) {
        emit(cycle(stack_[0], stack_[1], 0.5));
        stack_.erase(stack_.begin());
      } else {
        emit(cycle(stack_[n - 3], stack_[n - 2], 1.0));
        stack_[n - 3] = stack_[n - 1];
        stack_.resize(n - 2);
      }
    }
  }
};

/// Turning points of a noisy series: a turn counts once the value has gone back by more than `hysteresis`. First and
/// last values count always. Extremes are kept as they were, not clipped.
class TurningPoints {
 public:
  explicit TurningPoints(double hysteresis) : hysteresis_(hysteresis) {}

  /// Calls `turn(value, at)` for each turning point that is now certain, the first value included. Returns by how much
  /// the filtered path has grown; the growths add up to the sum of |differences| of the turning points.
  template <class Turn>
  double push(double value, std::int64_t at, Turn&& turn) {
    last_ = {value, at};
    if (direction_ == 0) {
      return begin(turn);
    }
    const double advance = direction_ * (value - tip_.value);
    if (advance >= 0) {
      tip_ = last_;
      return advance;
    }
    if (-advance <= hysteresis_) {
      return 0.0;
    }
    turn(tip_.value, tip_.at);
    direction_ = -direction_;
    tip_ = last_;
    return -advance;
  }

  /// Hands out the tip and, when it differs, the last value. Returns the growth. The filter is then as new.
  template <class Turn>
  double finish(Turn&& turn) {
    double growth = 0.0;
    if (direction_ != 0) {
      turn(tip_.value, tip_.at);
      growth = std::abs(last_.value - tip_.value);
    } else if (started_) {
      growth = std::abs(last_.value - first_.value);
    }
    if (started_ && growth > 0) {
      turn(last_.value, last_.at);
    }
    *this = TurningPoints(hysteresis_);
    return growth;
  }

  /// +1 rising, -1 falling, 0 not yet known.
  [[nodiscard]] int direction() const { return direction_; }

 private:
  struct Point {
    double value = 0.0;
    std::int64_t at = 0;
  };
  double hysteresis_;
  Point first_, low_, high_, tip_, last_;
  int direction_ = 0;
  bool started_ = false;

  template <class Turn>
  double begin(Turn&& turn) {
    if (!started_) {
      started_ = true;
      first_ = low_ = high_ = last_;
      turn(first_.value, first_.at);
      return 0.0;
    }
    low_ = last_.value < low_.value ? last_ : low_;
    high_ = last_.value > high_.value ? last_ : high_;
    if (high_.value - low_.value <= hysteresis_) {
      return 0.0;
    }
    // The newest value is one end of the range; the other end is the first turn after the start.
    const Point& other = last_.value == high_.value ? low_ : high_;
    direction_ = last_.value == high_.value ? 1 : -1;
    const double detour = std::abs(other.value - first_.value);
    if (detour > 0) {
      turn(other.value, other.at);
    }
    tip_ = last_;
    return detour + std::abs(last_.value - other.value);
  }
};

}  // namespace tacho
