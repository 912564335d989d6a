#pragma once
// From polls of `blocked` (or `slowed`) to episodes. Onset and end are intervals that hold the truth, as for alarms.

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "analyzer/math/traversal.hpp"
#include "schema/sample.hpp"

namespace tacho {

/// What the robot was about when it was stopped; kept as separate layers.
enum class EpisodeClass : std::uint8_t { on_task, off_task, manual, charging, emergency };
inline constexpr std::size_t kEpisodeClasses = 5;
const char* episode_class_name(EpisodeClass cls);

/// What one poll says while the flag is on.
struct Sighting {
  std::optional<std::int64_t> reason;
  std::optional<math::Point> at;  ///< robot
  std::optional<double> heading_rad;
  std::optional<math::Point> obstacle;
  std::optional<std::int64_t> ultrasonic_id, di;
  EpisodeClass cls = EpisodeClass::off_task;
  std::optional<std::int64_t> task_type;
  std::string_view map, station;
};

struct Episode {
  std::optional<Micros> onset_lo_us;  ///< empty: already on in the first poll
  Micros onset_hi_us = 0;
  Micros end_lo_us = 0;
  std::optional<Micros> end_hi_us;  ///< empty: on at the end of the record
  std::optional<std::int64_t> reason;
  EpisodeClass cls = EpisodeClass::off_task;
  std::optional<math::Point> at, last_at, obstacle;
  std::optional<double> heading_rad;
  std::optional<std::int64_t> ultrasonic_id, di, task_type;
  std::string map, station;
  std::int64_t joined = 0;  ///< further runs joined to the first
  bool onset_in_gap = false;
  bool end_in_gap = false;
  Micros unseen_us = 0;   ///< of gaps inside it: counted in the longest possible duration alone
  bool over_gap = false;  ///< assumed to be one across a gap: same place, same reason

  [[nodiscard]] Micros onset_mid_us() const;
  [[nodiscard]] Micros end_mid_us() const;
  [[nodiscard]] double duration_lo_s() const;
  [[nodiscard]] std::optional<double> duration_hi_s() const;
  /// The same inside the record: where it has no bound, from its first or to its last sighting.
  [[nodiscard]] double duration_most_s() const;
  [[nodiscard]] double duration_mid_s() const;
  /// Straight distance between the places where it was first and last seen; 0 when they are not known.
  [[nodiscard]] double moved_m() const;
};

struct EpisodeRules {
  Micros join_us = 2'000'000;  ///< interruptions up to this long, same reason, are no end
  double same_place_m = 0.1;   ///< for episodes on both sides of a gap
};

/// One robot. Feed every poll that knows the flag, in order.
class EpisodeMachine {
 public:
  explicit EpisodeMachine(const EpisodeRules& rules) : rules_(rules) {}
  /// `gap`: the pause since the poll before is a gap. `sighting` is null while the flag is off.
  void step(Micros t_send_us, Micros t_recv_us, bool gap, const Sighting* sighting);
  void finish();
  [[nodiscard]] const std::vector<Episode>& episodes() const { return episodes_; }

 private:
  EpisodeRules rules_;
  std::vector<Episode> episodes_;
  std::optional<Episode> open_;
  std::optional<Micros> before_us_;
  void see(Episode& episode, Micros t_send_us, const Sighting& sighting) const;
  void append(Episode episode);
  [[nodiscard]] bool joins(const Episode& first, const Episode& second) const;
};

/// In which frame block_x, block_y are: decided from the log (needs 20 episodes at 3 places).
enum class ObstacleFrame : std::uint8_t { unknown, world, robot };
struct FrameTest {
  ObstacleFrame frame = ObstacleFrame::unknown;
  std::size_t episodes = 0;
  std::size_t places = 0;
  double world_median_m = 0, world_spread_m = 0;  ///< of ||b - p||
  double robot_median_m = 0, robot_spread_m = 0;  ///< of ||b||
};
FrameTest obstacle_frame(const std::vector<Episode>& episodes);
/// The obstacle in the map; empty when the frame is unknown or something is missing.
std::optional<math::Point> obstacle_in_map(const Episode& episode, ObstacleFrame frame);

/// Episodes within 10 min and 1 m of the one before are one incident: one obstacle left standing.
std::size_t count_incidents(const std::vector<Episode>& episodes);

}  // namespace tacho
