// Where robots get blocked, and what it costs: reads `blocked` and poses of status answers, or inputs and registers of
// robots that are only read by Modbus. Definitions: analyses/README.md.

#include <array>
#include <cmath>

#include "analyzer/analyses/analyses.hpp"
#include "analyzer/analyses/blockage_results.hpp"
#include "analyzer/analyses/poll_clock.hpp"
#include "analyzer/analyses/signals.hpp"

namespace tacho {
namespace {

constexpr std::string_view kQuestion = "Where do robots get blocked, and how much time does it cost?";
constexpr std::int64_t kTaskRunning = 2;
constexpr std::int64_t kJoystickActive = 2;

/// Signals of the rows that tell `blocked`.
enum Flag : std::size_t {
  f_blocked,
  f_reason,
  f_block_x,
  f_block_y,
  f_ultrasonic,
  f_di,
  f_slowed,
  f_slow_reason,
  f_task_status,
  f_task_type,
  f_charging,
  f_emergency,
  f_joystick,
  f_x,
  f_y,
  f_angle,
  f_station,
  f_station_id,
  f_map,
  f_md5,
  f_map_number,
};

std::vector<Need> flag_needs() {
  const std::vector<Source> flag{Source::status, Source::inputs};
  const std::vector<Source> value{Source::status, Source::registers};
  const std::vector<Source> status{Source::status};
  const std::vector<Source> registers{Source::registers};
  return {
      {field("blocked"), flag},
      {field("block_reason"), value},
      {field("block_x"), value},
      {field("block_y"), value},
      {field("block_ultrasonic_id"), value},
      {field("block_di"), value},
      {field("slowed"), flag},
      {field("slow_reason"), value},
      {field("task_status"), value},
      {field("task_type"), value},
      {field("charging"), flag},
      {field("emergency"), flag},
      {field("joystick_state"), status},
      {field("x"), value},
      {field("y"), value},
      {field("angle"), value},
      {field("current_station"), status},
      {field("current_station_id"), registers},
      {field("current_map"), status},
      {field("current_map_md5"), status},
      {field("map_number"), registers},
  };
}

/// Signals of the rows that tell the pose.
enum PoseSignal : std::size_t { p_x, p_y, p_vx, p_vy, p_map, p_md5, p_map_number, p_blocked, p_slowed };

std::vector<Need> pose_needs() {
  const std::vector<Source> flag{Source::status, Source::inputs};
  const std::vector<Source> value{Source::status, Source::registers};
  return {
      {field("x"), value},
      {field("y"), value},
      {field("vx"), value},
      {field("vy"), value},
      {field("current_map"), {Source::status}},
      {field("current_map_md5"), {Source::status}},
      {field("map_number"), {Source::registers}},
      {field("blocked"), flag},
      {field("slowed"), flag},
  };
}

std::vector<Need> needs() {
  std::vector<Need> all = flag_needs();
  for (const Need& need : pose_needs()) {
    all.push_back(need);
  }
  return all;
}

/// Name of the map a row was made on, put together only when one of its parts changes.
class MapName {
 public:
  std::string_view of(std::string_view map, std::string_view md5, std::optional<std::int64_t> number) {
    if (map != map_ || md5 != md5_ || number != number_ || name_.empty()) {
      map_ = map;
      md5_ = md5;
      number_ = number;
      name_ = !map.empty()            ? map_ + (md5_.empty() ? "" : " " + md5_)
              : number && *number > 0 ? "map " + std::to_string(*number)
                                      : std::string("map without name");
    }
    return name_;
  }

 private:
  std::string map_, md5_, name_;
  std::optional<std::int64_t> number_;
};

std::string reason_without_source(const RobotContext& context) {
  if (context.robot.id == 0) {
    return "the log holds no robot";
  }
  if (context.find(Source::status) != nullptr) {
    return "no status answer has the key blocked, and no discrete inputs were recorded";
  }
  return "neither status answers nor discrete input 2 were recorded";
}

std::string name_of(std::optional<Source> source) { return source ? std::string(source_name(*source)) : ""; }

TrackRules track_rules(const Settings& settings, const std::string& robot) {
  return {settings.number("blockage.v_max_mps", robot), settings.number("blockage.accel_mps2", robot),
          settings.number("blockage.jump_m", robot), settings.number("blockage.stride_min_m", robot)};
}

EpisodeRules episode_rules(const Settings& settings, const std::string& robot) {
  EpisodeRules rules;
  rules.join_us = static_cast<Micros>(std::llround(settings.number("blockage.join_s", robot) * 1e6));
  return rules;
}

class Blockage final : public Analysis {
 public:
  explicit Blockage(const RobotContext& context);
  void fold(const Slice& slice) override;
  void merge(Analysis& other) override;
  Section finish() override;

 private:
  const Settings& settings_;
  std::optional<Source> flag_source_;
  std::optional<Source> pose_source_;
  PollClock flag_clock_;
  PollClock pose_clock_;
  Signals flags_;
  Signals poses_;
  EpisodeMachine blocked_;
  EpisodeMachine slowed_;
  MapName flag_map_;
  MapName pose_map_;
  std::string station_text_;
  std::vector<RobotBlockage> robots_;  // the first is folded, the others merged

  /// The last row that knew the flags.
  struct Before {
    Micros t_us = 0;
    bool blocked = false, slowed = false, on_task = false;
  };
  std::optional<Before> before_;
  bool done_ = false;

  [[nodiscard]] RobotBlockage& own() { return robots_.front(); }
  void flag_row(SessionId session, std::size_t row);
  void pose_row(SessionId session, std::size_t row);
  [[nodiscard]] EpisodeClass class_now() const;
  [[nodiscard]] Sighting sighting(EpisodeClass cls);
  void expose(const Before& now, bool gap);
  void finish_own();
};

Blockage::Blockage(const RobotContext& context)
    : settings_(*context.settings),
      flag_source_(context.choose({field("blocked"), {Source::status, Source::inputs}})),
      pose_source_(context.choose({field("x"), {Source::status, Source::registers}})),
      flag_clock_({planned_period_us(flag_source_ ? context.find(*flag_source_) : nullptr),
                   flag_source_.value_or(Source::status)},
                  settings_.number("blockage.gap_periods", context.robot.name)),
      pose_clock_({planned_period_us(pose_source_ ? context.find(*pose_source_) : nullptr),
                   pose_source_.value_or(Source::status)},
                  settings_.number("blockage.gap_periods", context.robot.name)),
      flags_(context, flag_source_.value_or(Source::status), flag_needs()),
      poses_(context, pose_source_.value_or(Source::status), pose_needs()),
      blocked_(episode_rules(settings_, context.robot.name)),
      slowed_(episode_rules(settings_, context.robot.name)) {
  RobotBlockage robot{context.robot.name,
                      name_of(flag_source_),
                      "",
                      name_of(pose_source_),
                      {},
                      {},
                      PoseTrack(track_rules(settings_, context.robot.name))};
  robot.why_not = flag_source_ ? "" : reason_without_source(context);
  robots_.push_back(std::move(robot));
}

void Blockage::fold(const Slice& slice) {
  if (!flag_source_) {
    return;
  }
  flags_.open(slice);
  flag_clock_.open(slice);
  for (std::size_t r = 0; r < flags_.rows(); ++r) {
    flags_.seek(r);
    flag_row(slice.session, r);
  }
  flags_.close();
  if (!pose_source_) {
    return;
  }
  poses_.open(slice);
  pose_clock_.open(slice);
  for (std::size_t r = 0; r < poses_.rows(); ++r) {
    poses_.seek(r);
    pose_row(slice.session, r);
  }
  poses_.close();
}

EpisodeClass Blockage::class_now() const {
  if (flags_.flag(f_emergency).value_or(false)) {
    return EpisodeClass::emergency;
  }
  if (flags_.flag(f_charging).value_or(false)) {
    return EpisodeClass::charging;
  }
  if (flags_.integer(f_joystick) == kJoystickActive) {
    return EpisodeClass::manual;
  }
  return flags_.integer(f_task_status) == kTaskRunning ? EpisodeClass::on_task : EpisodeClass::off_task;
}

Sighting Blockage::sighting(EpisodeClass cls) {
  const auto point = [&](std::size_t x, std::size_t y) -> std::optional<math::Point> {
    const std::optional<double> px = flags_.real(x);
    const std::optional<double> py = flags_.real(y);
    const bool usable = px && py && std::abs(*px) < 1e6 && std::abs(*py) < 1e6;
    return usable ? std::optional(math::Point{*px, *py}) : std::nullopt;
  };
  Sighting s;
  s.at = point(f_x, f_y);
  s.heading_rad = flags_.real(f_angle);
  s.cls = cls;
  s.task_type = flags_.integer(f_task_type);
  s.map = flag_map_.of(flags_.text(f_map), flags_.text(f_md5), flags_.integer(f_map_number));
  s.station = flags_.text(f_station);
  if (const std::optional<std::int64_t> id = flags_.integer(f_station_id); s.station.empty() && id && *id > 0) {
    station_text_ = std::to_string(*id);
    s.station = station_text_;
  }
  s.reason = flags_.integer(f_reason);
  s.obstacle = point(f_block_x, f_block_y);
  s.ultrasonic_id = flags_.integer(f_ultrasonic);
  s.di = flags_.integer(f_di);
  return s;
}

void Blockage::flag_row(SessionId session, std::size_t row) {
  const Batch& batch = flags_.batch();
  const std::optional<bool> blocked = flags_.flag(f_blocked);
  const std::optional<bool> slowed = flags_.flag(f_slowed);
  if (!blocked) {
    return;
  }
  const bool gap = flag_clock_.step(session, batch.seq[row], batch.t_mid_us(row)) == PollClock::Step::gap;
  ++own().polls;
  const EpisodeClass cls = class_now();
  own().task_known = own().task_known || flags_.integer(f_task_status).has_value();
  own().slowed_known = own().slowed_known || slowed.has_value();
  Sighting seen;
  if (*blocked || slowed.value_or(false)) {
    seen = sighting(cls);
  }
  blocked_.step(batch.t_send_us[row], batch.t_recv_us[row], gap, *blocked ? &seen : nullptr);
  if (slowed) {
    seen.reason = flags_.integer(f_slow_reason);
    seen.obstacle.reset();
    slowed_.step(batch.t_send_us[row], batch.t_recv_us[row], gap, *slowed ? &seen : nullptr);
  }
  expose({batch.t_mid_us(row), *blocked, slowed.value_or(false), cls == EpisodeClass::on_task}, gap);
}

void Blockage::expose(const Before& now, bool gap) {
  if (before_ && !gap) {
    const double half_s = static_cast<double>(now.t_us - before_->t_us) * 0.5e-6;
    for (const Before* end : {static_cast<const Before*>(&*before_), &now}) {
      own().observed_s += half_s;
      own().task_s += end->on_task ? half_s : 0.0;
      own().blocked_s += end->blocked ? half_s : 0.0;
      own().slowed_s += end->slowed ? half_s : 0.0;
    }
  }
  before_ = now;
}

void Blockage::pose_row(SessionId session, std::size_t row) {
  const Batch& batch = poses_.batch();
  PoseRow pose;
  pose.t_us = batch.t_mid_us(row);
  pose.near = pose_clock_.step(session, batch.seq[row], pose.t_us) == PollClock::Step::near;
  const std::optional<double> x = poses_.real(p_x);
  const std::optional<double> y = poses_.real(p_y);
  if (x && y) {
    pose.at = math::Point{*x, *y};
  }
  if (const std::optional<double> vx = poses_.real(p_vx)) {
    pose.speed_mps = std::hypot(*vx, poses_.real(p_vy).value_or(0.0));
  }
  pose.map = pose_map_.of(poses_.text(p_map), poses_.text(p_md5), poses_.integer(p_map_number));
  pose.blocked = poses_.flag(p_blocked).value_or(false);
  pose.slowed = poses_.flag(p_slowed).value_or(false);
  own().track.step(pose);
}

void Blockage::finish_own() {
  if (done_) {
    return;
  }
  done_ = true;
  blocked_.finish();
  slowed_.finish();
  own().blocked = blocked_.episodes();
  own().slowed = slowed_.episodes();
  own().period_us = flag_clock_.period_us();
  own().pose_period_us = pose_clock_.period_us();
}

void Blockage::merge(Analysis& other) {
  auto& that = dynamic_cast<Blockage&>(other);
  that.finish_own();
  for (RobotBlockage& robot : that.robots_) {
    robots_.push_back(std::move(robot));
  }
}

Section Blockage::finish() {
  finish_own();
  const BlockageData data = blockage_data(robots_, settings_);
  Section section;
  section.name = "blockage";
  section.title = "Blockage";
  section.question = kQuestion;
  section.notes = blockage_notes(data);
  section.findings = blockage_findings(data);
  add_blockage_tables(data, section);
  add_blockage_cell_tables(data, section);
  add_blockage_grids(data, section);
  return section;
}

std::unique_ptr<Analysis> make(const RobotContext& context) { return std::make_unique<Blockage>(context); }

std::span<const SettingRow> settings() {
  static constexpr auto kRows = std::to_array<SettingRow>({
      {"blockage.gap_periods", 3.0, "1", "A longer pause between polls, in periods, is a gap", kFrom1},
      {"blockage.join_s", 2.0, "s", "Interruptions up to this long, same reason, do not end an episode"},
      {"blockage.v_max_mps", 3.0, "m/s", "A pose that moved faster has jumped", kAbove0},
      {"blockage.accel_mps2", 1.0, "m/s2", "Acceleration allowed between two measured speeds before a pose has jumped",
       kAbove0},
      {"blockage.jump_m", 0.10, "m", "Allowance for localisation noise before a pose has jumped"},
      {"blockage.stride_min_m", 0.05, "m", "Nearer poses are a stand, not a stride", kAbove0},
      {"blockage.coarse_above_m", 200.0, "m", "Sites with a longer side get cells of 0.5 m instead of 0.25 m", kAbove0},
      {"blockage.min_passes", 3.0, "", "Cells with fewer passes show no rate", kFrom1},
      {"blockage.lost_share_pass", 0.02, "1", "BLK-01 passes up to this share of task time lost", kShare},
      {"blockage.lost_share_fail", 0.05, "1", "BLK-01 fails above this share of task time lost", kShare},
      {"blockage.typical_episode_s", 60.0, "s", "Length of an episode assumed for the upper limit when none was seen"},
  });
  return kRows;
}

}  // namespace

constinit const AnalysisSpec kBlockage{"blockage", kQuestion, needs, make, settings, true};

}  // namespace tacho
