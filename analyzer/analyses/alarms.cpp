// Which alarms cost us: reads the alarm arrays of status answers, or the alarm registers of robots that are only read
// by Modbus. Definitions: analyses/README.md.

#include <cmath>

#include "analyzer/analyses/alarm_registers.hpp"
#include "analyzer/analyses/alarm_results.hpp"
#include "analyzer/analyses/analyses.hpp"
#include "analyzer/analyses/poll_clock.hpp"
#include "analyzer/analyses/signals.hpp"
#include "schema/time.hpp"

namespace tacho {
namespace {

constexpr std::string_view kQuestion = "Which alarms come how often, and what do they cost?";
constexpr std::int64_t kTaskRunning = 2;
constexpr Micros kClockPointSlack = 1'500'000;  // the registers show whole seconds, from a cache that may lag

constexpr std::array<FieldIndex, kAlarmLevels> kArrays{field("fatals"), field("errors"), field("warnings"),
                                                       field("notices")};

enum Signal : std::size_t {
  s_x,
  s_y,
  s_vx,
  s_vy,
  s_w,
  s_is_stop,
  s_odo,
  s_task_status,
  s_task_type,
  s_battery,
  s_station,
  s_station_id,
  s_map,
  s_map_number,
  s_confidence,
  s_rssi,
  s_create_on,
};

std::vector<Need> context_needs() {
  const std::vector<Source> both{Source::status, Source::registers};
  const std::vector<Source> status{Source::status};
  const std::vector<Source> registers{Source::registers};
  return {
      {field("x"), both},
      {field("y"), both},
      {field("vx"), both},
      {field("vy"), both},
      {field("w"), both},
      {field("is_stop"), {Source::status, Source::inputs}},
      {field("odo"), both},
      {field("task_status"), both},
      {field("task_type"), both},
      {field("battery_level"), both},
      {field("current_station"), status},
      {field("current_station_id"), registers},
      {field("current_map"), status},
      {field("map_number"), registers},
      {field("confidence"), both},
      {field("rssi"), status},
      {field("create_on"), status},
  };
}

std::vector<Need> needs() {
  std::vector<Need> all = context_needs();
  for (const FieldIndex f : kArrays) {
    all.push_back({f, {Source::status}});
  }
  for (const FieldIndex f : kFirstAlarmCodes) {
    all.push_back({f, {Source::registers}});
  }
  for (const FieldIndex f : kErrorSlots) {
    all.push_back({f, {Source::registers}});
  }
  return all;
}

/// The source whose rows are the polls; the arrays of the status answer show everything, the registers only first
/// codes.
std::optional<Source> alarm_source(const RobotContext& context) {
  for (const FieldIndex f : kArrays) {
    if (context.choose({f, {Source::status}})) {
      return Source::status;
    }
  }
  for (const FieldIndex f : kFirstAlarmCodes) {
    if (context.choose({f, {Source::registers}})) {
      return Source::registers;
    }
  }
  return std::nullopt;
}

std::string reason_without_source(const RobotContext& context) {
  if (context.robot.id == 0) {
    return "the log holds no robot";
  }
  if (context.find(Source::status) != nullptr) {
    return "no status answer has an array fatals, errors, warnings or notices, and no registers were recorded";
  }
  return "neither status answers nor registers 31 to 33 were recorded";
}

class Alarms final : public Analysis {
 public:
  explicit Alarms(const RobotContext& context)
      : settings_(*context.settings),
        zone_(context.zone),
        source_(alarm_source(context)),
        clock_({planned_period_us(source_ ? context.find(*source_) : nullptr), source_.value_or(Source::status)},
               settings_.number("alarms.gap_periods", context.robot.name)),
        signals_(context, source_.value_or(Source::status), context_needs()),
        still_mps_(settings_.number("alarms.still_mps", context.robot.name)),
        still_radps_(settings_.number("alarms.still_radps", context.robot.name)),
        stopping_level_(settings_.number("alarms.stopping_level", context.robot.name)) {
    robots_.push_back({context.robot.name,
                       source_ ? std::string(source_name(*source_)) : "",
                       source_ ? "" : reason_without_source(context),
                       {},
                       AlarmExposure(context.zone, settings_.number("alarms.v_max_mps", context.robot.name)),
                       {},
                       clock_.period_us(),
                       false});
  }

  void fold(const Slice& slice) override;
  void merge(Analysis& other) override;
  Section finish() override;

 private:
  const Settings& settings_;
  std::string zone_;
  std::optional<Source> source_;
  PollClock clock_;
  Signals signals_;
  double still_mps_;
  double still_radps_;
  double stopping_level_;
  std::vector<RobotAlarms> robots_;  // the first is folded, the others merged
  AlarmPoll poll_;
  std::optional<ClockPoint> robot_clock_;
  std::vector<std::size_t> active_before_;
  std::optional<bool> stopped_before_;
  Micros t_before_us_ = 0;
  bool done_ = false;

  [[nodiscard]] RobotAlarms& own() { return robots_.front(); }
  void row(const Slice& slice, std::size_t row);
  void read_arrays(const Batch& batch, std::size_t row);
  [[nodiscard]] PollState state() const;
  [[nodiscard]] AlarmContext context_now() const;
  void describe_raised(const std::vector<std::size_t>& raised);
  [[nodiscard]] std::optional<ClockOffset> offset() const;
  void attribute(const PollState& now, bool near);
  void finish_own();
};

void Alarms::fold(const Slice& slice) {
  if (!source_) {
    return;
  }
  signals_.open(slice);
  clock_.open(slice);
  auto point = slice.clock.begin();
  for (std::size_t r = 0; r < signals_.rows(); ++r) {
    for (; point != slice.clock.end() && point->wall_us <= signals_.batch().t_recv_us[r]; ++point) {
      robot_clock_ = point->robot_us ? std::optional(*point) : robot_clock_;
    }
    signals_.seek(r);
    row(slice, r);
  }
  for (; point != slice.clock.end(); ++point) {
    robot_clock_ = point->robot_us ? std::optional(*point) : robot_clock_;
  }
  signals_.close();
}

void Alarms::row(const Slice& slice, std::size_t row) {
  const Batch& batch = signals_.batch();
  for (AlarmPoll::Level& level : poll_.levels) {
    level = {};
  }
  poll_.t_send_us = batch.t_send_us[row];
  poll_.t_recv_us = batch.t_recv_us[row];
  source_ == Source::status ? read_arrays(batch, row) : read_alarm_registers(batch, row, poll_);

  const bool near = clock_.step(slice.session, batch.seq[row], batch.t_mid_us(row)) == PollClock::Step::near;
  const std::vector<std::size_t>& raised = own().tracker.poll(poll_, clock_.gap_limit_us());
  describe_raised(raised);
  const PollState now = state();
  attribute(now, near);
  own().exposure.step(now, near);
}

void Alarms::read_arrays(const Batch& batch, std::size_t row) {
  for (std::size_t l = 0; l < kAlarmLevels; ++l) {
    const Column* column = batch.find(kArrays[l]);
    poll_.levels[l].known = column != nullptr && column->has(row);
    poll_.levels[l].full = batch.incomplete(row, static_cast<AlarmLevel>(l));
  }
  for (const AlarmItem& item : batch.alarms_of(row)) {
    AlarmPoll::Level& level = poll_.levels[static_cast<std::size_t>(item.level)];
    if (!level.known) {
      continue;
    }
    level.items.push_back({item.code, item.stamp_s, item.times});
    AlarmWords& words = own().words[{item.level, item.code}];
    const auto keep = [&](std::string& kept, std::uint32_t id) {
      if (id != 0 && kept != batch.texts.at(id)) {
        kept = batch.texts.at(id);
      }
    };
    keep(words.desc, item.desc);
    keep(words.solution, item.solution);
  }
}

PollState Alarms::state() const {
  PollState now;
  now.t_send_us = poll_.t_send_us;
  now.t_recv_us = poll_.t_recv_us;
  for (std::size_t l = 0; l < kAlarmLevels; ++l) {
    now.known[l] = poll_.levels[l].known;
  }
  if (const std::optional<std::int64_t> task = signals_.integer(s_task_status)) {
    now.task_running = *task == kTaskRunning;
  }
  if (const std::optional<bool> still = signals_.flag(s_is_stop)) {
    now.moving = !*still;
  } else if (signals_.real(s_vx) && signals_.real(s_w)) {
    const double v = std::hypot(*signals_.real(s_vx), signals_.real(s_vy).value_or(0.0));
    now.moving = v >= still_mps_ || std::abs(*signals_.real(s_w)) >= still_radps_;
  }
  now.odo_m = signals_.real(s_odo);
  for (const std::size_t i : robots_.front().tracker.active()) {
    if (static_cast<double>(robots_.front().intervals()[i].key.level) <= stopping_level_) {
      now.stopping = i;
      break;
    }
  }
  return now;
}

AlarmContext Alarms::context_now() const {
  AlarmContext at;
  at.x_m = signals_.real(s_x);
  at.y_m = signals_.real(s_y);
  if (signals_.real(s_vx)) {
    at.speed_mps = std::hypot(*signals_.real(s_vx), signals_.real(s_vy).value_or(0.0));
  }
  at.battery_level = signals_.real(s_battery);
  at.confidence = signals_.real(s_confidence);
  at.rssi = signals_.real(s_rssi);
  at.task_status = signals_.integer(s_task_status);
  at.task_type = signals_.integer(s_task_type);
  at.station = signals_.text(s_station);
  if (const std::optional<std::int64_t> id = signals_.integer(s_station_id); at.station.empty() && id && *id > 0) {
    at.station = std::to_string(*id);
  }
  at.map = signals_.text(s_map);
  if (const std::optional<std::int64_t> number = signals_.integer(s_map_number); at.map.empty() && number) {
    at.map = std::to_string(*number);
  }
  return at;
}

void Alarms::describe_raised(const std::vector<std::size_t>& raised) {
  if (raised.empty()) {
    return;
  }
  const AlarmContext context = context_now();
  const std::optional<ClockOffset> clock = offset();
  own().clock_known = own().clock_known || clock.has_value();
  for (const std::size_t i : raised) {
    own().tracker.interval(i).context = context;
    if (clock) {
      own().tracker.tighten(i, *clock);
    }
  }
}

std::optional<ClockOffset> Alarms::offset() const {
  const std::string_view text = signals_.text(s_create_on);
  if (const std::optional<Micros> robot = text.empty() ? std::nullopt : parse_time(text, "UTC")) {
    // The answer was made between send and receive; its stamp is cut to its last digit.
    const Micros cut = text.find('.') != std::string_view::npos ? 1'000 : 1'000'000;
    return ClockOffset{poll_.t_send_us - *robot - cut, poll_.t_recv_us - *robot};
  }
  if (robot_clock_) {
    const Micros offset = robot_clock_->wall_us - *robot_clock_->robot_us;
    return ClockOffset{offset - kClockPointSlack, offset + kClockPointSlack};
  }
  return std::nullopt;
}

/// Each end of a pause between polls stands for half of it.
void Alarms::attribute(const PollState& now, bool near) {
  const auto share = [&](const std::vector<std::size_t>& active, double half_s) {
    for (const std::size_t i : active) {
      own().tracker.interval(i).stopped_s += half_s / static_cast<double>(active.size());
    }
    if (!active.empty()) {
      own().tracker.interval(active.front()).stopped_first_s += half_s;
    }
  };
  if (near) {
    const double half_s = static_cast<double>(now.t_mid_us() - t_before_us_) * 0.5e-6;
    if (stopped_before_.value_or(false)) {
      share(active_before_, half_s);
    }
    if (now.stopped().value_or(false)) {
      share(own().tracker.active(), half_s);
    }
  }
  active_before_ = own().tracker.active();
  stopped_before_ = now.stopped();
  t_before_us_ = now.t_mid_us();
}

void Alarms::finish_own() {
  if (!done_) {
    done_ = true;
    own().exposure.finish();
    own().period_us = clock_.period_us();
  }
}

void Alarms::merge(Analysis& other) {
  auto& that = dynamic_cast<Alarms&>(other);
  that.finish_own();
  for (RobotAlarms& robot : that.robots_) {
    robots_.push_back(std::move(robot));
  }
}

Section Alarms::finish() {
  finish_own();
  const AlarmData data = alarm_data(robots_, settings_, zone_);
  Section section;
  section.name = "alarms";
  section.title = "Alarm frequency";
  section.question = kQuestion;
  section.notes = alarm_notes(data);
  section.findings = alarm_findings(data);
  add_alarm_rate_tables(data, section);
  add_alarm_code_tables(data, section);
  add_alarm_detail_tables(data, section);
  return section;
}

std::unique_ptr<Analysis> make(const RobotContext& context) { return std::make_unique<Alarms>(context); }

std::span<const SettingRow> settings() {
  static constexpr auto kRows = std::to_array<SettingRow>({
      {"alarms.gap_periods", 3.0, "1", "A longer pause between polls, in periods, is a gap", kFrom1},
      {"alarms.v_max_mps", 5.0, "m/s", "A faster growth of the odometer is a counter that was set", kAbove0},
      {"alarms.still_mps", 0.01, "m/s", "Slower counts as not moving, where the robot has no flag for it"},
      {"alarms.still_radps", 0.01, "rad/s", "Slower turning counts as not moving"},
      {"alarms.stopping_level", 1.0, "", "Alarms up to this level can stop a robot: 0 fatal, 1 error, 2 warning"},
      {"alarms.rate_pass_per_h", 6.0, "1/h", "ALM-01 passes up to this rate"},
      {"alarms.rate_fail_per_h", 12.0, "1/h", "ALM-01 fails above this rate"},
      {"alarms.flood_window_s", 600.0, "s", "Window in which alarms are counted for floods", kAbove0},
      {"alarms.flood_above", 10.0, "", "A flood starts when more alarms than this fall into the window", kFrom1},
      {"alarms.flood_below", 5.0, "", "A flood ends when fewer alarms than this are left in the window"},
      {"alarms.flood_share_pass", 0.01, "1", "ALM-02 passes up to this share of time in floods", kShare},
      {"alarms.flood_share_fail", 0.05, "1", "ALM-02 fails above this share of time in floods", kShare},
      {"alarms.flood_typical_s", 600.0, "s", "Length of a flood assumed for the upper limit when none was seen"},
      {"alarms.chatter_window_s", 60.0, "s", "Window in which raises of one code are counted for chattering", kAbove0},
      {"alarms.chatter_raises", 3.0, "", "So many raises of one code in the window are chattering", kFrom1},
      {"alarms.chatter_codes_fail", 3.0, "", "ALM-03 fails with so many chattering codes", kFrom1},
      {"alarms.fleeting_s", 10.0, "s", "A shorter alarm is fleeting", kAbove0},
      {"alarms.stale_h", 24.0, "h", "An alarm active for longer is stale", kAbove0},
      {"alarms.stale_pass", 5.0, "", "ALM-04 passes with fewer stale alarms than this on any day"},
      {"alarms.min_hours", 1.0, "h", "The alarm rate and checks for chattering need at least so many observed hours"},
  });
  return kRows;
}

}  // namespace

constinit const AnalysisSpec kAlarms{"alarms", kQuestion, needs, make, settings};

}  // namespace tacho
