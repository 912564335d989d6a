#pragma once
// How far apart the polls of a source really are, and which pauses between two of them are gaps.

#include <array>
#include <cstddef>

#include "schema/row_source.hpp"

namespace tacho {

/// One source of one robot. Period = median of the last pauses of the session; until there are enough of them, the
/// planned one. A pause longer than `gap_periods` periods, or a wall clock that went back, is a gap: nothing is known
/// of the time in between. Depends on the order of rows only, not on how they are cut into slices.
class PollClock {
 public:
  PollClock(Micros planned_us, double gap_periods);

  enum class Step : std::uint8_t { first, near, gap };
  /// Call once per row, in order.
  Step step(SessionId session, Micros t_mid_us);

  [[nodiscard]] Micros period_us() const { return period_us_; }
  [[nodiscard]] Micros gap_limit_us() const;

 private:
  static constexpr std::size_t kPauses = 31;
  Micros planned_us_;
  Micros period_us_;
  double gap_periods_;
  bool any_ = false;
  SessionId session_ = 0;
  Micros last_us_ = 0;
  std::array<Micros, kPauses> pauses_{};
  std::size_t count_ = 0;  // pauses of this session
  void note(Micros pause_us);
};

/// Planned period of a source by its coverage; where the log does not say, the mean pause; 0 without rows.
Micros planned_period_us(const Coverage* coverage);

}  // namespace tacho
