#pragma once
// The incident ring: the last seconds of the source `ring` of every robot, in memory, until something happens to the
// robot; then what is kept and what comes for a while is written to the log. Pure; one thread at a time.
//
// Numbers: what ages out is counted and is no gap, so polls get the numbers of the log when they are written. Every
// window is announced by an event `ring_kept`. Times are monotonic, so that a clock that is set moves no window.

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <string>

#include "schema/records.hpp"

namespace tacho::recorder {

struct RingSettings {
  Micros before_us = 30'000'000;
  Micros after_us = 30'000'000;            ///< since the last trigger
  std::uint64_t budget_bytes = 64u << 20;  ///< of all robots together; the oldest answers go first
  std::uint64_t day_bytes = 1u << 30;      ///< answers that are written in 24 h at most: alarms may repeat for ever
};

/// What sets it off: "alarm_raised error 52201", "blocked", ...; empty: this event does not. Alarms and flags that
/// stand already when a recording begins do not.
std::string ring_trigger(const Event& event);

class Ring {
 public:
  /// One poll or one stretch of missed polls.
  struct Row {
    std::optional<Gap> gap;  ///< before the answer
    std::optional<Answer> answer;
    /// Polls it stands for.
    [[nodiscard]] std::uint64_t polls() const { return (gap ? gap->seq_count : 0) + (answer ? 1 : 0); }
    [[nodiscard]] std::size_t bytes() const;
  };
  struct Counts {
    std::uint64_t aged_out = 0;  ///< polls
    std::uint64_t written = 0;   ///< polls: the number of the next one
  };
  using Write = std::function<void(const Row&)>;
  using Announce = std::function<void(const Event&)>;

  Ring(RingSettings settings, Write write, Announce announce);

  /// Keeps it, or writes it while a window is open.
  void add(RobotId robot, Row row, Micros mono_us);
  /// `event` is what happened; the window opens now or stays open for longer.
  void trigger(const Event& event, const std::string& why, Micros mono_us);
  /// Nothing will come any more: what is kept ages out.
  void end();

  [[nodiscard]] Counts counts(RobotId robot) const;
  [[nodiscard]] std::size_t bytes() const { return bytes_; }

 private:
  struct Kept {
    Row row;
    Micros mono_us;
  };
  struct Robot {
    std::deque<Kept> kept;
    Micros open_until_us = 0;
    Event window;                     // that announced the open one
    std::uint64_t told_aged_out = 0;  // by the last announcement
    Counts counts;
  };
  void cut_off(Robot& robot, Micros t_us);
  void write(Robot& robot, Row row);
  void drop_oldest(Robot& robot);
  void shrink();
  [[nodiscard]] bool spent(Micros mono_us);

  const RingSettings settings_;
  Write write_;
  Announce announce_;
  std::map<RobotId, Robot> robots_;
  std::size_t bytes_ = 0;
  Micros day_began_us_ = 0;
  std::uint64_t day_bytes_ = 0;
  bool told_spent_ = false;
};

}  // namespace tacho::recorder
