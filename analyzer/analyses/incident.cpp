#include "analyzer/analyses/incident.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "analyzer/analyses/incident_signals.hpp"
#include "analyzer/analyses/incident_tables.hpp"
#include "analyzer/analyses/incident_timeline.hpp"
#include "schema/time.hpp"

namespace tacho {
namespace {

constexpr Micros kLead = 600'000'000;  // how far back the state before the window is looked for

constexpr auto kState = std::to_array<FieldIndex>({field("x"),
                                                   field("y"),
                                                   field("angle"),
                                                   field("vx"),
                                                   field("vy"),
                                                   field("w"),
                                                   field("is_stop"),
                                                   field("confidence"),
                                                   field("reloc_status"),
                                                   field("current_map"),
                                                   field("current_station"),
                                                   field("last_station"),
                                                   field("target_id"),
                                                   field("task_status"),
                                                   field("task_type"),
                                                   field("blocked"),
                                                   field("block_reason"),
                                                   field("block_x"),
                                                   field("block_y"),
                                                   field("slowed"),
                                                   field("emergency"),
                                                   field("driver_emc"),
                                                   field("soft_emc"),
                                                   field("charging"),
                                                   field("battery_level"),
                                                   field("voltage"),
                                                   field("current"),
                                                   field("battery_temp"),
                                                   field("controller_temp"),
                                                   field("odo"),
                                                   field("jack_state"),
                                                   field("fork_height"),
                                                   field("rssi"),
                                                   field("dispatch_mode"),
                                                   field("current_lock_nick_name")});

/// What an event of the log already says about a field; the field's own change in the same answer is not repeated.
struct Told {
  EventKind kind;
  std::string_view field;
};
constexpr auto kTold = std::to_array<Told>({{EventKind::blocked, "blocked"},
                                            {EventKind::slowed, "slowed"},
                                            {EventKind::emergency, "emergency"},
                                            {EventKind::driver_emergency, "driver_emc"},
                                            {EventKind::charging, "charging"},
                                            {EventKind::station, "current_station"},
                                            {EventKind::station, "current_station_id"},
                                            {EventKind::task, "task_status"},
                                            {EventKind::map, "current_map"},
                                            {EventKind::localisation, "reloc_status"},
                                            {EventKind::localisation, "reloc_status_register"},
                                            {EventKind::control_owner, "current_lock_nick_name"}});

struct SourceQuality {
  std::size_t stored = 0;
  double missed = 0.0;
  std::size_t partial = 0;
  std::vector<std::string> causes;
  Micros longest_hole_us = 0;
  Micros last_send_us = 0;
  Micros worst_rtt_us = 0;
  Micros nearest_us = std::numeric_limits<Micros>::max();  ///< distance of the nearest answer from the moment asked for
  Micros period_us = 0;  ///< at that moment, as events tell; 0: no change of the rate in sight
  Micros shortest_us = std::numeric_limits<Micros>::max();  ///< pause between two answers
};

/// Everything of one robot.
class RobotIncident {
 public:
  RobotIncident(const Robot& robot, const IncidentQuery& query, const Settings& settings)
      : robot_(robot),
        query_(query),
        from_us_(query.at_us - query.before_us),
        to_us_(query.at_us + query.after_us),
        signals_(from_us_, query.at_us, settings, robot.name) {}

  void read(RowSource& log) {
    for (const Coverage& c : log.coverage()) {
      if (c.robot == robot_.id) {
        coverage_.push_back(c);
      }
    }
    log.read(robot_.id, Window{from_us_ - kLead, to_us_}, selection(), [&](const Slice& slice) { fold(slice); });
    // Gap and event rows of the whole log: a gap that began long before may still be open in the window.
    log.read(robot_.id, Window{}, Selection{}, [&](const Slice& slice) { fold_rows(slice); });
  }

  void lines(std::vector<TimeLine>& out) const {
    out.insert(out.end(), lines_.begin(), lines_.end());
    for (const SignalChange& c : signals_.changes()) {
      if (!told(c)) {
        out.push_back({c.hull_to_us, 2, c.hull_from_us, c.hull_to_us, robot_.name, c.alarm ? "alarm" : "change",
                       std::string(source_name(c.source)), c.what, c.old_value, c.new_value, ""});
      }
    }
  }

  void signals(DataTable& table, std::vector<Series>& series) const;
  void state(DataTable& table) const;
  void quality(DataTable& table) const;
  [[nodiscard]] Finding coverage_finding() const;
  [[nodiscard]] const SignalTracker& tracker() const { return signals_; }
  [[nodiscard]] const std::string& name() const { return robot_.name; }

 private:
  Robot robot_;
  IncidentQuery query_;
  Micros from_us_;
  Micros to_us_;
  SignalTracker signals_;
  std::vector<Coverage> coverage_;
  std::vector<TimeLine> lines_;
  std::vector<Event> events_;
  std::map<Source, SourceQuality> quality_;
  std::optional<ClockPoint> clock_;

  [[nodiscard]] Selection selection() const {
    Selection out;
    for (const Coverage& c : coverage_) {
      for (std::size_t f = 0; f < kFieldCount; ++f) {
        if (c.seen.test(f) && kFields[f].kind != Kind::structured) {
          out.add(c.source, static_cast<FieldIndex>(f));
        }
      }
    }
    return out;
  }

  void fold(const Slice& slice) {
    for (const Batch& batch : slice.batches) {
      signals_.fold(batch);
      SourceQuality& q = quality_[batch.source];
      q.shortest_us = std::min(q.shortest_us, shortest_pause(batch));
      for (std::size_t row = 0; row < batch.rows(); ++row) {
        note_row(q, batch, row);
      }
    }
    for (const Event& event : slice.events) {
      note_rate(event);
    }
    for (const ClockPoint& point : slice.clock) {
      if (point.robot_us &&
          (!clock_ || std::abs(point.wall_us - query_.at_us) < std::abs(clock_->wall_us - query_.at_us))) {
        clock_ = point;
      }
    }
  }

  static Micros shortest_pause(const Batch& batch) {
    Micros shortest = std::numeric_limits<Micros>::max();
    for (std::size_t row = 1; row < batch.rows(); ++row) {
      shortest = std::min(shortest, std::abs(batch.t_send_us[row] - batch.t_send_us[row - 1]));
    }
    return shortest;
  }

  /// The rate at the instant that was asked for: of the last change before it, else what the first one after it ended.
  void note_rate(const Event& event) {
    if (event.kind != EventKind::rate) {
      return;
    }
    SourceQuality& q = quality_[event.source];
    const Micros now = parse_rate(event.new_value).value_or(0);
    const Micros before = parse_rate(event.old_value).value_or(0);
    if (event.t_us <= query_.at_us) {
      q.period_us = now;
    } else if (q.period_us == 0) {
      q.period_us = before;
    }
  }

  /// Without a change of the rate in sight it may have been changed earlier: then the answers say what it is.
  [[nodiscard]] static Micros period_at(const Coverage& c, const SourceQuality& q) {
    const bool measured = q.shortest_us != std::numeric_limits<Micros>::max();
    return std::max<Micros>(
        {1, q.period_us > 0 ? q.period_us : c.period_us, measured && q.period_us == 0 ? q.shortest_us : 0});
  }

  void note_row(SourceQuality& q, const Batch& batch, std::size_t row) const {
    const Micros t = batch.t_recv_us[row];
    q.nearest_us = std::min(q.nearest_us, std::abs(t - query_.at_us));
    if (t < from_us_) {
      return;
    }
    ++q.stored;
    q.worst_rtt_us = std::max(q.worst_rtt_us, t - batch.t_send_us[row]);
    if (q.last_send_us != 0) {
      q.longest_hole_us = std::max(q.longest_hole_us, batch.t_send_us[row] - q.last_send_us);
    }
    q.last_send_us = batch.t_send_us[row];
  }

  void fold_rows(const Slice& slice) {
    for (const Event& e : slice.events) {
      if (e.t_us >= from_us_ && e.t_us < to_us_) {
        const bool alarm = e.kind == EventKind::alarm_raised || e.kind == EventKind::alarm_cleared ||
                           e.kind == EventKind::alarm_repeated;
        const std::string kind(event_kind_name(e.kind));
        lines_.push_back({e.t_us, 1, e.t_from_us, e.t_us, robot_.name, alarm ? "alarm" : "event",
                          std::string(source_name(e.source)), e.subject.empty() ? kind : kind + " " + e.subject,
                          e.old_value, e.new_value, e.detail, is_of_robot(e.kind)});
        events_.push_back(e);
      }
    }
    for (const Gap& g : slice.gaps) {
      if (g.t_from_us < to_us_ && g.t_to_us >= from_us_) {
        add_gap(g);
      }
    }
  }

  void add_gap(const Gap& g) {
    SourceQuality& q = quality_[g.source];
    const std::string cause(cause_name(g.cause));
    if (std::find(q.causes.begin(), q.causes.end(), cause) == q.causes.end()) {
      q.causes.push_back(cause);
    }
    // A gap that reaches beyond the window counts with the share that lies inside.
    const double length = static_cast<double>(std::max<Micros>(g.t_to_us - g.t_from_us, 1));
    const double inside =
        static_cast<double>(std::max<Micros>(std::min(g.t_to_us, to_us_) - std::max(g.t_from_us, from_us_), 1));
    if (g.partial) {
      q.partial += g.seq_count;
    } else {
      q.missed += static_cast<double>(g.seq_count) * std::min(1.0, inside / length);
    }
    const std::string count = g.cause == Cause::recorder_off
                                  ? "no polls planned"
                                  : fmt::format("{} polls {}", g.seq_count, g.partial ? "in part" : "missed");
    lines_.push_back({g.t_from_us, 0, g.t_from_us, g.t_to_us, robot_.name, "gap", std::string(source_name(g.source)),
                      cause, "", count, g.detail.empty() ? std::string(cause_meaning(g.cause)) : g.detail});
  }

  [[nodiscard]] bool told(const SignalChange& c) const {
    return std::any_of(events_.begin(), events_.end(), [&](const Event& e) {
      if (e.subject == c.what) {  // an input, output or alarm; another source may have seen it a poll earlier or later
        return e.t_from_us <= c.hull_to_us && e.t_us >= c.hull_from_us;
      }
      if (e.source != c.source || e.seq != c.seq || c.field == kNoField) {
        return false;
      }
      return std::any_of(kTold.begin(), kTold.end(),
                         [&](const Told& t) { return t.kind == e.kind && t.field == kFields[c.field].name; });
    });
  }
};

void RobotIncident::signals(DataTable& table, std::vector<Series>& series) const {
  for (const SignalCurve* c : signals_.curves()) {
    if (c->t_us.size() < 2 || c->materiality() < 1.0) {
      continue;
    }
    const Field& f = kFields[c->field];
    table.rows.push_back({robot_.name, std::string(f.name), std::string(f.unit), std::string(source_name(c->source)),
                          c->value.front(), c->least, c->greatest, c->value.back(), c->largest_step,
                          Time{c->step_from_us}, Time{c->step_to_us},
                          c->material.value ? Value(*c->material.value) : Value(Missing{"no step for this unit"}),
                          c->material.value ? c->material.source
                          : f.unit == "s"   ? "running time: listed when it falls"
                                            : "half of the greatest value",
                          c->materiality()});
    series.push_back(
        {std::string(f.name), std::string(f.meaning), std::string(f.unit), robot_.name, c->t_us, c->value});
  }
}

void RobotIncident::state(DataTable& table) const {
  const auto seconds = [&](Micros t_us) { return static_cast<double>(query_.at_us - t_us) / 1e6; };
  for (const FieldIndex index : kState) {
    const LastValue* last = signals_.last(index);
    if (last == nullptr) {
      continue;
    }
    const bool present = last->state == State::present;
    table.rows.push_back({robot_.name, std::string(kFields[index].name),
                          present ? Value(last->text) : Value(Missing{std::string(state_name(last->state))}),
                          std::string(kFields[index].unit), std::string(state_name(last->state)),
                          std::string(source_name(last->source)), seconds(last->t_us)});
  }
  for (const std::string& alarm : signals_.alarms_at()) {
    table.rows.push_back({robot_.name, std::string("alarm"), alarm, std::string(), std::string("present"),
                          std::string(source_name(Source::status)), Missing{}});
  }
}

void RobotIncident::quality(DataTable& table) const {
  for (const Coverage& c : coverage_) {
    const auto at = quality_.find(c.source);
    const SourceQuality q = at == quality_.end() ? SourceQuality{} : at->second;
    std::string causes;
    for (const std::string& cause : q.causes) {
      causes += (causes.empty() ? "" : ", ") + cause;
    }
    Quantity offset;
    offset.unit = "s";
    offset.reason = "no robot clock in this part of the log";
    if (clock_) {
      offset.value = static_cast<double>(*clock_->robot_us - clock_->wall_us) / 1e6;
    }
    const auto none = [&](Micros us) {
      return q.stored == 0 ? Value(Missing{"no answer in the window"}) : Value(static_cast<double>(us) / 1e6);
    };
    table.rows.push_back({robot_.name, std::string(source_name(c.source)), static_cast<double>(c.period_us) / 1e6,
                          static_cast<std::int64_t>(q.stored), std::round(q.missed),
                          static_cast<std::int64_t>(q.partial), causes, none(q.longest_hole_us), none(q.worst_rtt_us),
                          offset});
  }
}

Finding RobotIncident::coverage_finding() const {
  Finding f;
  f.id = "INC-01";
  f.robot = robot_.name;
  f.title = "answers around the moment asked for";
  f.threshold = "PASS when an answer lies within 3 periods of it, else WARN; UNKNOWN without any answer in the window";
  f.threshold_source = "fixed";
  f.value.unit = "s";
  Micros nearest = std::numeric_limits<Micros>::max();
  Micros period = 1;
  std::size_t stored = 0;
  for (const Coverage& c : coverage_) {
    const auto q = quality_.find(c.source);
    if (q == quality_.end()) {
      continue;
    }
    stored += q->second.stored;
    if (q->second.nearest_us < nearest) {
      nearest = q->second.nearest_us;
      period = period_at(c, q->second);
    }
  }
  if (stored == 0) {
    f.verdict = Verdict::unknown;
    f.value.reason = "no answer of this robot in the window";
    f.advice =
        "compare --at with the first and last times that `tacho-analyzer info` prints, and mind the time zone (--tz)";
    return f;
  }
  f.value.value = static_cast<double>(nearest) / 1e6;
  f.verdict = nearest <= 3 * period ? Verdict::pass : Verdict::warn;
  f.severity = f.verdict == Verdict::pass ? 0 : 3;
  f.advice = "the moment itself was not recorded; the gap rows in the time line say why";
  return f;
}

void fill_timeline(DataTable& table, std::vector<TimeLine> lines, const IncidentQuery& query) {
  TimeLine mark;
  mark.t_us = mark.hull_from_us = mark.hull_to_us = query.at_us;
  mark.rank = 3;
  mark.kind = "moment";
  mark.what = "the moment asked for";
  lines.push_back(mark);
  for (const TimeLine& l : join_repeats(std::move(lines))) {
    table.rows.push_back({Time{l.t_us}, static_cast<double>(l.t_us - query.at_us) / 1e6, l.robot, l.kind, l.source,
                          l.what, l.old_value, l.new_value, l.detail, Time{l.hull_from_us}, Time{l.hull_to_us}});
  }
}

}  // namespace

Section incident(RowSource& log, std::span<const RobotId> robots, const IncidentQuery& query,
                 const Settings& settings) {
  Section section;
  section.name = "incident";
  section.title = "Incident at " + iso_zone(query.at_us, query.zone);
  section.question = "What happened?";
  DataTable timeline = timeline_table();
  DataTable signals = signals_table();
  DataTable state = state_table();
  DataTable quality = quality_table();
  std::vector<TimeLine> lines;
  for (const Robot& robot : log.robots()) {
    if (!robots.empty() && std::find(robots.begin(), robots.end(), robot.id) == robots.end()) {
      continue;
    }
    RobotIncident one(robot, query, settings);
    one.read(log);
    one.lines(lines);
    one.signals(signals, section.series);
    one.state(state);
    one.quality(quality);
    section.findings.push_back(one.coverage_finding());
    const std::vector<std::string> running = one.tracker().running_values();
    if (!running.empty()) {
      section.notes.push_back(fmt::format("{}: not in the time line because they change all the time: {}", robot.name,
                                          fmt::join(running, ", ")));
    }
  }
  fill_timeline(timeline, std::move(lines), query);
  section.notes.insert(section.notes.begin(),
                       fmt::format("Window: {} before to {} after the moment. A change between two answers happened "
                                   "after hull_from and not later than hull_to.",
                                   duration_text(query.before_us), duration_text(query.after_us)));
  section.tables = {std::move(timeline), std::move(signals), std::move(state), std::move(quality)};
  return section;
}

}  // namespace tacho
