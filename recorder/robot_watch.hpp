#pragma once
// What one robot is doing, told from its answers while they pass by. Shared by the pollers of the robot.
//
// Faster at once, slower with patience: an activity counts as possible until the answers have denied it for the hold
// time without interruption. What nobody tells, or nobody has told for long, is possible: a robot is never asked more
// slowly than it is known to need. `inputs` alone tell of no speed, so a robot of which only they are recorded is asked
// as if it moved.

#include <functional>
#include <mutex>
#include <optional>

#include "recorder/rates.hpp"
#include "schema/log.hpp"

namespace tacho::recorder {

class RobotWatch {
 public:
  struct Options {
    Micros hold_us = 10'000'000;   ///< before it is asked more slowly
    Micros stale_us = 30'000'000;  ///< what was told longer ago is not known; more than the slowest period
  };
  explicit RobotWatch(Options options) : options_(options) {}
  /// Called, from the thread of look(), when the robot may need a faster rate. Before the first look().
  void on_faster(std::function<void()> call) { faster_ = std::move(call); }

  // Thread-safe.
  void look(const Answer& answer, WordOrder order, Micros mono_us);
  /// Never empty.
  [[nodiscard]] Activities possible(Micros mono_us) const;

 private:
  /// Something an answer told, and when.
  struct Fact {
    std::optional<bool> value;
    Micros told_us = 0;
    void tell(std::optional<bool> now, Micros mono_us);
    [[nodiscard]] std::optional<bool> at(Micros mono_us, Micros stale_us) const;
  };
  void learn(Micros mono_us);
  [[nodiscard]] Activities told(Micros mono_us) const;
  [[nodiscard]] Activities possible_now(Micros mono_us) const;

  const Options options_;
  std::function<void()> faster_;
  mutable std::mutex mutex_;  // all below
  AnswerDecoder decoder_;
  Gates gates_;
  Sample sample_;
  Fact moves_;
  Fact works_;
  Fact charges_;
  std::optional<Micros> last_look_us_;
  std::array<Micros, kActivityCount> last_possible_us_{};
};

}  // namespace tacho::recorder
