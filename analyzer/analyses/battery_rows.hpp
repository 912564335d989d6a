#pragma once
// The rows of one robot as the battery analysis sees them: one per answer of the source that gives the current (else
// the SoC, the voltage, the temperature), whatever mixture of sources the log has. Status comes first, then the
// registers and discrete inputs. Values of another source are held until its next answer, at most gap_periods of its
// periods.
//
// Sentinels become missing: voltage <= 0, SoC outside 0..1, no finite number. What is only known at the end
// (temperature or counter 0 for the whole record) is kept in ItemStats.

#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "analyzer/analyses/battery_settings.hpp"
#include "analyzer/analyses/poll_clock.hpp"
#include "analyzer/analysis.hpp"

namespace tacho::battery {

inline constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

enum class Flag : std::int8_t { unknown = -1, off = 0, on = 1 };

struct Row {
  Micros t_us = 0;           ///< middle of request and answer, host clock
  double gap_limit_s = 0.0;  ///< a longer pause is a gap
  double soc = kNone;
  double voltage_v = kNone;
  double current_a = kNone;  ///< sign as the robot gives it
  double temp_c = kNone;
  double max_charge_v = kNone;
  double max_charge_a = kNone;
  double speed_mps = kNone;
  std::int64_t counter = -1;      ///< battery_cycle; -1 = not given
  std::int64_t task_status = -1;  ///< -1 = not given
  Flag charging = Flag::unknown;
  Flag docked = Flag::unknown;
  Flag plugged = Flag::unknown;
  Flag standing = Flag::unknown;
  Flag emergency = Flag::unknown;
  Flag alarm = Flag::unknown;  ///< a fatal or error alarm is present
  std::string_view station;    ///< valid during the call

  /// Seconds since an earlier row; negative after the clock was set back.
  [[nodiscard]] double since(Micros t) const { return static_cast<double>(t_us - t) * 1e-6; }
  /// May be integrated over from an earlier row at `t`.
  [[nodiscard]] bool joins(Micros t) const { return t_us > t && since(t) <= gap_limit_s; }
};

enum class Item : std::uint8_t {
  level,
  voltage,
  current,
  temp,
  counter,
  charging,
  docked,
  plugged,
  max_charge_v,
  max_charge_a,
  vx,
  standing,
  task,
  station,
  emergency,
  fatals,
  errors,
  has_fatal,
  has_error,
};
inline constexpr std::size_t kItems = 19;

/// What a field gave over the record.
struct ItemStats {
  std::optional<Source> source;
  std::uint64_t rows = 0;   ///< answers of its source
  std::uint64_t given = 0;  ///< with a usable value
  std::uint64_t zeros = 0;  ///< of those, exactly 0
  Micros first_us = 0;      ///< first and last with a usable value
  Micros last_us = 0;
  [[nodiscard]] bool always_zero() const { return given > 0 && zeros == given; }
};

std::vector<Need> needs();
std::string_view item_name(Item item);  ///< the field's name

class RowReader {
 public:
  RowReader(const RobotContext& context, const Config& config);

  /// Calls `step(const Row&)` for each row of the slice.
  template <class Step>
  void read(const Slice& slice, Step&& step) {
    open(slice);
    while (Cursor* next = earliest()) {
      if (take(*next)) {
        step(row_);
      }
    }
  }

  [[nodiscard]] const ItemStats& stats(Item item) const { return stats_[static_cast<std::size_t>(item)]; }
  [[nodiscard]] bool any() const { return clock_.has_value(); }
  [[nodiscard]] std::optional<Source> clock_source() const { return clock_; }
  [[nodiscard]] std::uint64_t rows() const { return rows_; }
  [[nodiscard]] Micros first_us() const { return first_us_; }
  [[nodiscard]] Micros last_us() const { return last_us_; }

 private:
  struct Held {
    bool has = false;
    double value = 0.0;
    Micros t_us = 0;
  };
  struct Cursor {
    const Batch* batch = nullptr;
    std::size_t row = 0;
    std::vector<std::pair<Item, const Column*>> columns;
  };
  Config config_;
  std::array<ItemStats, kItems> stats_;
  std::array<Held, kItems> held_;
  std::string station_;
  std::array<PlannedPeriod, kSourceCount> planned_;
  SessionId session_ = 0;
  double rate_change_s_ = 0;  // the longer period where the rate of the clock source changes before its row, else 0
  std::optional<Source> clock_;
  std::vector<Cursor> cursors_;
  Row row_;
  std::uint64_t rows_ = 0;
  Micros first_us_ = 0;
  Micros last_us_ = 0;
  static constexpr std::size_t kRing = 15;
  std::array<double, kRing> intervals_{};  // of the clock source, newest overwrites oldest
  std::size_t interval_count_ = 0;

  void open(const Slice& slice);
  Cursor* earliest();
  bool take(Cursor& cursor);
  void update(Item item, const Batch& batch, const Column& column, std::size_t row);
  void build(Micros t_us);
  [[nodiscard]] double period_s() const;
  [[nodiscard]] double value(Item item) const;
  [[nodiscard]] Flag flag(Item item) const;
};

}  // namespace tacho::battery
