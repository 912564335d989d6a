#pragma once
// From polled snapshots of the alarm arrays to alarm intervals.
//
// Nothing is known between two polls, so every onset and every end is an interval that holds the truth:
//   raise  absent in poll k-1, present in poll k   -> onset in (send of k-1, receive of k]
//   clear  present in poll j-1, absent in poll j   -> end in (send of j-1, receive of j]
// An array that is missing from an answer says nothing; an empty array says "none". After a gap the robot's own stamp
// decides whether it is still the same alarm. The robot's stamp narrows an onset only where the offset between both
// clocks is known from the log (tighten).

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "schema/sample.hpp"

namespace tacho {

/// What makes two sightings the same kind of alarm.
struct AlarmKey {
  AlarmLevel level = AlarmLevel::fatal;
  std::int64_t code = 0;
  friend auto operator<=>(const AlarmKey&, const AlarmKey&) = default;
};
/// "error 52201"
std::string alarm_text(const AlarmKey& key);

/// One poll. `full` says that there may be more alarms than `items`: the input registers show only the first codes, and
/// an array may hold elements that could not be read.
struct AlarmPoll {
  struct Item {
    std::int64_t code = 0;
    std::int64_t stamp_s = 0;  ///< robot clock, 0 = not given
    std::int64_t times = 0;    ///< 0 = not given
  };
  struct Level {
    bool known = false;
    bool full = false;
    std::vector<Item> items;  ///< a code that stands twice counts once
  };
  Micros t_send_us = 0;
  Micros t_recv_us = 0;
  std::array<Level, kAlarmLevels> levels;
};

enum class Onset : std::uint8_t {
  seen,           ///< between two polls
  inferred,       ///< hidden between two polls: new stamp and `times` started again
  in_gap,         ///< somewhere in a gap
  before_record,  ///< present in the first poll
};
enum class Clear : std::uint8_t {
  seen,
  inferred,
  in_gap,
  censored,  ///< after a gap another alarm of this code stood there: ended somewhere in the gap
  open,      ///< stands at the end of the record
};
const char* onset_name(Onset onset);
const char* clear_name(Clear clear);

/// Where the robot was and what it did when the alarm was first seen.
struct AlarmContext {
  std::optional<double> x_m, y_m, speed_mps, battery_level, confidence, rssi;
  std::optional<std::int64_t> task_status, task_type;
  std::string station, map;
};

struct AlarmInterval {
  AlarmKey key;
  Onset onset = Onset::seen;
  Clear clear = Clear::open;
  std::optional<Micros> onset_lo_us;  ///< empty: no bound
  Micros onset_hi_us = 0;
  Micros clear_lo_us = 0;
  std::optional<Micros> clear_hi_us;  ///< empty: no bound
  std::int64_t stamp_s = 0;           ///< at first sight
  std::int64_t first_times = 0;
  std::int64_t repeats = 0;      ///< sum of positive steps of `times`
  bool over_gap = false;         ///< goes on over a gap, proven by its stamp
  bool assumed_one = false;      ///< goes on over a gap, without a stamp to prove it
  Micros unseen_us = 0;          ///< of gaps it is only assumed to stand over: in the longest possible duration alone
  bool censored_set = false;     ///< its set was full once: bounds, not sightings
  bool stamped = false;          ///< onset narrowed by the robot's stamp
  double stopped_s = 0.0;        ///< stopped time attributed, shared equally between simultaneous alarms
  double stopped_first_s = 0.0;  ///< the same, all of it to the alarm that stood first
  AlarmContext context;

  /// Raised while the robot was observed: what rates count.
  [[nodiscard]] bool counts() const { return onset == Onset::seen || onset == Onset::inferred; }
  [[nodiscard]] Micros onset_mid_us() const;
  [[nodiscard]] double duration_lo_s() const;
  /// Empty: no bound.
  [[nodiscard]] std::optional<double> duration_hi_s() const;
};

/// How long an alarm stood inside the record. What gaps may hold of it is in `hi` alone: nobody was there to see it.
struct ActiveTime {
  double mid_s = 0.0, lo_s = 0.0, hi_s = 0.0;
};
/// `record_from_us`: the first poll, where an alarm that stood already is taken up; `counted_until_us`: end of what the
/// upper limits of earlier alarms of this key hold, for two that met in one gap did not both last through it.
ActiveTime active_time(const AlarmInterval& alarm, Micros record_from_us, Micros counted_until_us);

/// Host clock minus robot clock, as an interval that holds the truth.
struct ClockOffset {
  Micros lo_us = 0;
  Micros hi_us = 0;
};

/// What `times` and the stamp do on this robot, counted.
struct StampCounts {
  std::int64_t narrowed = 0;     ///< onsets narrowed by a stamp
  std::int64_t conflicts = 0;    ///< stamp and polls exclude each other: one of the clocks is wrong
  std::int64_t last_moves = 0;   ///< `times` grew and the stamp moved: it tells the last occurrence
  std::int64_t first_stays = 0;  ///< `times` grew and the stamp stayed: it tells the first
  std::int64_t ambiguous = 0;    ///< the stamp moved without a step of `times` that explains it
  std::int64_t times_fell = 0;   ///< `times` fell under the same stamp
};

/// One robot. Feed polls in order; `limit_us` is the longest pause that is not a gap.
class AlarmTracker {
 public:
  /// Returns the intervals raised by this poll, as indices into intervals().
  const std::vector<std::size_t>& poll(const AlarmPoll& poll, Micros limit_us);
  /// Narrows the onset of a just raised interval by its stamp.
  void tighten(std::size_t interval, const ClockOffset& offset);

  [[nodiscard]] const std::vector<AlarmInterval>& intervals() const { return intervals_; }
  [[nodiscard]] AlarmInterval& interval(std::size_t i) { return intervals_[i]; }
  /// Alarms seen in the last poll, oldest first.
  [[nodiscard]] const std::vector<std::size_t>& active() const { return active_; }
  [[nodiscard]] const StampCounts& stamps() const { return stamps_; }

 private:
  struct Open {
    std::size_t interval = 0;
    std::int64_t stamp_s = 0;
    std::int64_t times = 0;
    bool hidden = false;  // not in the full set, perhaps still standing
    bool seen = false;    // in the poll being worked on
  };
  struct LevelState {
    bool any = false;
    bool full = false;
    Micros t_mid_us = 0;
    Micros t_send_us = 0;
    std::optional<Micros> not_full_us;  // last poll that proves absence of what it does not show
    std::map<std::int64_t, Open> open;
  };
  std::array<LevelState, kAlarmLevels> levels_;
  std::vector<AlarmInterval> intervals_;
  std::vector<std::size_t> raised_;
  std::vector<std::size_t> active_;
  StampCounts stamps_;

  struct View;  // one level of one poll against the one before
  void level(const View& view);
  Open& raise(const View& view, const AlarmPoll::Item& item, Onset onset);
  void still_there(const View& view, const AlarmPoll::Item& item, Open& open);
  void restart(const View& view, const AlarmPoll::Item& item, Open& open, bool gap);
  void close_missing(const View& view);
};

}  // namespace tacho
