#pragma once
// How the battery is used (B4) and what its temperature does: shares of time, histograms, habits, and the curve of SoC
// for the report.

#include <array>
#include <cstdint>
#include <vector>

#include "analyzer/analyses/battery_states.hpp"

namespace tacho::battery {

/// Seconds per bin of a quantity; quantiles by time.
class TimeHistogram {
 public:
  TimeHistogram(double from, double width, std::size_t bins) : from_(from), width_(width), seconds_(bins) {}
  void add(double value, double seconds);
  [[nodiscard]] double total() const;
  /// Upper edge of the bin in which `share` of the time is reached; NaN when empty.
  [[nodiscard]] double quantile(double share) const;
  [[nodiscard]] const std::vector<double>& seconds() const { return seconds_; }
  [[nodiscard]] double edge(std::size_t bin) const { return from_ + width_ * static_cast<double>(bin); }

 private:
  double from_;
  double width_;
  std::vector<double> seconds_;
};

/// Lowest and highest SoC per bucket of time, in the order they came; a gap is a NaN.
class SocCurve {
 public:
  explicit SocCurve(Micros bucket_us) : bucket_us_(bucket_us) {}
  void step(const Row& row);
  void finish();
  [[nodiscard]] const std::vector<Micros>& t_us() const { return t_; }
  [[nodiscard]] const std::vector<double>& value() const { return value_; }

 private:
  struct Point {
    Micros t_us = 0;
    double soc = 0.0;
  };
  Micros bucket_us_;
  Micros bucket_ = 0;
  Point low_, high_;
  bool open_ = false;
  Micros last_us_ = 0;
  std::vector<Micros> t_;
  std::vector<double> value_;
  void flush();
};

/// A condition that must last a while: total time of its stretches, and the first of them.
class Lasting {
 public:
  explicit Lasting(double least_s) : least_s_(least_s) {}
  void step(const Row& row, bool holds);
  void finish();
  [[nodiscard]] double seconds() const { return seconds_; }
  [[nodiscard]] std::uint64_t count() const { return count_; }
  [[nodiscard]] const std::vector<Stretch>& examples() const { return examples_; }  ///< the first 20

 private:
  double least_s_;
  double seconds_ = 0.0;
  std::uint64_t count_ = 0;
  std::vector<Stretch> examples_;
  Stretch now_;
  bool open_ = false;
  Micros t_us_ = 0;
};

class Usage {
 public:
  Usage(const Config& config, Micros curve_bucket_us);
  void step(const Row& row, const FlowStep& flow);
  void finish();

  double observed_s = 0.0;
  double soc_s = 0.0;  ///< with SoC known
  double above_90_s = 0.0;
  double below_20_s = 0.0;
  double below_10_s = 0.0;
  double soc_min = kNone;
  double soc_max = kNone;
  Micros soc_min_us = 0;
  double temp_min = kNone;
  double temp_max = kNone;
  Micros temp_max_us = 0;
  double longest_not_full_s = 0.0;  ///< between two times at full_soc, or from the record's start or to its end
  BySign<TimeHistogram> current{TimeHistogram(0, 0.5, 1000), TimeHistogram(0, 0.5, 1000)};
  TimeHistogram temperature{-40, 5, 28};
  SocCurve curve;
  Lasting deep, low;        ///< SoC below deep_soc, low_soc
  Lasting hot, warm, cold;  ///< for a minute at least
  Lasting missed_charge;    ///< idle, not charging, could have charged

 private:
  Config config_;
  Micros t_us_ = 0;
  bool any_ = false;
  Micros full_us_ = 0;
  bool full_known_ = false;
};

}  // namespace tacho::battery
