#pragma once
// Preparation of all odometry measures (METHODS A.2): rows of one source of one robot become segments inside which
// integration is allowed, with tags for what must not count everywhere.
//
// A new segment starts where: a session starts, host time runs backwards, uptime falls (reboot), the pause to the row
// before exceeds max(3 median periods, 2 s), map or map md5 change, localisation leaves or regains "success", the
// counter falls, or poses start or end. The median period is that of the last 31 pauses of the session (the planned
// period until there are five): causal, so that the cut into slices cannot matter, and following a changed rate. Rows
// with the uptime of the row before are duplicates and are left out. -0.0 is 0.
//
// A Track keeps 64 bytes per row that matters. While the robot stands, only the first and last row of a standstill are
// kept, and rows where pose, confidence or tags change; the row after a hole carries kStood.

#include <array>
#include <cstdint>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "analyzer/analyses/odometry_settings.hpp"
#include "analyzer/analyses/poll_clock.hpp"
#include "analyzer/math/se2.hpp"
#include "schema/row_source.hpp"

namespace tacho::odometry {

inline constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

/// One answer as read; NaN and -1 where the robot did not say.
struct RawRow {
  Micros t_us = 0;    ///< middle of request and answer
  double half_s = 0;  ///< half the round trip
  SessionId session = 0;
  std::uint64_t seq = 0;
  double uptime_s = kNone;
  double x = kNone, y = kNone, angle = kNone;
  double vx = kNone, vy = kNone, w = kNone;
  double odo = kNone, today_odo = kNone;
  double confidence = kNone;  ///< NaN also for the sentinels 0 and -0.0
  bool confidence_sentinel = false;
  int reloc = -1;  ///< 1 = success, in both sources
  int loc_method = -1;
  std::uint64_t map = 0;  ///< hash of map name and md5; 0 = not given
  bool manual = false, free_wheel = false, charging = false;
};

/// Polls come a little early or late: a time that is a whole number of periods by plan may last this much longer.
inline constexpr double kJitter = 1.05;
/// Why a measure of poses cannot be had with this median pause between rows, e.g. "period 10 s: drift needs polling at
/// least every 2 s"; empty when it can. 2 s by plan are 2 s, whatever their jitter.
std::string too_slow(double period_s, const Config& config, std::string_view what_needs);

/// A counter that is lower by less has not fallen: some controllers print sums with their last digits trembling.
inline constexpr double kTremble_m = 1e-6;

enum Tag : std::uint16_t {
  kPose = 1,  ///< pose given and localised
  kOdo = 2,
  kSpeed = 4,          ///< vx given
  kTurn = 8,           ///< w given
  kOdometryMode = 16,  ///< loc_method 3: the pose is not independent of the odometer
  kManual = 32,        ///< joystick active
  kFreeWheel = 64,     ///< emergency or driver_emc
  kCharging = 128,     ///< on the charging contact
  kNoEstimate = 256,   ///< confidence exactly 0 or -0.0
  kStood = 512,        ///< stood since the row before in the Track; rows between are left out
  kCut = 1024,         ///< first row of a segment
};

enum class Cut : std::uint8_t { start, session, clock, reboot, gap, map, localisation, counter, pose };
inline constexpr std::size_t kCutCount = 9;
std::string_view cut_name(Cut cut);
std::string_view cut_meaning(Cut cut);

struct Row {
  Micros t_us = 0;
  double x = 0, y = 0;
  double odo = 0;
  float angle = 0;
  float vx = 0, vy = 0, w = 0;
  float confidence = -1;  ///< -1 = none
  std::uint32_t segment = 0;
  std::uint16_t tags = 0;
  std::int8_t loc_method = -1;
  [[nodiscard]] bool all(unsigned wanted) const { return (tags & wanted) == wanted; }
  [[nodiscard]] Pose pose() const { return {x, y, static_cast<double>(angle)}; }
  [[nodiscard]] double speed() const { return std::hypot(static_cast<double>(vx), static_cast<double>(vy)); }
};

struct Segment {
  Cut cut = Cut::start;
  Micros from_us = 0;
  Micros to_us = 0;
  std::uint64_t rows = 0;
  double driven_m = 0;  ///< counter metres
};

/// A row after the rules above, with what the measures that look at every row need.
struct Prepared {
  Row row;
  double dt_s = 0;       ///< to the row before; 0 for the first of all
  bool joined = false;   ///< same segment as the row before
  Cut cut = Cut::start;  ///< meaningful when not joined
  bool slowed = false;   ///< asked at a rate for a robot that stands
};

static_assert(sizeof(Row) <= 64);

/// Applies the rules row by row.
class Preparation {
 public:
  Preparation(const Config& config, PlannedPeriod planned) : config_(config), planned_(std::move(planned)) {}
  /// Before the rows of the slice.
  void open(const Slice& slice) { planned_.open(slice); }
  /// False for a duplicate.
  bool step(const RawRow& raw, Prepared& out);
  [[nodiscard]] std::uint64_t duplicates() const { return duplicates_; }

 private:
  Config config_;
  PlannedPeriod planned_;
  double first_pause_s_ = 0;  // of the session at this rate, when no poll was missed in it
  double rate_change_s_ = 0;  // the longer period where the rate changes before this row, else 0
  RawRow last_;
  Row last_row_;
  bool any_ = false;
  std::uint32_t segment_ = 0;
  std::uint64_t duplicates_ = 0;
  std::array<float, 31> pauses_{};
  std::size_t pause_count_ = 0;

  [[nodiscard]] double gap_s() const;
  [[nodiscard]] bool cut_at(const RawRow& raw, const Row& row, double dt_s, Cut& cut) const;
};

/// Mean twist and length in time of the interval that ends at a row.
struct Interval {
  double dt_s = 0;
  Twist twist;            ///< mean of its two ends
  double metres = 0;      ///< integral of |v| by the trapezoid rule
  double counted_m = 0;   ///< growth of the counter
  bool standing = false;  ///< both ends stand and the counter did not move
};
Interval interval_of(const Row& a, const Row& b, const Config& config);

/// Rows of one source, segments, and the distribution of pauses.
class Track {
 public:
  explicit Track(const Config& config) : config_(config) {}
  void push(const Prepared& prepared);
  /// Keeps the last row; call once after the last push.
  void close();

  [[nodiscard]] const std::vector<Row>& rows() const { return rows_; }
  [[nodiscard]] const std::vector<Segment>& segments() const { return segments_; }
  [[nodiscard]] std::uint64_t total_rows() const { return total_rows_; }
  /// Median pause between rows, s; NaN with fewer than two rows.
  [[nodiscard]] double period_s() const;
  [[nodiscard]] double driven_m() const;
  /// Hours of rows that carry the tag.
  [[nodiscard]] double hours_with(Tag tag) const;
  [[nodiscard]] std::uint64_t rows_with(Tag tag) const;

 private:
  Config config_;
  std::vector<Row> rows_;
  std::vector<Segment> segments_;
  Row pending_;
  bool has_pending_ = false;
  std::uint64_t total_rows_ = 0;
  using Bins = std::vector<std::uint32_t>;  // by milliseconds, the last one open
  Bins pause_bins_ = Bins(60'001);
  Bins slowed_bins_ = Bins(60'001);  // of pauses at a rate for a robot that stands
  std::array<double, 11> tag_seconds_{};
  std::array<std::uint64_t, 11> tag_rows_{};

  [[nodiscard]] bool standing_on(const Row& row) const;
  void count(const Prepared& prepared);
};

}  // namespace tacho::odometry
