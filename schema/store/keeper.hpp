#pragma once
// Keeps a log that is being written within its rules: removes parts, and remembers what is to be told of that. One part
// per call at most: removing 256 MB takes some 60 ms. One thread.

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "schema/records.hpp"
#include "schema/store/clock_trust.hpp"
#include "schema/store/retention.hpp"

namespace tacho::store {

/// What retention goes by, and how it learns of the world around the log.
struct Retention {
  RetentionRules rules;
  std::function<HostTime()> time = {};  ///< empty: the clock is never confirmed, so nothing is removed by age
  /// Empty: the system is asked.
  std::function<std::optional<std::uint64_t>(const std::filesystem::path& folder)> free_bytes = {};
  std::function<void(const std::string&)> tell = {};  ///< what was removed, and what could not be; in words
};

class PartSequence;

class Keeper {
 public:
  explicit Keeper(Retention how) : how_(std::move(how)) {}

  void see(const ClockPoint& point) { trust_.see(point); }
  /// The wall clock when it is confirmed.
  [[nodiscard]] std::optional<Micros> now();

  enum class When : std::uint8_t { as_usual, disk_full };
  /// Removes the oldest part when a rule says so; true when one is gone.
  bool remove_one(PartSequence& parts, When when);

  /// What the log does not tell of yet: one part_removed event per part, without session.
  [[nodiscard]] const std::vector<Event>& untold() const { return untold_; }
  /// It does now.
  void told() { untold_.clear(); }

  [[nodiscard]] Forecast forecast(const std::filesystem::path& folder) const;

 private:
  static constexpr int kCallsAfterFailure = 60;

  Retention how_;
  ClockTrust trust_;
  std::vector<Event> untold_;
  int wait_ = 0;  // calls

  [[nodiscard]] std::optional<std::uint64_t> free_bytes(const std::filesystem::path& folder) const;
  [[nodiscard]] Event event_of(const KeptPart& part, RemovalReason reason) const;
};

}  // namespace tacho::store
