#pragma once
// Who one robot is and what it is doing, told from its answers while they pass by. Shared by the pollers of the robot.
//
// A robot is who it says it is (vehicle_id, MAC, model_md5); the address is only where it was found. Status answers
// tell it; the answer of another robot is not this one's. What an answer does not tell is no difference. Modbus tells
// nobody's identity: until the next status answer its values may be the other robot's.
//
// Faster at once, slower with patience: an activity counts as possible until the answers have denied it for the hold
// time without interruption. What nobody tells, or nobody has told for long, is possible: a robot is never asked more
// slowly than it is known to need. `inputs` alone tell of no speed, so a robot of which only they are recorded is asked
// as if it moved.

#include <functional>
#include <mutex>
#include <optional>

#include "recorder/identity.hpp"
#include "recorder/rates.hpp"
#include "schema/log.hpp"

namespace tacho::recorder {

/// Decodes the few fields that are looked at; shared by all robots of a recorder, because a decoder is large.
class AnswerReader {
 public:
  /// Calls `use` with the decoded answer. Thread-safe; one at a time.
  void read(const Answer& answer, WordOrder order, const FieldSet& wanted,
            const std::function<void(const Sample&)>& use);

 private:
  std::mutex mutex_;
  AnswerDecoder decoder_;
  Sample sample_;
};

class RobotWatch {
 public:
  struct Options {
    Identity identity;             ///< as far as it is known
    bool rates_vary = true;        ///< false: only who it is matters
    Micros hold_us = 10'000'000;   ///< before it is asked more slowly
    Micros stale_us = 30'000'000;  ///< what was told longer ago is not known; more than the slowest period
  };
  /// `reader` must outlive it.
  RobotWatch(Options options, AnswerReader& reader);
  /// Called, from the thread of look(), when the robot may need a faster rate. Before the first look().
  void on_faster(std::function<void()> call) { faster_ = std::move(call); }

  // Thread-safe.
  /// Who answered, when it was another robot: nothing is learned from it then.
  [[nodiscard]] std::optional<Identity> look(const Answer& answer, WordOrder order, Micros mono_us);
  /// Never empty.
  [[nodiscard]] Activities possible(Micros mono_us) const;
  [[nodiscard]] Identity identity() const;

 private:
  /// Something an answer told, and when.
  struct Fact {
    std::optional<bool> value;
    Micros told_us = 0;
    void tell(std::optional<bool> now, Micros mono_us);
    [[nodiscard]] std::optional<bool> at(Micros mono_us, Micros stale_us) const;
  };
  void learn(const Sample& sample, Micros mono_us);
  [[nodiscard]] Activities told(Micros mono_us) const;
  [[nodiscard]] Activities possible_now(Micros mono_us) const;

  const Options options_;
  AnswerReader& reader_;
  std::function<void()> faster_;
  mutable std::mutex mutex_;  // all below
  Identity identity_;
  Fact moves_;
  Fact works_;
  Fact charges_;
  std::optional<Micros> last_look_us_;
  std::array<Micros, kActivityCount> last_possible_us_{};
};

}  // namespace tacho::recorder
