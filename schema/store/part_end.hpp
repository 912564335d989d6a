#pragma once
// When the part that is written comes to its end: by size, at the end of the UTC day, or because a reader keeps its WAL
// from being emptied.

#include <cstdint>
#include <optional>

#include "schema/sample.hpp"

namespace tacho::store {

class PartEnd {
 public:
  PartEnd(std::uint64_t bytes, bool per_day) : bytes_(bytes), per_day_(per_day) {}

  /// A row of this time is in the part. Its day is that of the first one.
  void add(Micros t_us) {
    day_ = day_.value_or(day_of(t_us));
    newest_us_ = t_us;
  }
  /// A row that the part had when it was opened.
  void had(Micros t_us) { day_ = day_ ? std::min(*day_, day_of(t_us)) : day_of(t_us); }
  /// A row of the next UTC day, or one from more than a day back after the clock was set, belongs into a new part. Rows
  /// from just before midnight that arrive late do not.
  [[nodiscard]] bool excludes(Micros t_us) const {
    return per_day_ && day_ && (day_of(t_us) > *day_ || day_of(t_us) < *day_ - 1);
  }
  /// Whatever its size and day.
  void demand() { demanded_ = true; }
  /// A part without rows never is over.
  [[nodiscard]] bool over(std::uint64_t bytes) const { return day_ && (demanded_ || bytes >= bytes_); }
  /// Soon it will be: time to make the next one ready.
  [[nodiscard]] bool near(std::uint64_t bytes) const {
    return day_ && (bytes >= bytes_ - bytes_ / 8 || (per_day_ && day_of(newest_us_ + kAheadUs) > day_of(newest_us_)));
  }
  /// Of the next part.
  void restart() {
    day_.reset();
    demanded_ = false;
  }

 private:
  static constexpr Micros kDayUs = 86'400'000'000;
  static constexpr Micros kAheadUs = 600'000'000;

  std::uint64_t bytes_;
  bool per_day_;
  std::optional<Micros> day_;
  Micros newest_us_ = 0;
  bool demanded_ = false;

  static Micros day_of(Micros t_us) { return t_us >= 0 ? t_us / kDayUs : (t_us + 1) / kDayUs - 1; }
};

}  // namespace tacho::store
