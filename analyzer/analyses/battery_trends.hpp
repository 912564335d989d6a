#pragma once
// One value per day, and its trend (B8 steps 1 to 4): equivalent full cycles per observed 24 h, depth of discharge (the
// largest fall of SoC inside the day) and resting voltage (mean voltage while the robot stands and draws little, in the
// 10 % band of SoC that most days have). Days are those of the chosen zone; days observed for less than day_coverage of
// 24 h are left out.

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "analyzer/analyses/battery_cycles.hpp"
#include "analyzer/analyses/battery_states.hpp"
#include "analyzer/math/trend.hpp"

namespace tacho::battery {

/// Days of a zone, counted from 1970-01-01. Keeps the offset for a quarter of an hour, the grain of all zones.
class DayClock {
 public:
  explicit DayClock(std::string zone) : zone_(std::move(zone)) {}
  std::int32_t day(Micros t_us);
  [[nodiscard]] Micros noon_us(std::int32_t day) const;  ///< for drawing
  [[nodiscard]] const std::string& zone() const { return zone_; }

 private:
  std::string zone_;
  Micros quarter_ = std::numeric_limits<Micros>::min();
  Micros offset_us_ = 0;
};
/// "2026-01-31"
std::string day_name(std::int32_t day);

struct Day {
  double observed_s = 0.0;
  double soc_min = kNone;
  double soc_max = kNone;
  double soc_peak = kNone;  ///< highest so far
  double fall = kNone;      ///< depth of discharge
  double temp_max = kNone;
  BySign<double> ah;
  static constexpr std::size_t kBands = 11;  ///< tenths of SoC; the last: SoC not known
  std::array<double, kBands> rest_v{};
  std::array<std::uint32_t, kBands> rest_n{};
};

class Days {
 public:
  explicit Days(const Config& config) : standing_a_(config.standing_current_a) {}
  void step(const Row& row, const FlowStep& flow, std::int32_t day);
  [[nodiscard]] const std::map<std::int32_t, Day>& all() const { return days_; }

 private:
  double standing_a_;
  std::map<std::int32_t, Day> days_;
  Micros t_us_ = 0;
  bool any_ = false;
};

/// A series of daily values.
struct Daily {
  std::string_view name;  ///< "efc_per_day"
  std::string_view title;
  std::string_view unit;
  std::vector<std::int32_t> day;
  std::vector<double> value;  ///< NaN where the day does not count
  std::string remark;
};

/// The three series of one pack. `efc` is SocPath::days() on rung `rung`.
std::vector<Daily> daily_series(const std::map<std::int32_t, Day>& days, const std::map<std::int32_t, PerRung>& efc,
                                std::size_t rung, double least_coverage);

/// Trend of the values that count, x in days. Empty with fewer than `least` of them.
std::optional<Trend> daily_trend(const Daily& daily, std::size_t least, std::size_t& counted);

}  // namespace tacho::battery
