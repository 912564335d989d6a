#include "analyzer/analyses/blockage_episodes.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <utility>

#include "analyzer/math/robust.hpp"
#include "schema/time.hpp"

namespace tacho {
namespace {

constexpr std::size_t kFrameEpisodes = 20;
constexpr std::size_t kFramePlaces = 3;
constexpr double kFrameNear_m = 10.0;
constexpr double kFrameRatio = 5.0;
constexpr Micros kIncidentPause = 600'000'000;
constexpr double kIncidentReach_m = 1.0;

template <class T>
void keep_first(std::optional<T>& kept, const std::optional<T>& seen) {
  if (!kept) {
    kept = seen;
  }
}

double quartile_range(const std::vector<double>& values) { return quantile(values, 0.75) - quantile(values, 0.25); }

}  // namespace

const char* episode_class_name(EpisodeClass cls) {
  constexpr std::array<const char*, kEpisodeClasses> kNames{"on_task", "off_task", "manual", "charging", "emergency"};
  return kNames[static_cast<std::size_t>(cls)];
}

Micros Episode::onset_mid_us() const { return onset_lo_us ? middle(*onset_lo_us, onset_hi_us) : onset_hi_us; }
Micros Episode::end_mid_us() const { return end_hi_us ? middle(end_lo_us, *end_hi_us) : end_lo_us; }
double Episode::duration_lo_s() const { return std::max(0.0, to_seconds(end_lo_us - onset_hi_us - unseen_us)); }
/// Gaps are no observed time, so what may have lasted into one ends where it was seen last.
double Episode::duration_mid_s() const {
  const Micros from_us = onset_in_gap ? onset_hi_us : onset_mid_us();
  const Micros to_us = end_in_gap ? end_lo_us : end_mid_us();
  return std::max(0.0, to_seconds(to_us - from_us - unseen_us));
}

std::optional<double> Episode::duration_hi_s() const {
  if (!onset_lo_us || !end_hi_us) {
    return std::nullopt;
  }
  return to_seconds(*end_hi_us - *onset_lo_us);
}

double Episode::duration_most_s() const {
  return std::max(0.0, to_seconds(end_hi_us.value_or(end_lo_us) - onset_lo_us.value_or(onset_hi_us)));
}

double Episode::moved_m() const { return at && last_at ? math::distance(*at, *last_at) : 0.0; }

void EpisodeMachine::see(Episode& episode, Micros t_send_us, const Sighting& sighting) const {
  episode.end_lo_us = t_send_us;
  keep_first(episode.reason, sighting.reason);
  keep_first(episode.at, sighting.at);
  keep_first(episode.heading_rad, sighting.heading_rad);
  keep_first(episode.obstacle, sighting.obstacle);
  keep_first(episode.ultrasonic_id, sighting.ultrasonic_id);
  keep_first(episode.di, sighting.di);
  keep_first(episode.task_type, sighting.task_type);
  episode.last_at = sighting.at ? sighting.at : episode.last_at;
  if (episode.map.empty()) {
    episode.map = sighting.map;
  }
  if (episode.station.empty()) {
    episode.station = sighting.station;
  }
}

void EpisodeMachine::step(Micros t_send_us, Micros t_recv_us, bool gap, const Sighting* sighting) {
  if (open_ && (gap || sighting == nullptr)) {
    open_->end_hi_us = t_recv_us;
    open_->end_in_gap = gap;
    append(*std::exchange(open_, std::nullopt));
  }
  if (sighting != nullptr) {
    if (!open_) {
      open_.emplace();
      open_->onset_lo_us = before_us_;
      open_->onset_hi_us = t_recv_us;
      open_->onset_in_gap = gap;
      open_->cls = sighting->cls;
    }
    see(*open_, t_send_us, *sighting);
  }
  before_us_ = t_send_us;
}

bool EpisodeMachine::joins(const Episode& first, const Episode& second) const {
  if (first.reason != second.reason || first.map != second.map) {
    return false;
  }
  if (first.end_in_gap && second.onset_in_gap && first.end_hi_us && *first.end_hi_us >= second.onset_hi_us) {
    return first.last_at && second.at && math::distance(*first.last_at, *second.at) <= rules_.same_place_m;
  }
  return !first.end_in_gap && !second.onset_in_gap && second.onset_mid_us() - first.end_mid_us() <= rules_.join_us;
}

/// Puts an episode into the list, or joins it to the one before.
void EpisodeMachine::append(Episode next) {
  if (episodes_.empty() || !joins(episodes_.back(), next)) {
    episodes_.push_back(std::move(next));
    return;
  }
  Episode& whole = episodes_.back();
  ++whole.joined;
  whole.over_gap = whole.over_gap || next.onset_in_gap;
  whole.unseen_us += next.unseen_us + (next.onset_in_gap ? next.onset_hi_us - whole.end_lo_us : 0);
  whole.end_lo_us = next.end_lo_us;
  whole.end_hi_us = next.end_hi_us;
  whole.end_in_gap = next.end_in_gap;
  whole.last_at = next.last_at ? next.last_at : whole.last_at;
}

void EpisodeMachine::finish() {
  if (open_) {
    append(*std::exchange(open_, std::nullopt));
  }
}

FrameTest obstacle_frame(const std::vector<Episode>& episodes) {
  FrameTest test;
  std::vector<double> world;
  std::vector<double> robot;
  std::set<std::pair<long, long>> places;
  for (const Episode& e : episodes) {
    if (e.at && e.obstacle) {
      world.push_back(math::distance(*e.obstacle, *e.at));
      robot.push_back(std::hypot(e.obstacle->x, e.obstacle->y));
      places.emplace(std::lround(std::clamp(e.at->x, -1e6, 1e6)), std::lround(std::clamp(e.at->y, -1e6, 1e6)));
    }
  }
  test.episodes = world.size();
  test.places = places.size();
  if (world.empty()) {
    return test;
  }
  test.world_median_m = median(world);
  test.robot_median_m = median(robot);
  test.world_spread_m = quartile_range(world);
  test.robot_spread_m = quartile_range(robot);
  if (test.episodes < kFrameEpisodes || test.places < kFramePlaces) {
    return test;
  }
  if (test.world_median_m <= kFrameNear_m && test.world_spread_m * kFrameRatio <= test.robot_spread_m) {
    test.frame = ObstacleFrame::world;
  } else if (test.robot_median_m <= kFrameNear_m && test.robot_spread_m * kFrameRatio <= test.world_spread_m) {
    test.frame = ObstacleFrame::robot;
  }
  return test;
}

std::optional<math::Point> obstacle_in_map(const Episode& e, ObstacleFrame frame) {
  if (!e.obstacle || frame == ObstacleFrame::unknown) {
    return std::nullopt;
  }
  if (frame == ObstacleFrame::world) {
    return e.obstacle;
  }
  if (!e.at || !e.heading_rad) {
    return std::nullopt;
  }
  const double c = std::cos(*e.heading_rad);
  const double s = std::sin(*e.heading_rad);
  return math::Point{e.at->x + c * e.obstacle->x - s * e.obstacle->y, e.at->y + s * e.obstacle->x + c * e.obstacle->y};
}

std::size_t count_incidents(const std::vector<Episode>& episodes) {
  std::size_t incidents = 0;
  for (std::size_t i = 0; i < episodes.size(); ++i) {
    const Episode& e = episodes[i];
    const bool same = i > 0 && e.at && episodes[i - 1].at && e.map == episodes[i - 1].map &&
                      math::distance(*e.at, *episodes[i - 1].at) <= kIncidentReach_m &&
                      e.onset_mid_us() - episodes[i - 1].end_mid_us() <= kIncidentPause;
    incidents += same ? 0 : 1;
  }
  return incidents;
}

}  // namespace tacho
