#pragma once
// Turns missed polls into as few gap rows as possible: consecutive misses of one cause are one row. A row is written at
// recovery, when the cause changes, at shutdown, and at least every flush interval, so that a long outage is visible in
// the log while it lasts.

#include <functional>
#include <optional>
#include <string>

#include "schema/records.hpp"

namespace tacho::recorder {

class GapTracker {
 public:
  using Emit = std::function<void(const Gap&)>;

  /// `stream`: robot, session and source of every row.
  GapTracker(Gap stream, Micros flush_interval_us, Emit emit);

  /// `count` polls from `seq` on were missed; the first was due at `due_us`, the last at `last_due_us` (wall clock).
  void miss(std::uint64_t seq, std::uint64_t count, Micros due_us, Micros last_due_us, Cause cause,
            const std::string& detail);
  /// The open row of missed polls as an answer sent at `t_send_us` would end it; empty when there is none. It must
  /// reach the log before that answer, but only when the answer does.
  [[nodiscard]] std::optional<Gap> ended_by(Micros t_send_us) const;
  /// Poll `seq` was stored, and what ended_by() gave went with it. `missing` non-empty: some of its ranges are not in
  /// it, for `cause`.
  void stored(std::uint64_t seq, Micros t_send_us, Micros t_recv_us, Cause cause = Cause::timeout,
              const std::string& missing = {});
  /// The wall clock was set, `later_us` forward: what is open is written, and times known so far are moved.
  void clock_set(Micros later_us);
  /// Writes the open row when it is older than the flush interval.
  void flush_if_old(Micros wall_us);
  void flush();

  /// The tracker's own count of missed polls, for summaries.
  [[nodiscard]] std::uint64_t missed() const { return missed_; }

 private:
  void open(std::uint64_t seq, std::uint64_t count, Micros from_us, Micros to_us);

  Gap stream_;
  Micros flush_interval_us_;
  Emit emit_;
  std::optional<Gap> open_;
  Micros opened_us_ = 0;
  std::optional<Micros> last_good_us_;
  std::uint64_t missed_ = 0;
};

}  // namespace tacho::recorder
