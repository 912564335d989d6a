// Results as tables, curves and notes. Columns are documented here and nowhere else.

#include <fmt/format.h>

#include <cmath>

#include "analyzer/analyses/odometry_result.hpp"

namespace tacho::odometry {
namespace {

Value number_or(std::optional<double> value, const std::string& reason) {
  return value && std::isfinite(*value) ? Value{*value} : Value{Missing{reason}};
}
Value count(std::uint64_t n) { return static_cast<std::int64_t>(n); }
std::string name_of(const SourceResult& s) { return std::string(source_name(s.source)); }

ColumnSpec robot_column() { return {"robot", "", "name of the robot"}; }
ColumnSpec from_column() { return {"from", "", "host time, UTC", false, true}; }
ColumnSpec to_column() { return {"to", "", "host time, UTC", false, true}; }
ColumnSpec with_limits(const char* name, const char* unit, const char* text) { return {name, unit, text, true}; }

DataTable counter_table(const std::vector<RobotResult>& robots) {
  DataTable t{"counter", "Odometer: is it sane (A1)", {}, {}};
  t.columns = {robot_column(),
               {"source", "", "where the counter was read"},
               {"period_s", "s", "median pause between answers"},
               integer_column("rows", "answers, without repeated ones"),
               integer_column("repeated", "answers with the uptime of the one before"),
               {"counted_m", "m", "growth of the counter"},
               {"quantum_m", "m", "largest step of which all values are multiples"},
               {"kind", "", "decimal number, float32, ..."},
               integer_column("falls", "times the counter fell"),
               integer_column("jumps", "times it grew faster than the robot can drive"),
               integer_column("stuck", "times it stood while the speed says > 1 m"),
               {"today_range_m", "m", "largest range of odo - today_odo in one day of the robot"},
               {"today_allowed_m", "m", "range that rounding explains"},
               {"robot_zone_h", "h", "the robot's midnight: its clock minus UTC"}};
  for (const RobotResult& r : robots) {
    for (const SourceResult& s : r.sources) {
      const CounterResult& c = s.counter;
      const bool today = !c.days.empty();
      const std::string none = c.seen ? "fewer than 20 different values" : "no odo";
      t.rows.push_back({r.robot, name_of(s), number_or(s.period_s, "fewer than two rows"), count(s.rows),
                        count(s.duplicates), c.seen ? Value{c.counted_m} : Value{Missing{none}},
                        number_or(c.quantum_m, none), c.kind.empty() ? Value{Missing{none}} : Value{c.kind},
                        count(c.count(CounterEvent::What::fall)), count(c.count(CounterEvent::What::jump)),
                        count(c.count(CounterEvent::What::stuck)),
                        today ? Value{c.today_range_m} : Value{Missing{"today_odo not supplied"}},
                        today ? Value{c.today_allowed_m} : Value{Missing{"today_odo not supplied"}},
                        number_or(c.zone_h(), "no fall of today_odo seen within 15 min")});
    }
  }
  return t;
}

DataTable counter_events(const std::vector<RobotResult>& robots) {
  DataTable t{"counter_events", "Odometer: falls, jumps and standstills", {}, {}, true};
  t.columns = {robot_column(),
               {"source", "", "where the counter was read"},
               {"what", "", "fall, jump or stuck"},
               from_column(),
               to_column(),
               {"before_m", "m", "counter before"},
               {"after_m", "m", "counter after"},
               {"uptime_s", "s", "time since power-on after it"},
               {"allowed_m", "m", "jump: growth possible; stuck: metres by the speed"}};
  for (const RobotResult& r : robots) {
    for (const SourceResult& s : r.sources) {
      for (const CounterEvent& e : s.counter.events) {
        t.rows.push_back({r.robot, name_of(s), std::string(counter_event_name(e.what)), Time{e.from_us}, Time{e.to_us},
                          e.before_m, e.after_m, number_or(e.uptime_s, "no uptime"), e.allowed_m});
      }
    }
  }
  return t;
}

DataTable scale_table(const std::vector<RobotResult>& robots) {
  DataTable t{"scales", "Odometer against speed (A2), what it counts (A4), odometer against path (A3)", {}, {}};
  t.columns = {robot_column(),
               {"source", "", "where counter and speed were read"},
               with_limits("g", "1", "counter metres per metre of measured speed"),
               {"u_g", "1", "usual standard uncertainty of one window"},
               integer_column("windows", "windows of at least 20 m"),
               {"excluding_one", "1", "share of windows whose hard interval excludes 1"},
               {"speed_m", "m", "distance by speed"},
               with_limits("a", "1", "fit: counter metres per metre of speed"),
               with_limits("b_m_per_rad", "m/rad", "fit: counter metres per radian on the spot"),
               {"counts", "", "what the counter counts"},
               with_limits("s_o", "1", "metres of localised path per counter metre"),
               integer_column("strides", "strides behind s_o"),
               {"path_counted_m", "m", "counter metres in them"},
               {"left_out_m", "m", "counter metres of strides left out"},
               {"arc_correction", "1", "share of the path added for arcs"},
               {"noise_correction", "1", "share of the path taken off for pose noise"},
               {"accel_bound_mps2", "m/s2", "acceleration bound used between polls"},
               integer_column("accel_raised", "intervals that needed a higher one")};
  for (const RobotResult& r : robots) {
    for (const SourceResult& s : r.sources) {
      const bool first = &s == &r.sources.front();
      Quantity s_o = r.path.s_o;
      if (!first) {
        s_o = {{}, "1", {}, {}, {}, {}, "measured with " + name_of(r.sources.front())};
      }
      const auto path = [&](Value v) { return s_o.value ? std::move(v) : Value{Missing{s_o.reason}}; };
      t.rows.push_back({r.robot, name_of(s), s.speed.g, s.speed.u, count(s.speed.windows.size()), s.speed.excluding_one,
                        s.speed.driven_m, s.counts.a, s.counts.b, s.counts.verdict, s_o, path(count(r.path.strides)),
                        path(r.path.counted_m), path(r.path.left_out_m), path(r.path.arc_correction),
                        path(r.path.noise_correction), s.accelerations.linear, count(s.accelerations.raised)});
    }
  }
  return t;
}

DataTable drift_table(const std::vector<RobotResult>& robots) {
  DataTable t{"drift", "Dead reckoning against localisation (A5), before calibration", {}, {}};
  t.columns = {robot_column(),
               {"length_m", "m", "counter distance of a pair"},
               integer_column("n", "pairs"),
               {"n_eff", "1", "independent stretches"},
               with_limits("rmse_pct", "%", "rms of |e| / L"),
               {"median_pct", "%", "median of |e| / L"},
               {"p95_pct", "%", "95th percentile of |e| / L"},
               with_limits("along_pct", "%", "mean of e along the heading / L: scale"),
               with_limits("turn_deg_per_m", "deg/m", "mean heading error / L"),
               with_limits("turn_rms_deg", "deg", "rms of the heading error"),
               {"integration_deg", "deg", "part of it that integrating w between polls explains"},
               {"straight_share", "1", "pairs with chord/arc >= 0.95"}};
  for (const RobotResult& r : robots) {
    for (const DriftRow& d : r.drift.rows) {
      const std::string why = r.drift.reason.empty() ? d.rmse_pct.reason : r.drift.reason;
      const auto given = [&](double v) { return d.n > 0 ? Value{v} : Value{Missing{why}}; };
      const auto quantity = [&](Quantity q) {
        q.reason = q.value ? q.reason : why;
        return q;
      };
      t.rows.push_back({r.robot, d.length_m, d.n, d.n_eff, quantity(d.rmse_pct), given(d.median_pct), given(d.p95_pct),
                        quantity(d.along_pct), quantity(d.turn_deg_per_m), quantity(d.turn_rms_deg),
                        quantity(d.integration_deg), given(d.straight_share)});
    }
  }
  return t;
}

DataTable law_table(const std::vector<RobotResult>& robots) {
  DataTable t{"noise", "Standstill (A11) and drift law (A5)", {}, {}};
  t.columns = {robot_column(),
               with_limits("sigma_p_mm", "mm", "pose noise per axis at standstill"),
               with_limits("sigma_theta_mrad", "mrad", "heading noise at standstill"),
               integer_column("still_runs", "standstills of at least 10 s"),
               {"still_h", "h", "their duration"},
               integer_column("frozen_runs", "standstills in which the pose was only repeated"),
               with_limits("creep_mm", "mm", "median pose creep in a standstill; limits: 2.5 and 97.5 % of the runs"),
               integer_column("counting_runs", "standstills in which the counter moved by more than its quantum"),
               {"heading_walk", "rad/sqrt(m)", "sqrt q"},
               {"heading_bias", "rad/m", "|b|"},
               {"position_walk", "m/sqrt(m)", "beta"},
               {"position_systematic", "1", "alpha"},
               with_limits("at_10m_raw_pct", "%", "position drift at 10 m, raw")};
  for (const RobotResult& r : robots) {
    if (r.sources.empty()) {
      continue;
    }
    t.rows.push_back({r.robot, scaled(r.still.sigma_p, 1e3, "mm"), scaled(r.still.sigma_theta, 1e3, "mrad"),
                      count(r.still.runs), r.still.seconds / 3600.0, count(r.still.frozen_runs),
                      scaled(r.still.creep_m, 1e3, "mm"), count(r.still.counting_runs), r.drift.law.heading_walk,
                      r.drift.law.heading_bias, r.drift.law.walk, r.drift.law.systematic, r.drift.law.at_10m});
  }
  return t;
}

DataTable jump_table(const std::vector<RobotResult>& robots) {
  DataTable t{"jumps", "Localisation jumps (A9)", {}, {}};
  t.columns = {robot_column(),
               from_column(),
               to_column(),
               {"x_m", "m", "pose before"},
               {"y_m", "m", "pose before"},
               {"dx_m", "m", "jump in the map frame"},
               {"dy_m", "m", "jump in the map frame"},
               {"turn_deg", "deg", "heading jump"},
               {"allowed_m", "m", "step that noise and polling explain"},
               {"allowed_deg", "deg", "turn that they explain"},
               {"lowest_confidence", "1", "within 2 s"},
               {"cause", "", "first that fits"},
               {"meaning", "", "of the cause"}};
  for (const RobotResult& r : robots) {
    for (const Jump& j : r.jumps.jumps) {
      t.rows.push_back({r.robot, Time{j.from_us}, Time{j.to_us}, j.before.x, j.before.y, j.dx_m, j.dy_m,
                        j.dangle_rad * kToDegrees, j.allowed_m, j.allowed_rad * kToDegrees,
                        number_or(j.confidence < 0.0 ? std::nullopt : std::optional(j.confidence), "no confidence"),
                        std::string(jump_cause_name(j.cause)), std::string(jump_cause_meaning(j.cause))});
    }
  }
  return t;
}

DataTable cross_table(const std::vector<RobotResult>& robots) {
  DataTable t{"json_modbus", "JSON against Modbus (A12)", {}, {}};
  t.columns = {robot_column(),
               {"quantity", "", "field compared"},
               integer_column("n", "comparisons"),
               integer_column("outside", "differences above the tolerance"),
               number_column("mean_tolerance", "in the quantity's unit"),
               number_column("worst", "difference furthest outside, or nearest to it"),
               number_column("worst_allowed", "tolerance there"),
               {"unit", "", "of the last three"},
               {"worst_at", "", "host time, UTC", false, true}};
  for (const RobotResult& r : robots) {
    for (std::size_t k = 0; k < kComparedCount; ++k) {
      const CrossCount& c = r.cross.counts[k];
      const auto what = static_cast<Compared>(k);
      if (c.n > 0) {
        t.rows.push_back({r.robot, std::string(compared_name(what)), count(c.n), count(c.outside),
                          c.tolerance_sum / static_cast<double>(c.n), c.worst, c.allowed,
                          std::string(compared_unit(what)), Time{c.worst_us}});
      }
    }
  }
  return t;
}

DataTable segment_table(const std::vector<RobotResult>& robots) {
  DataTable t{"segments", "Segments: what may be integrated in one piece (A.2)", {}, {}, true};
  t.columns = {robot_column(),
               from_column(),
               to_column(),
               {"begins_with", "", "why a new segment starts"},
               {"meaning", "", "of the reason"},
               integer_column("rows", "answers"),
               {"driven_m", "m", "counter metres"}};
  for (const RobotResult& r : robots) {
    for (const Segment& s : r.segments) {
      t.rows.push_back({r.robot, Time{s.from_us}, Time{s.to_us}, std::string(cut_name(s.cut)),
                        std::string(cut_meaning(s.cut)), count(s.rows), s.driven_m});
    }
  }
  return t;
}

DataTable stretch_table(const std::vector<RobotResult>& robots) {
  DataTable t{
      "stretches", "Dead-reckoned stretches and their absolute error after alignment (A5, secondary)", {}, {}, true};
  t.columns = {robot_column(),
               from_column(),
               to_column(),
               {"driven_m", "m", "counter metres"},
               {"ate_m", "m", "rms distance of the aligned tracks"}};
  for (const RobotResult& r : robots) {
    for (const SegmentError& s : r.drift.segments) {
      t.rows.push_back({r.robot, Time{s.from_us}, Time{s.to_us}, s.driven_m, s.ate_m});
    }
  }
  return t;
}

DataTable tag_table(const std::vector<RobotResult>& robots) {
  DataTable t{"tags", "Times that do not count everywhere (A.2)", {}, {}};
  t.columns = {robot_column(),
               {"tag", "", ""},
               {"hours", "h", "time in it"},
               integer_column("rows", "answers in it"),
               {"meaning", "", ""}};
  for (const RobotResult& r : robots) {
    for (const TagTime& tag : r.tags) {
      if (tag.rows > 0) {
        t.rows.push_back({r.robot, tag.name, tag.hours, count(tag.rows), tag.meaning});
      }
    }
  }
  return t;
}

DataTable day_table(const std::vector<RobotResult>& robots) {
  DataTable t{"speed_days", "Odometer against speed per day", {}, {}, true};
  t.columns = {robot_column(),
               {"day", "", "in the report's zone"},
               {"g", "1", "weighted median over the day"},
               integer_column("windows", "windows that ended on it")};
  for (const RobotResult& r : robots) {
    for (const SpeedDay& day : r.days) {
      if (r.sources.front().speed.g.value) {
        t.rows.push_back({r.robot, day.day, day.g, day.windows});
      }
    }
  }
  return t;
}

}  // namespace

std::vector<DataTable> make_tables(const std::vector<RobotResult>& robots) {
  return {scale_table(robots),   counter_table(robots), drift_table(robots),  law_table(robots),
          jump_table(robots),    cross_table(robots),   tag_table(robots),    counter_events(robots),
          segment_table(robots), day_table(robots),     stretch_table(robots)};
}

std::vector<Series> make_series(const RobotResult& r) {
  std::vector<Series> all;
  if (!r.sources.empty() && r.sources.front().speed.g.value) {
    Series g{"g", "Counter metres per metre of speed", "1", r.robot, {}, {}};
    for (const SpeedWindow& w : r.sources.front().speed.windows) {
      g.t_us.push_back(w.to_us);
      g.value.push_back(w.g());
    }
    all.push_back(std::move(g));
  }
  if (!r.path.curve.empty()) {
    all.push_back(
        {"s_o", "Path metres per counter metre, stretches of 100 m", "1", r.robot, r.path.curve_t_us, r.path.curve});
  }
  return all;
}

std::vector<std::string> make_notes(const RobotResult& r) {
  std::vector<std::string> notes;
  if (r.sources.empty()) {
    return {r.robot.empty() ? "the log holds no robot" : r.robot + ": " + r.cross.reason};
  }
  const SourceResult& s = r.sources.front();
  std::string text = fmt::format("{}: pose, speed and counter from {}", r.robot, source_name(s.source));
  if (std::isfinite(s.period_s)) {
    text += fmt::format(", one answer per {:.3g} s", s.period_s);
  }
  notes.push_back(text + (s.source == Source::registers ? " (no status answers: float32 counter)" : ""));
  notes.push_back(fmt::format("{}: the counter counts: {}", r.robot, s.counts.verdict));
  for (const SourceResult& each : r.sources) {
    if (!each.speed.signature.empty()) {
      notes.push_back(fmt::format("{}: {}: {}", r.robot, source_name(each.source), each.speed.signature));
    }
  }
  if (r.jumps.reason.empty()) {
    notes.push_back(
        fmt::format("{}: {} intervals looked at for jumps, {} off together with a neighbour (slip, not a jump); a step "
                    "of {:.2g} m would have shown on {:.3g} of {:.3g} km",
                    r.robot, r.jumps.intervals, r.jumps.sustained, r.config.jump_seen_m, r.jumps.seen_km, r.jumps.km));
  }
  if (r.g_trend && s.speed.g.value) {
    notes.push_back(fmt::format("{}: trend of g over {} days: {:+.3g} per day [{:+.3g}, {:+.3g}], p = {:.2g}", r.robot,
                                r.g_trend->n, r.g_trend->line.slope, r.g_trend->line.lo, r.g_trend->line.hi,
                                r.g_trend->p));
  }
  if (r.cross.lag_s.value) {
    const Quantity& lag = r.cross.lag_s;
    const std::string limits =
        lag.lo && lag.hi ? fmt::format("[{:.0f}, {:.0f}]", 1e3 * *lag.lo, 1e3 * *lag.hi) : "(" + lag.reason + ")";
    notes.push_back(
        fmt::format("{}: the registers are {:.0f} ms {} behind the status answers", r.robot, 1e3 * *lag.value, limits));
  }
  for (const DriftRow& d : r.drift.rows) {
    if (d.rmse_pct.value && !d.rmse_pct.reason.empty()) {
      notes.push_back(fmt::format("{}: drift from {:.0f} m on: {}", r.robot, d.length_m, d.rmse_pct.reason));
      break;
    }
  }
  return notes;
}

}  // namespace tacho::odometry
