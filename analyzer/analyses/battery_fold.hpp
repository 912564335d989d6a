#pragma once
// All that is kept of one robot while its rows go by, and the result when they have. No row is kept: memory is days,
// sessions, turning points and the drawn curve.

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "analyzer/analyses/battery_counter.hpp"
#include "analyzer/analyses/battery_cycles.hpp"
#include "analyzer/analyses/battery_rows.hpp"
#include "analyzer/analyses/battery_sessions.hpp"
#include "analyzer/analyses/battery_states.hpp"
#include "analyzer/analyses/battery_trends.hpp"
#include "analyzer/analyses/battery_usage.hpp"

namespace tacho::battery {

/// The longest stretch without gap that begins and ends at the same SoC: only there do charge in and out compare.
struct ClosedPeriod {
  Micros from_us = 0;
  Micros to_us = 0;
  double positive_ah = 0.0;
  double negative_ah = 0.0;
  double soc_error = 0.0;  ///< |difference of SoC| at the two ends
  double efc = 0.0;
};

class ClosedPeriods {
 public:
  void step(const Row& row, const FlowStep& flow, double efc_so_far);
  [[nodiscard]] const ClosedPeriod& best() const { return best_; }

 private:
  ClosedPeriod now_, best_;
  double soc_ = kNone;
  double efc_ = 0.0;
  Micros t_us_ = 0;
};

/// One battery pack; a lasting fall of battery_cycle starts another.
struct Pack {
  explicit Pack(const Config& config) : path(config), days(config) {}
  Micros from_us = 0;
  Micros to_us = 0;
  SocPath path;
  Throughput flow;
  Days days;
  CycleCounter counter;
  ClosedPeriods closed;
  Cycles cycles;  ///< after finish
};

/// What looked like another pack without proof: SoC and the charge limits all stepped across a gap.
struct PackHint {
  Micros from_us = 0;
  Micros to_us = 0;
};

class RobotFold {
 public:
  explicit RobotFold(const RobotContext& context);
  void fold(const Slice& slice);
  void finish();

  Robot robot;
  Config config;
  const Settings* settings;
  RowReader reader;
  DayClock clock;
  std::vector<std::unique_ptr<Pack>> packs;  ///< never empty after the first row
  CurrentSign current_sign;
  CurrentNoise noise;
  UseClock use;
  BySign<std::unique_ptr<ChargeSessions>> sessions;
  BySign<std::unique_ptr<Contradictions>> contradictions;
  Usage usage;
  std::vector<PackHint> hints;

  [[nodiscard]] int sign() const { return current_sign.sign(); }
  [[nodiscard]] const ChargeSessions& charges() const { return *sessions.at(sign()); }
  [[nodiscard]] double threshold_a() const;
  /// SoC was given, and is not 0 for the whole record.
  [[nodiscard]] bool has_soc() const;
  [[nodiscard]] bool has_current() const;
  [[nodiscard]] bool has_temperature() const;

 private:
  std::int64_t counter_ = -1;  // accepted value
  int lower_rows_ = 0;         // rows in a row with a lower one
  Row last_;
  bool any_ = false;

  void step(Row row);
  bool new_pack(Row& row);
  void hint(const Row& row);
};

}  // namespace tacho::battery
