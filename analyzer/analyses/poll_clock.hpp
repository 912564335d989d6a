#pragma once
// How far apart the polls of a source really are, and which pauses between two of them are gaps.

#include <algorithm>
#include <array>
#include <cstddef>
#include <deque>
#include <limits>

#include "schema/row_source.hpp"

namespace tacho {

/// The planned period of one source of one robot while the slices go by: what its coverage says, and from every event
/// `rate` on what that says.
class PlannedPeriod {
 public:
  PlannedPeriod() = default;
  PlannedPeriod(Micros planned_us, Source source) : source_(source), first_us_(planned_us), now_us_(planned_us) {}
  /// Before the rows of the slice.
  void open(const Slice& slice);
  /// Goes on to poll `seq`, and to changes that were made until `t_us`. True when the period is another one since.
  bool advance(SessionId session, std::uint64_t seq, Micros t_us = std::numeric_limits<Micros>::max());
  [[nodiscard]] Micros us() const { return now_us_; }
  /// The rate is one that was chosen because the robot stood.
  [[nodiscard]] bool standing() const { return standing_; }
  [[nodiscard]] double seconds() const { return 1e-6 * static_cast<double>(now_us_); }

 private:
  struct Change {
    SessionId session;
    std::uint64_t seq;  // of the first poll that it holds for
    Micros t_us;
    Micros period_us;
    bool standing;
  };
  Source source_ = Source::status;
  Micros first_us_ = 0;
  Micros now_us_ = 0;
  bool standing_ = false;
  SessionId session_ = 0;
  std::deque<Change> ahead_;
};

/// One source of one robot. Period = median of the last pauses since the session began or the rate was changed; until
/// there are enough of them, the planned one. A pause longer than `gap_periods` periods, or a wall clock that went
/// back, is a gap: nothing is known of the time in between. Where the rate changes, the longer of both periods counts.
/// Depends on the order of rows only, not on how they are cut into slices.
class PollClock {
 public:
  PollClock(PlannedPeriod planned, double gap_periods);

  enum class Step : std::uint8_t { first, near, gap };
  void open(const Slice& slice) { planned_.open(slice); }
  /// Call once per row, in order.
  Step step(SessionId session, std::uint64_t seq, Micros t_mid_us);

  [[nodiscard]] Micros period_us() const { return period_us_; }
  /// At the last row.
  [[nodiscard]] Micros gap_limit_us() const { return limit(std::max(period_us_, unusual_us_)); }

 private:
  static constexpr std::size_t kPauses = 31;
  PlannedPeriod planned_;
  Micros period_us_;
  double gap_periods_;
  Micros unusual_us_ = 0;  // a longer period that the pause before the last row belongs to, else 0
  bool any_ = false;
  SessionId session_ = 0;
  std::uint64_t last_seq_ = 0;
  Micros last_us_ = 0;
  std::array<Micros, kPauses> pauses_{};
  std::size_t count_ = 0;  // pauses of this session at this rate
  void note(Micros pause_us);
  [[nodiscard]] Micros limit(Micros period_us) const;
};

/// First planned period of a source by its coverage; where the log does not say, the mean pause; 0 without rows.
Micros planned_period_us(const Coverage* coverage);

}  // namespace tacho
