#pragma once
// Time as the recorder sees it, behind an interface so that schedules can be tested in virtual time.

#include <atomic>
#include <condition_variable>
#include <mutex>
#include <optional>

#include "schema/sample.hpp"

namespace tacho::recorder {

/// Thread-safe. Schedules run on the monotonic clock; the wall clock only stamps rows.
class Clock {
 public:
  virtual ~Clock() = default;
  [[nodiscard]] virtual Micros mono_us() const = 0;
  [[nodiscard]] virtual Micros wall_us() const = 0;
  /// Returns at `mono_us`, or earlier when a stop is asked for, false then, or when somebody wakes the sleeper.
  virtual bool sleep_until(Micros mono_us) = 0;
  /// When the stop was asked for, by the monotonic clock; empty while running.
  [[nodiscard]] virtual std::optional<Micros> stopped_at() const = 0;
};

/// The host's clocks, for one thread that sleeps and any that look on.
class HostClock final : public Clock {
 public:
  HostClock();
  [[nodiscard]] Micros mono_us() const override;
  [[nodiscard]] Micros wall_us() const override;
  bool sleep_until(Micros mono_us) override;
  [[nodiscard]] std::optional<Micros> stopped_at() const override;
  /// Wakes every sleeper. A second call changes nothing.
  void stop();
  /// Ends the sleep in progress, or the next one.
  void wake();
  /// How long the sleeper has been awake, or has overslept: what it does takes that long. 0 while it sleeps as it
  /// should, and before its first sleep.
  [[nodiscard]] Micros busy_us() const;

 private:
  std::atomic<Micros> busy_since_us_;  // in the future while asleep
  mutable std::mutex mutex_;
  std::condition_variable wake_;
  std::optional<Micros> stopped_at_;
  bool woken_ = false;
};

}  // namespace tacho::recorder
