#pragma once
// How often a robot pushes, found from when its pushes came: nobody but its configuration knows, and that cannot be
// asked for. Pure.

#include <array>
#include <cstddef>
#include <optional>

#include "schema/sample.hpp"

namespace tacho::recorder {

class Pace {
 public:
  explicit Pace(Micros period_us) : period_us_(period_us) {}
  [[nodiscard]] Micros period_us() const { return period_us_; }

  /// A push came. Returns the new period when the median of the last intervals differs from the one in force by more
  /// than a fifth; to whole 10 ms (whole ms below 100 ms).
  std::optional<Micros> hear(Micros mono_us);
  /// The next interval is none: the connection was lost in it.
  void interrupt() { last_us_.reset(); }

 private:
  static constexpr std::size_t kIntervals = 5;
  Micros period_us_;
  std::optional<Micros> last_us_;
  std::array<Micros, kIntervals> intervals_{};
  std::size_t count_ = 0;
};

}  // namespace tacho::recorder
