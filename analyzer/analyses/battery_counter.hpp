#pragma once
// What the battery's own cycle counter counts (B5): the slope of our equivalent full cycles on battery_cycle (Theil-Sen
// over its steps) is the number of full cycles per count. Gauges count whenever the discharge reaches a set share of
// the capacity, so 1.0, 0.9 and 0.8 are all normal; others count charge sessions. Forecasts use our EFC, the class is a
// note.

#include <optional>
#include <string>
#include <vector>

#include "analyzer/analyses/battery_cycles.hpp"
#include "analyzer/math/theil_sen.hpp"

namespace tacho::battery {

enum class CounterClass : std::uint8_t {
  not_supplied,  ///< absent, or 0 for the whole record
  too_few,       ///< too few steps to tell
  full_cycles,   ///< 1.0 +- 0.05 EFC per count
  share_90,      ///< 0.9 +- 0.04
  share_80,      ///< 0.8 +- 0.04
  sessions,      ///< one per charge session, 1 +- 0.05
  other,         ///< steady, another share
  frozen,        ///< no step although EFC grew
  erratic,       ///< falls, or no steady slope
};
std::string_view counter_class_name(CounterClass kind);

struct CounterResult {
  CounterClass kind = CounterClass::not_supplied;
  std::optional<SlopeLine> efc_per_count;
  std::optional<SlopeLine> sessions_per_count;
  std::int64_t first = 0;
  std::int64_t last = 0;
  std::size_t steps = 0;
  std::size_t falls = 0;  ///< that came back; a lasting fall is a new pack
  double efc = 0.0;       ///< EFC between the first and the last reading
};

class CycleCounter {
 public:
  /// `sessions`: charge sessions started so far, for either sign of charging.
  void step(const Row& row, const SocPath& path, std::size_t sessions_positive, std::size_t sessions_negative);
  /// The counter fell for a moment and came back.
  void glitch() { ++falls_; }
  /// Ends the record; `path` is still running.
  void finish(const SocPath& path) { end_efc_ = path.so_far(); }
  /// `sign` of charging, `rung` of the chosen hysteresis.
  [[nodiscard]] CounterResult result(int sign, std::size_t rung, std::size_t least_steps) const;

 private:
  struct Step {
    double value = 0.0;
    PerRung efc{};
    double sessions_positive = 0.0;
    double sessions_negative = 0.0;
  };
  std::vector<Step> steps_;  // at each new value
  PerRung begin_efc_{};
  PerRung end_efc_{};
  std::optional<std::int64_t> first_, last_;
  std::size_t falls_ = 0;
};

}  // namespace tacho::battery
