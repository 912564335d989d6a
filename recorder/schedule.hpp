#pragma once
// When the polls of one source are due. All of them lie on grids through one origin: with period p at origin + j * p,
// by multiplication, so nothing that happens to a poll moves the next one and there is no drift, however often the
// period changes. Polls are numbered in the order in which they are due, and a number belongs to its instant for ever,
// whether or not it was ever asked: a changed period changes only what is due after the change.

#include <algorithm>
#include <cassert>
#include <cstdint>
#include <limits>
#include <vector>

#include "schema/sample.hpp"

namespace tacho::recorder {

class Schedule {
 public:
  /// Poll `first` is due at `origin_us`.
  Schedule(Micros origin_us, Micros period_us, std::uint64_t first = 0)
      : origin_us_(origin_us), stretches_{{first, origin_us, period_us}}, next_(first) {}

  /// `k` must not lie before the polls that were taken.
  [[nodiscard]] Micros due_us(std::uint64_t k) const {
    const Stretch& stretch = of(k);
    return stretch.due_us + static_cast<Micros>(k - stretch.first) * stretch.period_us;
  }
  /// The poll to do next; each number is taken once, in order.
  [[nodiscard]] std::uint64_t next() const { return next_; }
  [[nodiscard]] Micros next_due_us() const { return due_us(next_); }
  void take(std::uint64_t count = 1) {
    next_ += count;
    while (stretches_.size() > 1 && stretches_[1].first <= next_) {
      stretches_.erase(stretches_.begin());
    }
  }

  /// Of the polls that are planned last.
  [[nodiscard]] Micros period_us() const { return stretches_.back().period_us; }
  /// What is due until `now` stays as it was planned; after it polls are due on the grid of `period_us`. Returns the
  /// number of the first of them. Times must not decrease from call to call.
  std::uint64_t change_period(Micros period_us, Micros now) {
    assert(period_us > 0);
    const std::uint64_t first = std::max(planned_before(now + 1), next_);
    const Micros after = std::max(now, first > stretches_.front().first ? due_us(first - 1) : now);
    const Micros steps = after < origin_us_ ? 0 : (after - origin_us_) / period_us + 1;
    while (stretches_.size() > 1 && stretches_.back().first >= first) {
      stretches_.pop_back();
    }
    const Stretch changed{first, origin_us_ + steps * period_us, period_us};
    if (stretches_.back().first >= first) {
      stretches_.back() = changed;
    } else {
      stretches_.push_back(changed);
    }
    return first;
  }

  /// What is due next is due at `due_us`, later ones after it: something came that has no schedule but its own.
  void restart(Micros due_us, Micros period_us) {
    origin_us_ = due_us;
    stretches_.assign(1, Stretch{next_, due_us, period_us});
  }

  /// Polls due before `t`, and those before the first one: the planned count of a session that ends then. `t` must not
  /// lie before the polls that were taken.
  [[nodiscard]] std::uint64_t planned_before(Micros t) const {
    for (std::size_t i = 0; i < stretches_.size(); ++i) {
      const Stretch& s = stretches_[i];
      const auto due = t <= s.due_us ? 0 : static_cast<std::uint64_t>((t - s.due_us + s.period_us - 1) / s.period_us);
      const std::uint64_t end =
          i + 1 < stretches_.size() ? stretches_[i + 1].first : std::numeric_limits<std::uint64_t>::max();
      if (s.first + due < end) {
        return s.first + due;
      }
    }
    return next_;  // not reached: the last stretch has no end
  }
  /// Not yet taken polls whose successor is due at `now` too: too late to be worth asking.
  [[nodiscard]] std::uint64_t overrun(Micros now) const {
    const std::uint64_t due = planned_before(now + 1);
    return due <= next_ + 1 ? 0 : due - next_ - 1;
  }

 private:
  /// Polls from `first` on, until the next stretch begins.
  struct Stretch {
    std::uint64_t first;
    Micros due_us;  // of `first`
    Micros period_us;
  };
  [[nodiscard]] const Stretch& of(std::uint64_t k) const {
    const auto after =
        std::find_if(stretches_.begin() + 1, stretches_.end(), [k](const Stretch& s) { return s.first > k; });
    return *(after - 1);
  }

  Micros origin_us_;
  std::vector<Stretch> stretches_;  // never empty; those whose polls were all taken are dropped
  std::uint64_t next_;
};

}  // namespace tacho::recorder
