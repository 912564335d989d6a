#include <algorithm>

#include "analyzer/analyses/analyses.hpp"
#include "tests/analyzer/section_text.hpp"
#include "tests/analyzer/simulated_log.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/memory_log.hpp"

using namespace tacho;
using test::MemoryLog;

namespace {

const Settings kSettings;

Section run(RowSource& log, const std::string& zone = "UTC") {
  return run_analysis(kAlarms, log, {}, Window{}, zone, kSettings);
}

double num(const Value& value) { return test::number(value); }

sim::Scenario noisy_robot(std::uint64_t seed) {
  sim::Scenario s = sim::busy_day(seed);
  for (sim::AlarmSpec& spec : s.alarms) {
    spec.per_hour *= 20;
    spec.min_gap_s = 8.0;
    spec.min_duration_s = 0.5;
    spec.mean_duration_s /= 4;
  }
  return s;
}

/// Checks an interval list against the truth and returns how many true alarms longer than two periods were matched.
std::size_t check_truth(const DataTable& intervals, const sim::Truth& truth, double period_s) {
  std::size_t matched = 0;
  std::vector<bool> used(intervals.rows.size(), false);
  for (const sim::TrueAlarm& alarm : truth.alarms) {
    std::size_t hits = 0;
    for (std::size_t r = 0; r < intervals.rows.size(); ++r) {
      const auto& row = intervals.rows[r];
      if (std::get<std::string>(row[test::column(intervals, "level")]) != alarm_level_name(alarm.level) ||
          std::get<std::int64_t>(row[test::column(intervals, "code")]) != alarm.code) {
        continue;
      }
      const Micros lo = test::time(row[test::column(intervals, "onset_lo")]).value_or(0);
      const Micros hi = test::time(row[test::column(intervals, "onset_hi")]).value();
      const Micros end_lo = test::time(row[test::column(intervals, "clear_lo")]).value();
      const std::optional<Micros> end_hi = test::time(row[test::column(intervals, "clear_hi")]);
      if (alarm.from_us >= lo && alarm.from_us <= hi && alarm.to_us >= end_lo && (!end_hi || alarm.to_us <= *end_hi)) {
        ++hits;
        used[r] = true;
      }
    }
    const double lasts_s = static_cast<double>(alarm.to_us - alarm.from_us) * 1e-6;
    if (lasts_s > 2.0 * period_s) {
      CHECK(hits == 1);
      ++matched;
    } else {
      CHECK(hits <= 1);
    }
  }
  CHECK(std::count(used.begin(), used.end(), false) == 0);  // no interval that is not a true alarm
  return matched;
}

}  // namespace

TEST_CASE("on a simulated log every alarm longer than two periods is counted once, its truth inside its bounds") {
  for (const double period_s : {1.0, 3.0}) {
    CAPTURE(period_s);
    test::SimulatedLog log(noisy_robot(5), period_s * 7'200.0, {{Source::status, period_s}});
    const Section section = run(log);
    CHECK(check_truth(test::table(section, "intervals"), log.truth(), period_s) > 50);
  }
}

TEST_CASE("a robot whose clock is wrong gets the same bounds") {
  sim::Scenario scenario = noisy_robot(6);
  scenario.clock_offset_s = -1'234.5;
  test::SimulatedLog log(scenario, 3'600.0, {{Source::status, 2.0}});
  const Section section = run(log);
  const DataTable& intervals = test::table(section, "intervals");
  CHECK(check_truth(intervals, log.truth(), 2.0) > 20);
  std::size_t stamped = 0;
  for (const auto& row : intervals.rows) {
    stamped += std::get<bool>(row[test::column(intervals, "stamped")]) ? 1u : 0u;
  }
  CHECK(stamped * 10 > intervals.rows.size() * 9);
}

TEST_CASE("gaps leave truth inside the bounds and take their time out of the exposure") {
  test::SimulatedLog log(noisy_robot(7), 7'200.0, {{Source::status, 1.0}});
  log.lose(1'000.0, 1'900.0);
  log.lose(4'000.0, 4'030.0);
  const Section section = run(log);
  const DataTable& summary = test::table(section, "summary");
  CHECK(num(test::cell(summary, 1, "observed")) == Approx((7'199.0 - 901.0 - 31.0) / 3'600.0).epsilon(1e-6));
  const DataTable& intervals = test::table(section, "intervals");
  for (const auto& row : intervals.rows) {
    const Micros hi = test::time(row[test::column(intervals, "onset_hi")]).value();
    const Micros lo = test::time(row[test::column(intervals, "onset_lo")]).value_or(0);
    const auto& code = std::get<std::int64_t>(row[test::column(intervals, "code")]);
    const bool true_onset = std::any_of(log.truth().alarms.begin(), log.truth().alarms.end(), [&](const auto& alarm) {
      return alarm.code == code && alarm.from_us >= lo && alarm.from_us <= hi;
    });
    CHECK(true_onset);
  }
}

TEST_CASE("a robot read by Modbus only gets alarms from its registers, marked where the set was full") {
  test::SimulatedLog log(noisy_robot(8), 3'600.0, {{Source::registers, 1.0}, {Source::inputs, 1.0}});
  const Section section = run(log);
  const DataTable& intervals = test::table(section, "intervals");
  REQUIRE(intervals.rows.size() > 20);
  for (const auto& row : intervals.rows) {
    CHECK(std::get<std::string>(row[test::column(intervals, "level")]) != "notice");
    const Micros lo = test::time(row[test::column(intervals, "onset_lo")]).value_or(0);
    const Micros hi = test::time(row[test::column(intervals, "onset_hi")]).value();
    const auto& code = std::get<std::int64_t>(row[test::column(intervals, "code")]);
    CHECK(std::any_of(log.truth().alarms.begin(), log.truth().alarms.end(), [&](const auto& alarm) {
      return alarm.code == code && alarm.from_us >= lo && alarm.from_us <= hi;
    }));
  }
  CHECK(test::has_note(section, "registers show the first code"));
  for (const Evidence& e : test::finding(section, "ALM-01", "").evidence) {
    CHECK(e.source == "registers");
  }
}

TEST_CASE("how rows are cut into slices does not change a byte of the result") {
  const auto text = [](std::size_t rows) {
    test::SimulatedLog log(noisy_robot(9), 1'800.0,
                           {{Source::status, 1.0}, {Source::registers, 2.0}, {Source::inputs, 0.5}});
    log.lose(600.0, 700.0);
    log.slice_rows(rows);
    return test::text(run(log, "Europe/Berlin"));
  };
  const std::string whole = text(1'000'000);
  CHECK(whole == text(1));
  CHECK(whole == text(37));
  CHECK(whole.size() > 10'000);
}

TEST_CASE("rates divide raises by the observed hours and carry Garwood limits") {
  MemoryLog log;
  const RobotId robot = log.add_robot("amr-1");
  log.period(robot, Source::status, 10.0);
  for (int k = 0; k <= 1'440; ++k) {  // four hours, an alarm in every half hour
    Sample& row = log.row(robot, Source::status, 10.0 * k);
    MemoryLog::no_alarms(row);
    MemoryLog::set(row, "odo", 1'000.0 + 5.0 * k);
    if (k % 180 == 90) {
      MemoryLog::alarm(row, AlarmLevel::error, 52200, 0);
    }
  }
  const Section section = run(log);
  const DataTable& summary = test::table(section, "summary");
  const auto& rate = std::get<Quantity>(test::cell(summary, 1, "per_hour"));
  CHECK(rate.value.value() == Approx(8.0 / 4.0));
  CHECK(rate.lo.value() == Approx(3.4538 / 4.0).epsilon(1e-4));
  CHECK(rate.hi.value() == Approx(15.7632 / 4.0).epsilon(1e-4));
  CHECK(std::get<Quantity>(test::cell(summary, 1, "per_100km")).value.value() == Approx(8.0 / 0.072));
  CHECK(num(test::cell(summary, 1, "bins_10min")) == 24);
  CHECK(num(test::cell(summary, 1, "max_10min")) == 1);
  CHECK(test::finding(section, "ALM-01", "amr-1").verdict == Verdict::pass);
  CHECK(test::finding(section, "ALM-01", "").verdict == Verdict::pass);
  CHECK(test::finding(section, "ALM-03", "amr-1").verdict == Verdict::unknown);  // 10 s polls miss most chatter
  CHECK(test::finding(section, "ALM-04", "amr-1").verdict == Verdict::unknown);  // four hours cannot show a day
}

TEST_CASE("no alarm at all gives an upper limit and never a made-up rate") {
  MemoryLog log;
  const RobotId robot = log.add_robot("amr-1");
  for (int k = 0; k <= 3'600; k += 4) {
    MemoryLog::no_alarms(log.row(robot, Source::status, k));
  }
  log.period(robot, Source::status, 4.0);
  const Section section = run(log);
  const Quantity rate = test::finding(section, "ALM-01", "amr-1").value;
  CHECK(rate.value.value() == 0.0);
  CHECK(rate.hi.value() == Approx(3.6889).epsilon(1e-4));
  CHECK(rate.reason.find("3.69") != std::string::npos);
  CHECK(test::finding(section, "ALM-03", "amr-1").verdict == Verdict::pass);
  CHECK(test::finding(section, "ALM-01", "amr-1").verdict == Verdict::pass);
}

TEST_CASE("stopped time goes to the alarms that stood while a task ran and the robot did not move") {
  MemoryLog log;
  const RobotId robot = log.add_robot("amr-1");
  log.period(robot, Source::status, 1.0);
  for (int k = 0; k <= 7'200; ++k) {
    Sample& row = log.row(robot, Source::status, k);
    MemoryLog::no_alarms(row);
    MemoryLog::set_int(row, "task_status", 2);
    const bool stop = k % 1'200 >= 600 && k % 1'200 < 660;
    MemoryLog::set_int(row, "is_stop", stop ? 1 : 0);
    if (stop) {
      MemoryLog::alarm(row, AlarmLevel::error, 52200, 0);
    }
    if (k % 1'200 >= 630 && k % 1'200 < 700) {
      MemoryLog::alarm(row, AlarmLevel::warning, 54018, 0);
    }
  }
  const Section section = run(log);
  const DataTable& codes = test::table(section, "by_code");
  REQUIRE(codes.rows.size() == 2);
  const double six = 6.0;
  for (std::size_t r = 0; r < 2; ++r) {
    const bool error = std::get<std::int64_t>(test::cell(codes, r, "code")) == 52200;
    // 30 s alone, 30 s shared; the half pauses at the ends of the stop cancel out.
    CHECK(num(test::cell(codes, r, "stopped_s")) == Approx(six * (error ? 45.0 : 15.0)).margin(six));
    CHECK(num(test::cell(codes, r, "stopped_first_s")) == Approx(six * (error ? 60.0 : 0.0)).margin(six));
    CHECK(num(test::cell(codes, r, "active")) == Approx(six * (error ? 60.0 : 70.0)).margin(0.1));
  }
  const DataTable& stops = test::table(section, "availability");
  CHECK(num(test::cell(stops, 0, "stops")) == 6);
  CHECK(num(test::cell(stops, 0, "down_h")) == Approx(360.0 / 3'600.0));
  CHECK(num(test::cell(stops, 0, "task_h")) == Approx(2.0));
  CHECK(num(test::cell(stops, 0, "mttr")) == Approx(60.0).margin(0.01));
  const double mtbf_h = num(test::cell(stops, 0, "mtbf"));
  const double mttr_h = num(test::cell(stops, 0, "mttr")) / 3'600.0;
  CHECK(mtbf_h / (mtbf_h + mttr_h) == Approx(num(test::cell(stops, 0, "availability"))).epsilon(1e-4));
}

TEST_CASE("time in which the recorder was off is no active time, but may be: it is in the upper limit, once") {
  struct Case {
    const char* what;
    std::int64_t stamp_before, stamp_after;
    bool before, after;
    double active_s, upper_s;
  };
  const double gap_s = 10'000.0;
  const auto unix_s = [](double t_s) { return MemoryLog::micros(t_s) / 1'000'000; };
  for (const Case& c :
       {Case{"gone afterwards", 0, 0, true, false, 100.0, 100.0 + gap_s},
        Case{"there only afterwards", 0, 0, false, true, 100.0, 100.0 + gap_s},
        Case{"there again, without a stamp", 0, 0, true, true, 200.0, 200.0 + gap_s},
        Case{"another one", unix_s(900), unix_s(10'900), true, true, 200.0, 200.0 + gap_s},
        Case{"proven by its stamp", unix_s(900), unix_s(900), true, true, 200.0 + gap_s, 200.0 + gap_s}}) {
    MemoryLog log;
    const RobotId robot = log.add_robot("amr-1");
    log.period(robot, Source::status, 1.0);
    for (int k = 0; k < 2'000; ++k) {  // on for 1000 s, off for 10000 s, on for 1000 s
      const bool off_before = k >= 1'000;
      Sample& row = log.row(robot, Source::status, k + (off_before ? gap_s - 1.0 : 0.0));
      MemoryLog::no_alarms(row);
      if (off_before ? c.after && k < 1'101 : c.before && k >= 900) {
        MemoryLog::alarm(row, AlarmLevel::error, 52200, off_before ? c.stamp_after : c.stamp_before);
      }
    }
    INFO(c.what);
    const Section section = run(log);
    const auto active = std::get<Quantity>(test::cell(test::table(section, "by_code"), 0, "active"));
    CHECK(active.value.value() == Approx(c.active_s).margin(2.0));
    CHECK(active.lo.value() <= c.active_s + 0.1);
    CHECK(active.lo.value() >= c.active_s - 4.0);
    CHECK(active.hi.value() == Approx(c.upper_s).margin(4.0));
    CHECK(num(test::cell(test::table(section, "pareto_active"), 0, "value")) == active.value.value());
    CHECK(test::has_note(section, "recorder off"));
    double surely_s = 0.0;
    for (const auto& row : test::table(section, "intervals").rows) {
      surely_s += num(row[test::column(test::table(section, "intervals"), "duration_lo_s")]);
    }
    CHECK(surely_s <= c.active_s + 0.1);
  }
}

TEST_CASE("a flood of two robots is seen by the operator before either robot has one") {
  MemoryLog log;
  const RobotId a = log.add_robot("amr-1");
  const RobotId b = log.add_robot("amr-2");
  for (const RobotId robot : {a, b}) {
    log.period(robot, Source::status, 1.0);
    for (int k = 0; k <= 3'600; ++k) {
      Sample& row = log.row(robot, Source::status, k);
      MemoryLog::no_alarms(row);
      if (k >= 1'000 && k < 1'400 && k % 50 < 10) {  // eight raises each
        MemoryLog::alarm(row, AlarmLevel::warning, 54'000 + k / 50, 0);
      }
    }
  }
  const Section section = run(log);
  const DataTable& floods = test::table(section, "floods");
  REQUIRE(floods.rows.size() == 1);
  CHECK(std::get<std::string>(floods.rows[0][0]) == "all");
  CHECK(test::finding(section, "ALM-02", "").verdict == Verdict::unknown);  // an hour is too short to tell a share
  CHECK(test::finding(section, "ALM-02", "").value.value.value() > 5.0);
  const DataTable& summary = test::table(section, "summary");
  CHECK(num(test::cell(summary, 0, "raises")) == 16);
  CHECK(num(test::cell(summary, 0, "observed")) == Approx(1.0));
  CHECK(num(test::cell(summary, 1, "raises")) == 8);
  const DataTable& codes = test::table(section, "by_code");
  REQUIRE(codes.rows.size() == 8);
  CHECK(num(test::cell(codes, 0, "raises")) == 2);
  CHECK(num(test::cell(codes, 0, "robots")) == 2);
  CHECK(std::get<Quantity>(test::cell(codes, 0, "per_hour")).exposure.value() == Approx(2.0));
  CHECK(test::table(section, "by_robot_code").rows.size() == 16);
}

TEST_CASE("a code that comes three times a minute chatters, one that stands for two days is stale") {
  MemoryLog log;
  const RobotId robot = log.add_robot("amr-1");
  log.period(robot, Source::status, 20.0);
  for (int k = 0; k < 9'000; ++k) {  // 50 hours
    Sample& row = log.row(robot, Source::status, 20.0 * k);
    MemoryLog::no_alarms(row);
    if (k > 10) {
      MemoryLog::alarm(row, AlarmLevel::notice, 57'002, 0);
    }
  }
  const Section slow = run(log);
  CHECK(test::finding(slow, "ALM-03", "amr-1").verdict == Verdict::unknown);  // 20 s polls cannot show it
  CHECK(test::finding(slow, "ALM-04", "amr-1").verdict == Verdict::pass);     // one is fewer than five
  CHECK(test::finding(slow, "ALM-04", "amr-1").value.value.value() == 1.0);
  const DataTable& standing = test::table(slow, "standing");
  REQUIRE(standing.rows.size() == 1);
  CHECK(std::get<bool>(test::cell(standing, 0, "stale")));

  MemoryLog fast;
  const RobotId second = fast.add_robot("amr-1");
  fast.period(second, Source::status, 1.0);
  for (int k = 0; k < 4'000; ++k) {
    Sample& row = fast.row(second, Source::status, k);
    MemoryLog::no_alarms(row);
    if (k > 100 && k < 160 && k % 10 < 5) {
      MemoryLog::alarm(row, AlarmLevel::warning, 54'018, 0);
    }
  }
  const Section chatter = run(fast);
  CHECK(test::finding(chatter, "ALM-03", "amr-1").verdict == Verdict::warn);
  CHECK(test::table(chatter, "chattering").rows.size() == 1);
}

TEST_CASE("what the log cannot tell is unknown, with the reason") {
  MemoryLog empty;
  Section section = run(empty);
  CHECK(test::finding(section, "ALM-01", "").verdict == Verdict::unknown);
  CHECK(test::finding(section, "ALM-01", "").value.reason.find("no robot") != std::string::npos);

  MemoryLog without;
  const RobotId robot = without.add_robot("amr-1");
  for (int k = 0; k < 100; ++k) {
    MemoryLog::set(without.row(robot, Source::status, k), "x", 1.0);
  }
  section = run(without);
  CHECK(test::finding(section, "ALM-02", "amr-1").verdict == Verdict::unknown);
  CHECK(test::finding(section, "ALM-02", "amr-1").value.reason.find("fatals") != std::string::npos);
  CHECK_FALSE(test::finding(section, "ALM-02", "amr-1").value.value.has_value());

  MemoryLog one;
  const RobotId single = one.add_robot("amr-1");
  MemoryLog::alarm(one.row(single, Source::status, 0), AlarmLevel::error, 1, 5);
  section = run(one);
  CHECK(test::finding(section, "ALM-01", "amr-1").verdict == Verdict::unknown);
  CHECK_FALSE(test::finding(section, "ALM-01", "amr-1").value.value.has_value());
  CHECK(test::table(section, "intervals").rows.size() == 1);
}

TEST_CASE("a level whose array is never in the answers has no rate, the others have theirs") {
  MemoryLog log;
  const RobotId robot = log.add_robot("amr-1");
  for (int k = 0; k < 100; ++k) {
    Sample& row = log.row(robot, Source::status, k);
    MemoryLog::set_int(row, "errors", 0);
    MemoryLog::set_state(row, "notices", State::null);
  }
  const DataTable levels = test::table(run(log), "by_level");
  CHECK(std::get<Quantity>(test::cell(levels, 1, "per_hour")).value.has_value());
  CHECK_FALSE(std::get<Quantity>(test::cell(levels, 0, "per_hour")).value.has_value());
  CHECK(std::holds_alternative<Missing>(test::cell(levels, 3, "raises")));
}

TEST_CASE("an alarm that cannot be read in one answer goes on, and one that comes after it may be older") {
  MemoryLog log;
  const RobotId robot = log.add_robot("a");
  log.period(robot, Source::status, 1.0);
  for (int t = 0; t < 60; ++t) {
    Sample& s = log.row(robot, Source::status, t);
    MemoryLog::no_alarms(s);
    const bool odd = t == 20 || t == 40;
    s.alarms_incomplete.set(static_cast<std::size_t>(AlarmLevel::error), odd);
    if (t >= 10 && t < 30 && !odd) {
      MemoryLog::alarm(s, AlarmLevel::error, 52201, 0);
    }
    if (t >= 41) {
      MemoryLog::alarm(s, AlarmLevel::error, 52202, 0);
    }
  }
  const Section section = run(log);
  const DataTable& intervals = test::table(section, "intervals");
  REQUIRE(intervals.rows.size() == 2);
  const auto at = [&](std::size_t row, const char* name) { return test::time(test::cell(intervals, row, name)); };
  CHECK(at(0, "clear_lo") == MemoryLog::micros(29.0));
  CHECK(at(0, "clear_hi") == MemoryLog::micros(30.004));
  CHECK(std::get<bool>(test::cell(intervals, 0, "censored_set")));
  CHECK(at(1, "onset_lo") == MemoryLog::micros(39.0));
}

TEST_CASE("one minute of record gives a rate but no verdict on it, and evidence inside the record") {
  MemoryLog log;
  const RobotId robot = log.add_robot("amr-1");
  log.period(robot, Source::status, 1.0);
  for (int k = 0; k < 60; ++k) {
    Sample& row = log.row(robot, Source::status, 310.0 + k);
    MemoryLog::no_alarms(row);
    if (k % 15 > 10) {
      MemoryLog::alarm(row, AlarmLevel::error, 52'200, 0);
    }
  }
  for (const char* name : {"", "amr-1"}) {
    const Finding rate = test::finding(run(log), "ALM-01", name);
    CHECK(rate.verdict == Verdict::unknown);
    CHECK(rate.value.value.value() > 200.0);
    CHECK(rate.value.reason == "0.016 h observed, 1 h needed");
    CHECK(rate.advice == "record for at least 1 h");
    REQUIRE(rate.evidence.size() == 1);
    CHECK(rate.evidence[0].from_us >= MemoryLog::micros(310.0));
    CHECK(rate.evidence[0].to_us <= MemoryLog::micros(370.0));
  }
}

TEST_CASE("the advice for chattering names what is missing: hours, faster polls, or both") {
  const auto advice = [](double period_s, int polls) {
    MemoryLog log;
    const RobotId robot = log.add_robot("amr-1");
    log.period(robot, Source::status, period_s);
    for (int k = 0; k < polls; ++k) {
      MemoryLog::no_alarms(log.row(robot, Source::status, period_s * k));
    }
    return test::finding(run(log), "ALM-03", "amr-1").advice;
  };
  CHECK(advice(1.0, 60) == "record for at least 1 h");
  CHECK(advice(20.0, 1'000).starts_with("poll status at least every "));
  CHECK(advice(20.0, 10).starts_with("record for at least 1 h, and poll status"));
}
