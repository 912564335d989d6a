#include "analyzer/analyses/incident.hpp"

#include "tests/support/catch.hpp"
#include "tests/support/memory_log.hpp"

using namespace tacho;
using test::MemoryLog;

namespace {

constexpr double kAt = 1000.0;

/// A robot at 1 Hz that drives, is blocked from 995 to 1010, and raises error 52201 from 998 to 1003.
MemoryLog blocked_robot() {
  MemoryLog log;
  const RobotId robot = log.add_robot("amb-01");
  log.period(robot, Source::status, 1.0);
  for (int t = 900; t < 1060; ++t) {
    Sample& s = log.row(robot, Source::status, t);
    const bool blocked = t >= 995 && t < 1010;
    MemoryLog::set(s, "x", t < 995 ? t - 900.0 : t < 1010 ? 95.0 : t - 915.0);
    MemoryLog::set(s, "vx", blocked ? 0.0001 : 1.0);
    MemoryLog::set(s, "voltage", 50.0 + 0.001 * (t % 3));
    MemoryLog::set(s, "uptime", t + 5000.0);
    MemoryLog::set_int(s, "blocked", blocked ? 1 : 0);
    MemoryLog::set_text(s, "current_station", t < 1005 ? "LM1" : "LM2");
    MemoryLog::set_text(s, "create_on", "stamp " + std::to_string(t));
    if (blocked) {
      MemoryLog::set_int(s, "block_reason", 1);
    } else {
      MemoryLog::set_state(s, "block_reason", State::not_meaningful);
    }
    MemoryLog::no_alarms(s);
    if (t >= 998 && t < 1003) {
      MemoryLog::alarm(s, AlarmLevel::error, 52201, 1'767'226'598);
    }
  }
  return log;
}

Section run(MemoryLog& log, double at = kAt, const Settings& settings = {}) {
  IncidentQuery query;
  query.at_us = MemoryLog::micros(at);
  return incident(log, {}, query, settings);
}

const DataTable& table(const Section& section, const std::string& name) {
  for (const DataTable& t : section.tables) {
    if (t.name == name) {
      return t;
    }
  }
  throw std::runtime_error("no table " + name);
}

std::size_t column(const DataTable& t, const std::string& name) {
  for (std::size_t i = 0; i < t.columns.size(); ++i) {
    if (t.columns[i].name == name) {
      return i;
    }
  }
  throw std::runtime_error("no column " + name);
}

std::string text(const DataTable& t, std::size_t row, const std::string& name) {
  const Value& value = t.rows[row][column(t, name)];
  return std::holds_alternative<std::string>(value) ? std::get<std::string>(value) : "";
}
double real(const DataTable& t, std::size_t row, const std::string& name) {
  return std::get<double>(t.rows[row][column(t, name)]);
}
Micros time_of(const DataTable& t, std::size_t row, const std::string& name) {
  return std::get<Time>(t.rows[row][column(t, name)]).us;
}

/// Rows of the time line about `what`.
std::vector<std::size_t> about(const DataTable& t, const std::string& what) {
  std::vector<std::size_t> rows;
  for (std::size_t i = 0; i < t.rows.size(); ++i) {
    if (text(t, i, "what") == what) {
      rows.push_back(i);
    }
  }
  return rows;
}

}  // namespace

TEST_CASE("a change is in the time line once, with the hull between the two answers it was seen in") {
  MemoryLog log = blocked_robot();
  const Section section = run(log);
  const DataTable& line = table(section, "timeline");
  const auto rows = about(line, "blocked");
  REQUIRE(rows.size() == 2);
  CHECK(text(line, rows[0], "old") == "false");
  CHECK(text(line, rows[0], "new") == "true");
  CHECK(time_of(line, rows[0], "hull_from") == MemoryLog::micros(994.0));
  CHECK(time_of(line, rows[0], "hull_to") == MemoryLog::micros(995.004));
  CHECK(time_of(line, rows[0], "t") == MemoryLog::micros(995.004));
  CHECK(real(line, rows[0], "offset_s") == Approx(-4.996));
}

TEST_CASE("the time line is in the order of time and holds the moment asked for") {
  MemoryLog log = blocked_robot();
  const Section section = run(log);
  const DataTable& line = table(section, "timeline");
  for (std::size_t i = 1; i < line.rows.size(); ++i) {
    CHECK(time_of(line, i - 1, "t") <= time_of(line, i, "t"));
  }
  const auto mark = about(line, "the moment asked for");
  REQUIRE(mark.size() == 1);
  CHECK(time_of(line, mark[0], "t") == MemoryLog::micros(kAt));
}

TEST_CASE("alarms are raised and cleared in the time line, and stand in the state while they last") {
  MemoryLog log = blocked_robot();
  const Section section = run(log);
  const auto rows = about(table(section, "timeline"), "error 52201");
  REQUIRE(rows.size() == 2);
  CHECK(text(table(section, "timeline"), rows[0], "new") == "raised");
  CHECK(text(table(section, "timeline"), rows[1], "new") == "cleared");
  const DataTable& state = table(section, "state");
  std::size_t alarms = 0;
  for (std::size_t i = 0; i < state.rows.size(); ++i) {
    alarms += text(state, i, "field") == "alarm" && text(state, i, "value") == "error 52201" ? 1U : 0U;
  }
  CHECK(alarms == 1);
}

TEST_CASE("an event of the log replaces the change of its field in the same answer") {
  MemoryLog log = blocked_robot();
  Event event;
  event.robot = 1;
  event.kind = EventKind::blocked;
  event.seq = 95;  // the answer at 995 s
  event.t_from_us = MemoryLog::micros(994.0);
  event.t_us = MemoryLog::micros(995.004);
  event.old_value = "false";
  event.new_value = "true";
  log.event(event);
  const Section section = run(log);
  const DataTable& line = table(section, "timeline");
  const auto rows = about(line, "blocked");
  REQUIRE(rows.size() == 2);
  CHECK(text(line, rows[0], "kind") == "event");
  CHECK(text(line, rows[1], "kind") == "change");
}

TEST_CASE("signals that changed are listed with their largest step, noise and running clocks are not") {
  MemoryLog log = blocked_robot();
  const Section section = run(log);
  const DataTable& signals = table(section, "signals");
  std::vector<std::string> names;
  for (std::size_t i = 0; i < signals.rows.size(); ++i) {
    names.push_back(text(signals, i, "field"));
  }
  REQUIRE(names == std::vector<std::string>{"x", "vx"});
  CHECK(real(signals, 1, "first") == 1.0);
  CHECK(real(signals, 1, "min") == 0.0001);
  CHECK(real(signals, 1, "largest_step") == Approx(-0.9999));
  CHECK(time_of(signals, 1, "step_to") == MemoryLog::micros(995.004));
  CHECK(section.notes.back().find("create_on") != std::string::npos);
}

TEST_CASE("what counts as a change of a signal is a setting, and each row says where it came from") {
  MemoryLog log = blocked_robot();
  CHECK(text(table(run(log), "signals"), 0, "set_by") == "default");
  Settings settings;
  settings.set("incident.step_mps", 5.0, "site.toml:3");
  settings.set("amb-01/incident.step_m", 0.001, "site.toml:5");
  settings.set("another/incident.step_m", 1e6, "site.toml:7");
  const Section section = run(log, kAt, settings);
  const DataTable& signals = table(section, "signals");
  REQUIRE(signals.rows.size() == 1);
  CHECK(text(signals, 0, "field") == "x");
  CHECK(real(signals, 0, "material_step") == 0.001);
  CHECK(text(signals, 0, "set_by") == "site.toml:5");
}

TEST_CASE("an angle that passes pi has not jumped") {
  MemoryLog log;
  const RobotId robot = log.add_robot("a");
  for (int t = 0; t < 60; ++t) {
    MemoryLog::set(log.row(robot, Source::status, t), "angle", std::remainder(3.0 + 0.01 * t, 6.283185307179586));
  }
  const Section section = run(log, 30.0);
  const DataTable& signals = table(section, "signals");
  REQUIRE(signals.rows.size() == 1);
  CHECK(real(signals, 0, "largest_step") == Approx(0.01).margin(1e-9));
  CHECK(real(signals, 0, "max") == Approx(3.59).margin(1e-9));
}

TEST_CASE("the state says what was known at the moment, how old it was, and what was not meaningful") {
  MemoryLog log = blocked_robot();
  const Section before = run(log, 980.5);
  const DataTable& state = table(before, "state");
  std::map<std::string, std::size_t> rows;
  for (std::size_t i = 0; i < state.rows.size(); ++i) {
    rows[text(state, i, "field")] = i;
  }
  CHECK(text(state, rows.at("blocked"), "value") == "false");
  CHECK(text(state, rows.at("block_reason"), "state") == "not_meaningful");
  CHECK(text(state, rows.at("block_reason"), "value").empty());
  CHECK(text(state, rows.at("current_station"), "value") == "LM1");
  CHECK(real(state, rows.at("x"), "age_s") == Approx(0.496));
  const Section during = run(log);
  const DataTable& later = table(during, "state");
  for (std::size_t i = 0; i < later.rows.size(); ++i) {
    if (text(later, i, "field") == "block_reason") {
      CHECK(text(later, i, "value") == "laser");
    }
  }
}

TEST_CASE("a gap that began long before the window and reaches into it is in the time line and in the data quality") {
  MemoryLog log = blocked_robot();
  Gap gap;
  gap.robot = 1;
  gap.source = Source::status;
  gap.seq_count = 100;
  gap.t_from_us = MemoryLog::micros(850.0);
  gap.t_to_us = MemoryLog::micros(950.0);
  gap.cause = Cause::timeout;
  gap.detail = "no answer within 1 s";
  log.gap(gap);
  const Section section = run(log);
  const DataTable& line = table(section, "timeline");
  const auto rows = about(line, "timeout");
  REQUIRE(rows.size() == 1);
  CHECK(text(line, rows[0], "kind") == "gap");
  CHECK(text(line, rows[0], "new") == "100 polls missed");
  const DataTable& quality = table(section, "quality");
  REQUIRE(quality.rows.size() == 1);
  CHECK(real(quality, 0, "missed") == 10.0);  // 940 to 950 of 850 to 950
  CHECK(std::get<std::int64_t>(quality.rows[0][column(quality, "stored")]) == 90);
  CHECK(text(quality, 0, "causes") == "timeout");
}

TEST_CASE("a moment that was not recorded is UNKNOWN, not empty success") {
  MemoryLog log = blocked_robot();
  const Section far = run(log, 50'000.0);
  REQUIRE(far.findings.size() == 1);
  CHECK(far.findings[0].verdict == Verdict::unknown);
  CHECK_FALSE(far.findings[0].value.reason.empty());
  CHECK(run(log).findings[0].verdict == Verdict::pass);
  MemoryLog empty;
  CHECK(run(empty).findings.empty());
}

TEST_CASE("cutting the log into other slices changes nothing in the incident") {
  MemoryLog whole = blocked_robot();
  const Section expected = run(whole);
  for (const std::size_t rows : {1U, 7U, 50U}) {
    MemoryLog log = blocked_robot();
    log.slice_rows(rows);
    const Section section = run(log);
    CHECK(table(section, "timeline").rows.size() == table(expected, "timeline").rows.size());
    CHECK(table(section, "signals").rows.size() == table(expected, "signals").rows.size());
    CHECK(table(section, "state").rows.size() == table(expected, "state").rows.size());
  }
}

TEST_CASE("inputs and outputs change in the time line, from the first time they are seen on") {
  MemoryLog log;
  const RobotId robot = log.add_robot("a");
  for (int t = 0; t < 20; ++t) {
    Sample& s = log.row(robot, Source::io, t);
    MemoryLog::set_int(s, "di", 1);
    s.points.push_back({false, t >= 12, 1, 3, 0});
  }
  const Section section = run(log, 10.0);
  const DataTable& line = table(section, "timeline");
  const auto rows = about(line, "DI 3");
  REQUIRE(rows.size() == 1);
  CHECK(text(line, rows[0], "new") == "true");
}

TEST_CASE("an input that several sources report, or an event names, is told once") {
  MemoryLog log;
  const RobotId robot = log.add_robot("a");
  for (int t = 0; t < 20; ++t) {
    for (const Source source : {Source::status, Source::io}) {
      Sample& s = log.row(robot, source, source == Source::io ? t + 0.5 : t);
      MemoryLog::set_int(s, "di", 1);
      s.points.push_back({false, t >= 12, 1, 3, 0});
    }
    MemoryLog::set_int(log.row(robot, Source::inputs, t + 0.7), "di_3", t >= 12 ? 1 : 0);
  }
  const auto told = [](const Section& section) {
    const DataTable& line = table(section, "timeline");
    return about(line, "DI 3").size() + about(line, "di_3").size() + about(line, "digital_input DI 3").size();
  };
  CHECK(told(run(log, 10.0)) == 1);
  Event event;
  event.robot = robot;
  event.source = Source::io;
  event.kind = EventKind::digital_input;
  event.subject = "DI 3";
  event.seq = 12;
  event.t_from_us = MemoryLog::micros(11.5);
  event.t_us = MemoryLog::micros(12.504);
  log.event(event);
  const Section section = run(log, 10.0);
  CHECK(told(section) == 1);
  CHECK(about(table(section, "timeline"), "digital_input DI 3").size() == 1);
}

TEST_CASE("an alarm array that is missing or cannot be read in full clears nothing in the time line") {
  MemoryLog log;
  const RobotId robot = log.add_robot("a");
  for (int t = 0; t < 40; ++t) {
    Sample& s = log.row(robot, Source::status, t);
    MemoryLog::no_alarms(s);
    if (t == 15) {
      s.alarms_incomplete.set(static_cast<std::size_t>(AlarmLevel::error));
    } else if (t == 20) {
      MemoryLog::set_state(s, "errors", State::wrong_type);
    } else if (t >= 10 && t < 30) {
      MemoryLog::alarm(s, AlarmLevel::error, 52201, 0);
    }
  }
  const Section section = run(log, 20.5);
  const DataTable& line = table(section, "timeline");
  const auto rows = about(line, "error 52201");
  REQUIRE(rows.size() == 2);
  CHECK(text(line, rows[0], "new") == "raised");
  CHECK(text(line, rows[1], "new") == "cleared");
  CHECK(time_of(line, rows[1], "hull_from") == MemoryLog::micros(29.0));
  CHECK(time_of(line, rows[1], "t") == MemoryLog::micros(30.004));
  const DataTable& state = table(section, "state");
  CHECK(std::any_of(state.rows.begin(), state.rows.end(), [&](const std::vector<Value>& row) {
    const auto* value = std::get_if<std::string>(&row[column(state, "value")]);
    return value != nullptr && *value == "error 52201";
  }));
}

namespace {

/// An event of `source`, seen at `t_s`, half a second after the answer before.
Event seen_by(Source source, EventKind kind, double t_s, const char* now) {
  Event event;
  event.robot = 1;
  event.source = source;
  event.kind = kind;
  event.t_from_us = MemoryLog::micros(t_s - 0.5);
  event.t_us = MemoryLog::micros(t_s);
  event.new_value = now;
  return event;
}

}  // namespace

TEST_CASE("what two sources tell of the robot is one line that names both and both times") {
  MemoryLog log;
  log.add_robot("a");
  log.event(seen_by(Source::status, EventKind::emergency, 10.0, "true"));
  log.event(seen_by(Source::inputs, EventKind::emergency, 10.25, "true"));
  log.event(seen_by(Source::status, EventKind::emergency, 13.0, "false"));
  const Section section = run(log, 12.0);
  const DataTable& line = table(section, "timeline");
  const auto rows = about(line, "emergency");
  REQUIRE(rows.size() == 2);
  CHECK(text(line, rows[0], "source") == "status, inputs");
  CHECK(text(line, rows[0], "new") == "true");
  CHECK(text(line, rows[0], "detail") == "inputs 0.250 s later");
  CHECK(time_of(line, rows[0], "t") == MemoryLog::micros(10.0));
  CHECK(time_of(line, rows[0], "hull_from") == MemoryLog::micros(9.75));  // both are right: it happened in between
  CHECK(time_of(line, rows[0], "hull_to") == MemoryLog::micros(10.0));
  CHECK(text(line, rows[1], "source") == "status");
  CHECK(text(line, rows[1], "detail").empty());
}

TEST_CASE("a flag that flickers is paired edge by edge, and edges far apart stay apart") {
  MemoryLog log;
  log.add_robot("a");
  for (const double t : {10.0, 12.0}) {
    log.event(seen_by(Source::status, EventKind::blocked, t, "true"));
    log.event(seen_by(Source::inputs, EventKind::blocked, t + 0.2, "true"));
    log.event(seen_by(Source::status, EventKind::blocked, t + 1.0, "false"));
    log.event(seen_by(Source::inputs, EventKind::blocked, t + 1.2, "false"));
  }
  log.event(seen_by(Source::status, EventKind::blocked, 30.0, "true"));
  log.event(seen_by(Source::inputs, EventKind::blocked, 34.0, "true"));
  const Section section = run(log, 20.0);
  const DataTable& line = table(section, "timeline");
  const auto rows = about(line, "blocked");
  REQUIRE(rows.size() == 6);
  for (std::size_t i = 0; i < 4; ++i) {
    CHECK(text(line, rows[i], "source") == "status, inputs");
    CHECK(text(line, rows[i], "new") == (i % 2 == 0 ? "true" : "false"));
  }
  CHECK(text(line, rows[4], "source") == "status");
  CHECK(text(line, rows[5], "source") == "inputs");
}

TEST_CASE("lost links of two sources, and the same event of two robots, stay lines of their own") {
  MemoryLog log;
  log.add_robot("a");
  log.add_robot("b");
  log.event(seen_by(Source::status, EventKind::link_down, 10.0, "timeout"));
  log.event(seen_by(Source::inputs, EventKind::link_down, 10.1, "timeout"));
  log.event(seen_by(Source::status, EventKind::charging, 10.0, "true"));
  Event other = seen_by(Source::inputs, EventKind::charging, 10.1, "true");
  other.robot = 2;
  log.event(other);
  const Section section = run(log, 10.0);
  CHECK(about(table(section, "timeline"), "link_down").size() == 2);
  CHECK(about(table(section, "timeline"), "charging").size() == 2);
}
