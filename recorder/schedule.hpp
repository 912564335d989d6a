#pragma once
// When the polls of one source are due: start + k * period, for ever. Nothing that happens to a poll moves the next
// one, so there is no drift, and poll k keeps its number whether or not it was ever asked.

#include <cstdint>

#include "schema/sample.hpp"

namespace tacho::recorder {

class Schedule {
 public:
  Schedule(Micros start_us, Micros period_us) : start_us_(start_us), period_us_(period_us) {}

  [[nodiscard]] Micros due_us(std::uint64_t k) const { return start_us_ + static_cast<Micros>(k) * period_us_; }
  /// The poll to do next; each number is taken once, in order.
  [[nodiscard]] std::uint64_t next() const { return next_; }
  [[nodiscard]] Micros next_due_us() const { return due_us(next_); }
  void take(std::uint64_t count = 1) { next_ += count; }

  /// Polls due before `t`: the planned count of a session that ends then.
  [[nodiscard]] std::uint64_t planned_before(Micros t) const {
    return t <= start_us_ ? 0 : static_cast<std::uint64_t>((t - start_us_ + period_us_ - 1) / period_us_);
  }
  /// Not yet taken polls whose successor is due at `now` too: too late to be worth asking.
  [[nodiscard]] std::uint64_t overrun(Micros now) const {
    const Micros late = now - next_due_us();
    return late < period_us_ ? 0 : static_cast<std::uint64_t>(late / period_us_);
  }

 private:
  Micros start_us_;
  Micros period_us_;
  std::uint64_t next_ = 0;
};

}  // namespace tacho::recorder
