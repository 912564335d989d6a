#include "schema/events.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <map>
#include <numbers>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "schema/signals.hpp"
#include "schema/time.hpp"

namespace tacho {

namespace {

constexpr double kUptimeToleranceS = 1.0;
constexpr double kLongestUptimeS = 1e10;        // 300 years: more is no uptime
constexpr std::size_t kUnknownKeyEvents = 200;  // a robot that makes up keys must not fill the log
constexpr Micros kPointSilenceUs = 3'000'000;
constexpr std::size_t kCarriedAlarms = 1000;  // nor may one that makes up alarms fill the memory

constexpr std::array<FieldIndex, kAlarmLevels> kAlarmFields{field("fatals"), field("errors"), field("warnings"),
                                                            field("notices")};
constexpr FieldIndex kUptime = field("uptime");
constexpr std::array kStrideFields{field("x"),  field("y"), field("angle"),          field("vx"),
                                   field("vy"), field("w"), field("current_map_md5")};

// What a robot can do between two answers beside the speeds that both of them show.
constexpr double kMostAcceleration = 1.5;      // m/s2
constexpr double kMostTurnAcceleration = 3.0;  // rad/s2
constexpr double kJumpM = 0.25;
constexpr double kJumpRad = 0.25;
constexpr Micros kLongestStrideUs = 5'000'000;  // over a longer time everything is possible

struct PointKey {
  bool output = false;
  std::int32_t id = 0;
  friend auto operator<=>(const PointKey&, const PointKey&) = default;
};

struct PointField {
  FieldIndex field;
  PointKey key;
};

/// di_0 ... do_15: the discrete inputs that mirror digital points.
const std::vector<PointField>& point_fields() {
  static const std::vector<PointField> table = [] {
    std::vector<PointField> rows;
    for (const bool output : {false, true}) {
      for (std::int32_t id = 0;; ++id) {
        const FieldIndex f = find_field((output ? "do_" : "di_") + std::to_string(id));
        if (f == kNoField) {
          break;
        }
        rows.push_back({f, {output, id}});
      }
    }
    return rows;
  }();
  return table;
}

/// Which source is believed about digital points: smaller is better, registers tell none.
int point_rank(Source source) { return source == Source::io ? 0 : source == Source::inputs ? 1 : 2; }

std::array<FieldSet, kSourceCount> make_field_sets() {
  FieldSet watched;
  for (const Signal& signal : signals()) {
    for (const FieldIndex f : signal.fields) {
      watched.set(f);
    }
  }
  for (const PointField& row : point_fields()) {
    watched.set(row.field);
  }
  std::array<FieldSet, kSourceCount> sets;
  const auto set = [&](Source source, FieldIndex f) { sets[static_cast<std::size_t>(source)].set(f); };
  const auto set_all = [&](FieldIndex f) {
    set(Source::status, f);
    set(Source::pose, f);
    set(Source::push, f);
  };
  for (FieldIndex f = 0; f < kFieldCount; ++f) {
    const Field& row = field_at(f);
    if (watched.test(f)) {
      if (!row.json.key.empty()) {
        set_all(f);
      }
      if (row.reg.present()) {
        set(row.reg.discrete ? Source::inputs : Source::registers, f);
      }
    }
    if (row.kind == Kind::alarms || row.kind == Kind::points || f == kUptime) {
      set_all(f);
    }
    if (row.kind == Kind::points) {
      set(Source::io, f);
    }
  }
  for (const FieldIndex f : kStrideFields) {
    set_all(f);
    if (field_at(f).reg.present()) {
      set(Source::registers, f);
    }
  }
  return sets;
}

/// A value and the request time of the last answer that showed it.
struct Known {
  std::string value;
  Micros t_us = 0;
};

struct Standing {
  std::int64_t times = 1;
  std::int64_t stamp_s = 0;
  Micros t_us = 0;  // request of the last answer that showed it
  std::string desc;
};

struct Level {
  std::optional<Micros> whole_t_us;         // request of the last answer that told all alarms of the level
  std::map<std::int64_t, Standing> alarms;  // by code
};

struct Point {
  std::optional<bool> status;
  Micros t_us = 0;
  std::array<std::optional<Micros>, 3> told_us;  // by rank
  std::uint64_t told_in = 0;                     // number of the answer that told it last
};

/// Where a robot was and how fast.
struct Stride {
  double x_m = 0;
  double y_m = 0;
  double angle_rad = 0;
  double speed_mps = 0;
  double turn_rate_radps = 0;
  std::string map;
  Micros sent_us = 0;
};

/// Empty when the answer does not tell all of it.
std::optional<Stride> stride_of(const Sample& sample) {
  constexpr FieldIndex kMap = kStrideFields.back();
  if (!std::all_of(kStrideFields.begin(), kStrideFields.end() - 1, [&](FieldIndex f) { return sample.at(f).has(); })) {
    return std::nullopt;
  }
  const auto real = [&](std::size_t i) { return sample.at(kStrideFields[i]).real; };
  return Stride{real(0),
                real(1),
                real(2),
                std::hypot(real(3), real(4)),
                std::abs(real(5)),
                sample.at(kMap).has() ? std::string(sample.text(kMap)) : std::string(),
                sample.meta.t_send_us};
}

/// What one source has said so far.
struct SourceState {
  std::optional<bool> decodable;
  std::set<std::string> unknown_keys;
  std::optional<double> uptime_s;
  Micros uptime_t_us = 0;
  std::optional<Stride> stride;
  std::vector<std::optional<Known>> values = std::vector<std::optional<Known>>(signals().size());
  std::array<Level, kAlarmFields.size()> levels;
};

std::map<std::int64_t, Standing> standing_alarms(const Sample& sample, AlarmLevel level) {
  std::map<std::int64_t, Standing> alarms;
  for (const AlarmItem& item : sample.alarms) {
    if (item.level == level) {
      const auto [found, is_new] = alarms.try_emplace(item.code);
      found->second.times = std::max(found->second.times, item.times);
      if (is_new) {
        found->second.stamp_s = item.stamp_s;
        found->second.t_us = sample.meta.t_send_us;
        found->second.desc = sample.texts.at(item.desc);
      }
    }
  }
  return alarms;
}

/// Cleared and raised again between two answers.
bool restarted(const Standing& before, const Standing& now) {
  const bool other_stamp = before.stamp_s != 0 && now.stamp_s != 0 && before.stamp_s != now.stamp_s;
  return now.times < before.times || (now.times == before.times && other_stamp);
}

}  // namespace

struct EventMachine::Impl {
  std::array<SourceState, kSourceCount> sources;
  std::map<PointKey, Point> points;  // of all sources
  std::uint64_t answers = 0;         // that told points

  /// One call of step().
  struct Step {
    const Sample& sample;
    const std::function<void(Event)>& emit;

    void event(EventKind kind, std::optional<Micros> from, std::string subject, std::string old_value,
               std::string new_value, std::string detail = {}) const {
      Event event;
      event.robot = sample.meta.robot;
      event.session = sample.meta.session;
      event.source = sample.meta.source;
      event.kind = kind;
      event.seq = sample.meta.seq;
      event.t_us = sample.meta.t_recv_us;
      event.t_from_us = std::min(from.value_or(event.t_us), event.t_us);  // the wall clock may step back
      event.subject = std::move(subject);
      event.old_value = std::move(old_value);
      event.new_value = std::move(new_value);
      event.detail = std::move(detail);
      emit(std::move(event));
    }
  };

  static void decodability(const Step& step, SourceState& state) {
    const bool good = step.sample.decodable;
    if (state.decodable.value_or(true) != good) {
      step.event(EventKind::undecodable, std::nullopt, "", state.decodable ? flag_text(!*state.decodable) : "",
                 flag_text(!good));
    }
    state.decodable = good;
  }

  static void unknown_keys(const Step& step, SourceState& state) {
    for (const std::string& key : step.sample.unknown_keys) {
      if (state.unknown_keys.size() < kUnknownKeyEvents && state.unknown_keys.insert(key).second) {
        step.event(EventKind::unknown_key, std::nullopt, key, "", "");
      }
    }
  }

  static void reboot(const Step& step, SourceState& state) {
    const Cell& uptime = step.sample.at(kUptime);
    if (!uptime.has() || uptime.real < 0.0 || uptime.real > kLongestUptimeS) {
      return;
    }
    if (state.uptime_s && uptime.real < *state.uptime_s - kUptimeToleranceS) {
      const Micros started = step.sample.meta.t_recv_us - static_cast<Micros>(uptime.real * 1e6);
      step.event(EventKind::reboot, state.uptime_t_us, "", fmt::format("{:.3f} s", *state.uptime_s),
                 fmt::format("{:.3f} s", uptime.real), "running since " + iso_utc(started));
    }
    state.uptime_s = uptime.real;
    state.uptime_t_us = step.sample.meta.t_send_us;
  }

  static void values(const Step& step, SourceState& state) {
    const std::vector<Signal>& table = signals();
    for (std::size_t i = 0; i < table.size(); ++i) {
      std::optional<std::string> now = table[i].read(step.sample, table[i].fields);
      if (!now) {
        continue;
      }
      std::optional<Known>& known = state.values[i];
      if (known && known->value != *now) {
        step.event(table[i].kind, known->t_us, std::string(table[i].subject), known->value, *now);
      }
      known = Known{std::move(*now), step.sample.meta.t_send_us};
    }
  }

  /// Farther than its speed, before and after, and any acceleration in between could have taken it.
  static void pose_jump(const Step& step, SourceState& state) {
    std::optional<Stride> now = stride_of(step.sample);
    if (!now) {
      return;
    }
    if (const std::optional<Stride>& before = state.stride; before && before->map == now->map) {
      const Micros took_us = step.sample.meta.t_recv_us - before->sent_us;
      const double took_s = static_cast<double>(took_us) * 1e-6;
      const double moved_m = std::hypot(now->x_m - before->x_m, now->y_m - before->y_m);
      const double turned_rad = std::abs(std::remainder(now->angle_rad - before->angle_rad, 2.0 * std::numbers::pi));
      const double reach_m =
          kJumpM + took_s * (std::max(now->speed_mps, before->speed_mps) + kMostAcceleration * took_s / 2.0);
      const double reach_rad = kJumpRad + took_s * (std::max(now->turn_rate_radps, before->turn_rate_radps) +
                                                    kMostTurnAcceleration * took_s / 2.0);
      if (took_us > 0 && took_us <= kLongestStrideUs && (moved_m > reach_m || turned_rad > reach_rad)) {
        const auto pose = [](const Stride& s) {
          return fmt::format("{:.3f} {:.3f} {:.4f}", s.x_m, s.y_m, s.angle_rad);
        };
        step.event(
            EventKind::pose_jump, before->sent_us, "", pose(*before), pose(*now),
            fmt::format("moved {:.2f} m and turned {:.2f} rad in {:.2f} s; {:.2f} m and {:.2f} rad were possible",
                        moved_m, turned_rad, took_s, reach_m, std::min(reach_rad, std::numbers::pi)));
      }
    }
    state.stride = std::move(now);
  }

  static void alarms(const Step& step, SourceState& state) {
    for (std::size_t i = 0; i < kAlarmFields.size(); ++i) {
      if (step.sample.at(kAlarmFields[i]).has()) {
        const auto level = static_cast<AlarmLevel>(i);
        alarm_edges(step, level, state.levels[i], standing_alarms(step.sample, level));
      }
    }
  }

  static void alarm_edges(const Step& step, AlarmLevel level, Level& before, std::map<std::int64_t, Standing> now) {
    const auto event = [&](EventKind kind, std::int64_t code, std::optional<Micros> from, const std::string& old_value,
                           const std::string& new_value, const std::string& desc) {
      step.event(kind, from, fmt::format("{} {}", alarm_level_name(level), code), old_value, new_value, desc);
    };
    const auto cleared = [&](std::int64_t code, const Standing& alarm) {
      event(EventKind::alarm_cleared, code, alarm.t_us, std::to_string(alarm.times), "0", alarm.desc);
    };
    const bool whole = !step.sample.alarms_incomplete[static_cast<std::size_t>(level)];
    for (const auto& [code, alarm] : before.alarms) {
      if (now.count(code) == 0 && whole) {
        cleared(code, alarm);
      }
    }
    for (const auto& [code, alarm] : now) {
      const std::string times = std::to_string(alarm.times);
      const auto found = before.alarms.find(code);
      if (found == before.alarms.end()) {
        event(EventKind::alarm_raised, code, before.whole_t_us, before.whole_t_us ? "0" : "", times, alarm.desc);
      } else if (restarted(found->second, alarm)) {
        cleared(code, found->second);
        event(EventKind::alarm_raised, code, found->second.t_us, "0", times, alarm.desc);
      } else if (alarm.times != found->second.times) {
        event(EventKind::alarm_repeated, code, found->second.t_us, std::to_string(found->second.times), times,
              alarm.desc);
      }
    }
    if (whole) {
      before.whole_t_us = step.sample.meta.t_send_us;
    } else if (now.size() + before.alarms.size() <= kCarriedAlarms) {
      now.merge(before.alarms);  // those that this answer does not show may stand among what could not be read
    }
    before.alarms = std::move(now);
  }

  void digital_points(const Step& step) {
    const Sample& sample = step.sample;
    ++answers;
    for (const IoPoint& item : sample.points) {
      const std::string_view origin = sample.texts.at(item.source);
      point(step, {item.output, item.id}, item.status, origin == "normal" ? "" : origin);
    }
    if (sample.meta.source == Source::inputs) {
      for (const PointField& row : point_fields()) {
        if (sample.at(row.field).has()) {
          point(step, row.key, sample.at(row.field).integer != 0, "");
        }
      }
    }
  }

  void point(const Step& step, PointKey key, bool status, std::string_view detail) {
    Point& known = points[key];
    if (known.told_in == answers) {
      return;  // the same number twice in one answer: the first counts
    }
    known.told_in = answers;
    const auto rank = static_cast<std::size_t>(point_rank(step.sample.meta.source));
    const Micros now = step.sample.meta.t_recv_us;
    known.told_us[rank] = now;
    for (std::size_t better = 0; better < rank; ++better) {
      if (known.told_us[better] && std::abs(now - *known.told_us[better]) <= kPointSilenceUs) {
        return;
      }
    }
    if (known.status && *known.status != status) {
      step.event(key.output ? EventKind::digital_output : EventKind::digital_input, known.t_us,
                 fmt::format("{} {}", key.output ? "DO" : "DI", key.id), flag_text(!status), flag_text(status),
                 std::string(detail));
    }
    known.status = status;
    known.t_us = step.sample.meta.t_send_us;
  }
};

bool derived_from_answers(EventKind kind) {
  switch (kind) {
    case EventKind::link_up:
    case EventKind::link_down:
    case EventKind::client_limit:
    case EventKind::error_frame:
    case EventKind::no_sequence_echo:
    case EventKind::rate:
    case EventKind::word_order:
    case EventKind::clock_step:
    case EventKind::mark:
    case EventKind::part_removed:
    case EventKind::config_changed:
    case EventKind::identity_changed:
    case EventKind::ring_kept:
      return false;
    default:
      return true;
  }
}

EventMachine::EventMachine() : impl_(std::make_unique<Impl>()) {}
EventMachine::~EventMachine() = default;
EventMachine::EventMachine(EventMachine&&) noexcept = default;
EventMachine& EventMachine::operator=(EventMachine&&) noexcept = default;

void EventMachine::step(const Sample& sample, const std::function<void(Event)>& emit) {
  if (sample.meta.source == Source::ring) {
    return;  // written late, and the other sources have told it
  }
  const Impl::Step step{sample, emit};
  SourceState& state = impl_->sources[static_cast<std::size_t>(sample.meta.source)];
  Impl::decodability(step, state);
  Impl::unknown_keys(step, state);
  if (!sample.decodable) {
    return;
  }
  Impl::reboot(step, state);
  Impl::values(step, state);
  Impl::pose_jump(step, state);
  Impl::alarms(step, state);
  impl_->digital_points(step);
}

const FieldSet& EventMachine::fields(Source source) {
  static const std::array<FieldSet, kSourceCount> sets = make_field_sets();
  return sets[static_cast<std::size_t>(source)];
}

}  // namespace tacho
