#pragma once
// How often a source is asked, by what the robot is doing.

#include <algorithm>
#include <array>
#include <bitset>
#include <cstdint>
#include <string>
#include <string_view>

#include "schema/sample.hpp"

namespace tacho::recorder {

/// Names are keys of the configuration.
enum class Activity : std::uint8_t {
  moving,    ///< it moves, turns, is blocked or slowed, or has a task that runs or waits to start
  idle,      ///< none of this
  charging,  ///< as idle, and it says that it is charging
};
inline constexpr std::size_t kActivityCount = 3;
inline constexpr std::array<std::string_view, kActivityCount> kActivityNames{"moving", "idle", "charging"};

/// What a robot may be doing, one bit each: all of them when nothing is known.
using Activities = std::bitset<kActivityCount>;
/// "moving", "idle or charging", "unknown"
std::string activities_text(const Activities& activities);

/// Periods in microseconds.
struct Rates {
  std::array<Micros, kActivityCount> period_us{};
  Rates() = default;
  Rates(Micros always) { period_us.fill(always); }  // NOLINT: a period is a rate that never changes
  Rates(Micros moving, Micros idle, Micros charging) : period_us{moving, idle, charging} {}

  [[nodiscard]] Micros fastest() const { return *std::min_element(period_us.begin(), period_us.end()); }
  [[nodiscard]] Micros slowest() const { return *std::max_element(period_us.begin(), period_us.end()); }
  [[nodiscard]] bool varies() const { return fastest() != slowest(); }
  /// The fastest of those that the robot may need; the fastest of all when `possible` is empty.
  [[nodiscard]] Micros in(const Activities& possible) const;
};

}  // namespace tacho::recorder
