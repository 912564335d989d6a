#pragma once
// Whether the wall clock of this host is right, as far as can be known. Removing parts by their age asks for it: a
// clock that is a year ahead must delete nothing.
//
// Confirmed is the clock when the kernel says it is synchronised (NTP), or when more robots of the log show the same
// time within an hour than do not. It stays so, also when the network goes, until it has been set by more than an hour
// since, in one step or in several. What a sleeping computer missed counts as a step, too, because the monotonic clock
// sleeps with it: then it waits for the next confirmation.

#include <map>
#include <optional>

#include "schema/records.hpp"

namespace tacho::store {

/// The host's clocks at one moment.
struct HostTime {
  Micros wall_us = 0;
  Micros mono_us = 0;
  bool synchronised = false;  ///< the kernel says that the wall clock is disciplined
};
HostTime host_time();

class ClockTrust {
 public:
  /// A clock point of this host, with a robot's clock or without.
  void see(const ClockPoint& point);
  /// The wall clock when it is confirmed.
  std::optional<Micros> now(const HostTime& time);

  static constexpr Micros kStepUs = 3'600'000'000;

 private:
  std::optional<Micros> wall_minus_mono_;
  bool synchronised_ = false;      // since the last step
  std::map<RobotId, bool> agree_;  // since the last step, by the newest point of each robot

  void follow(Micros wall_minus_mono);
};

}  // namespace tacho::store
