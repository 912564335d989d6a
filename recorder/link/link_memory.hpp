#pragma once
// What the links have learned about robots: word order, addresses, what they refuse. It outlives a restart in a small
// JSON file beside the log, so that a restarted recorder neither asks again for what was refused nor guesses. Nothing
// in it is believed for good: refusals are asked for again after an hour, and the first answer checks the rest.
//
// Thread-safe.

#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "schema/records.hpp"
#include "schema/wire/registers.hpp"

namespace tacho::recorder {

/// What register_plan.hpp has learned from refusals.
struct LearnedPlan {
  std::vector<wire::Range> ranges;   ///< to be asked for; empty: nothing learned
  std::vector<wire::Range> illegal;  ///< not to be asked for
  Micros at_us = 0;                  ///< wall clock
  friend bool operator==(const LearnedPlan&, const LearnedPlan&) = default;
};

struct LearnedRobot {
  std::optional<WordOrder> word_order;  ///< found for sure
  int shift = 0;                        ///< word_order.hpp
  LearnedPlan registers;
  LearnedPlan inputs;
  friend bool operator==(const LearnedRobot&, const LearnedRobot&) = default;
};

/// The last status answer of one robot, for its Modbus link to compare registers with.
class StatusHint {
 public:
  void heard(std::string_view body);
  /// Empty when there is none of the last seconds.
  [[nodiscard]] std::string recent() const;

 private:
  mutable std::mutex mutex_;
  std::string body_;
  Micros heard_us_ = 0;  // monotonic
};

class LinkMemory {
 public:
  /// Remembers for its own life only.
  LinkMemory() = default;
  /// Reads `file`; a missing one is empty, a damaged one too, see problem().
  explicit LinkMemory(std::filesystem::path file);

  /// Why the file could not be used, with what follows from it; empty when all is well.
  [[nodiscard]] const std::string& problem() const { return problem_; }

  /// `address`: what a robot is known by here, "192.168.192.5:502 unit 1". A robot that was replaced by another one at
  /// that address is noticed by the checks, not by its name.
  [[nodiscard]] LearnedRobot recall(const std::string& address) const;
  void learn(const std::string& address, const LearnedRobot& robot);

  /// One per name, for the links of that robot.
  std::shared_ptr<StatusHint> hint(const std::string& robot);

  /// Writes the file when something was learned since: whole, synced and renamed, so that a power cut leaves the old
  /// one. Returns why it could not, once per cause; empty otherwise.
  std::string save();

 private:
  std::filesystem::path file_;
  std::string problem_;
  std::string told_;
  mutable std::mutex mutex_;  // the three below
  std::map<std::string, LearnedRobot> robots_;
  std::map<std::string, std::shared_ptr<StatusHint>> hints_;
  bool changed_ = false;
};

}  // namespace tacho::recorder
