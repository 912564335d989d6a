// What goes wrong with batteries, chargers and their fields, and logs that cannot decide.

#include "tests/analyzer/battery_robot.hpp"
#include "tests/support/catch.hpp"

using namespace tacho;
using namespace tacho::test;

namespace {

/// A robot told what to say second by second; one row per 10 s.
struct Told {
  double soc = 0.6;
  double current = -5.0;
  int charging = 0;
  int docked = 0;
  int standing = 0;
  int task = 2;
  int emergency = 0;
  int errors = 0;
  double temp = 25.0;
  int counter = 50;
};

GeneratedLog told(double hours, std::function<void(double t_s, Told&)> story) {
  return GeneratedLog(hours * 3600, 10, [story = std::move(story)] {
    return [story](Micros t_us, Sample& sample) {
      Told now;
      story(static_cast<double>(t_us - MemoryLog::micros(0)) * 1e-6, now);
      MemoryLog::set(sample, "battery_level", now.soc);
      MemoryLog::set(sample, "current", now.current);
      MemoryLog::set(sample, "voltage", 48.0);
      MemoryLog::set(sample, "battery_temp", now.temp);
      MemoryLog::set_int(sample, "battery_cycle", now.counter);
      MemoryLog::set_int(sample, "charging", now.charging);
      MemoryLog::set_int(sample, "auto_charge", now.docked);
      MemoryLog::set_int(sample, "is_stop", now.standing);
      MemoryLog::set_int(sample, "task_status", now.task);
      MemoryLog::set_int(sample, "emergency", now.emergency);
      MemoryLog::set_int(sample, "errors", now.errors);
      MemoryLog::set_text(sample, "current_station", now.docked == 1 ? "CP1" : "");
    };
  });
}

bool during(double t, double from, double to) { return t >= from && t < to; }

/// Charging with SoC rising from `from_s` to `to_s`.
void charge(double t, double from_s, double to_s, Told& now) {
  if (during(t, from_s, to_s)) {
    now.current = 20.0;
    now.charging = now.docked = now.standing = 1;
    now.task = 0;
  }
  now.soc = 0.5 - 1e-5 * std::min(t, from_s) + 1.4e-4 * std::clamp(t - from_s, 0.0, to_s - from_s) -
            1e-5 * std::max(0.0, t - to_s);
}

const DataTable& sessions(const Section& section) { return table(section, "charge_sessions"); }

std::string end_reason(std::function<void(double, Told&)> after) {
  GeneratedLog log = told(2, [after](double t, Told& now) {
    charge(t, 1'000, 3'000, now);
    after(t, now);
  });
  const Section section = run_battery(log);
  REQUIRE(sessions(section).rows.size() == 1);
  return std::get<std::string>(cell(sessions(section), 0, "end_reason"));
}

void all_unknown(const Section& section) {
  REQUIRE(section.findings.size() == 5);
  for (const Finding& f : section.findings) {
    INFO(f.id);
    CHECK(f.verdict == Verdict::unknown);
    CHECK_FALSE(f.value.value);
    CHECK_FALSE(f.value.reason.empty());
    CHECK_FALSE(f.advice.empty());
  }
}

}  // namespace

TEST_CASE("a log without robots, without rows or without battery fields is unknown, not a number") {
  MemoryLog nothing;
  all_unknown(run_battery(nothing));

  MemoryLog empty;
  empty.add_robot("amr");
  all_unknown(run_battery(empty));

  MemoryLog bare;
  const RobotId id = bare.add_robot("amr");
  for (int i = 0; i < 50; ++i) {
    Sample& row = bare.row(id, Source::status, i);
    MemoryLog::set(row, "vx", 0.5);
  }
  const Section section = run_battery(bare);
  all_unknown(section);
  CHECK(finding(section, "BAT-04", "amr").value.reason == "battery_level is in no answer of this log");
  CHECK(section.series.empty());

  MemoryLog flag_only;
  const RobotId other = flag_only.add_robot("amr");
  for (int i = 0; i < 50; ++i) {
    MemoryLog::set_int(flag_only.row(other, Source::status, i), "charging", 0);
  }
  const Section flagged = run_battery(flag_only);
  all_unknown(flagged);
  const DataTable& fields = table(flagged, "battery_fields");
  CHECK(number(cell(fields, 3, "given")) == 100.0);
}

TEST_CASE("one snapshot gives its reading and no rates") {
  MemoryLog log;
  Sample& row = log.row(log.add_robot("amr"), Source::status, 0);
  MemoryLog::set(row, "battery_level", 0.55);
  MemoryLog::set(row, "current", -3.0);
  MemoryLog::set_int(row, "charging", 0);
  const Section section = run_battery(log);
  CHECK(*measure(section, "usage", "lowest SoC").value == Approx(55));
  CHECK_FALSE(measure(section, "usage", "time above 90 % SoC").value);
  CHECK_FALSE(quantity(section, "throughput", "discharged").value);
  CHECK_FALSE(quantity(section, "throughput", "coulomb_efficiency").value);
  CHECK(*quantity(section, "equivalent_full_cycles", "efc").value == 0.0);
  CHECK(finding(section, "BAT-07", "amr").verdict == Verdict::unknown);
  CHECK(sessions(section).rows.empty());
}

TEST_CASE("values that are 0 in the whole record are not supplied") {
  GeneratedLog log = told(2, [](double, Told& now) {
    now.soc = now.current = now.temp = 0.0;
    now.counter = 0;
  });
  const Section section = run_battery(log);
  CHECK(finding(section, "BAT-06", "amr").value.reason == "battery_temp is 0 in the whole record: not supplied");
  CHECK(finding(section, "BAT-04", "amr").value.reason == "battery_level is 0 in the whole record: not supplied");
  CHECK_FALSE(quantity(section, "equivalent_full_cycles", "efc").value);
  CHECK_FALSE(quantity(section, "throughput", "charged").value);
  CHECK(table(section, "temperature").rows.empty());
  CHECK(std::get<std::string>(cell(table(section, "cycle_counter"), 0, "class")) == "not supplied");
}

TEST_CASE("voltages of 0 and levels beyond 0..1 are not used") {
  MemoryLog log;
  const RobotId id = log.add_robot("amr");
  for (int i = 0; i < 100; ++i) {
    Sample& row = log.row(id, Source::status, i);
    MemoryLog::set(row, "battery_level", i % 2 == 0 ? 0.5 : 82.0);
    MemoryLog::set(row, "voltage", 0.0);
    MemoryLog::set(row, "current", i == 50 ? std::nan("") : -2.0);
  }
  const Section section = run_battery(log);
  CHECK(*measure(section, "usage", "highest SoC").value == Approx(50));
  CHECK(std::holds_alternative<Missing>(cell(table(section, "throughput"), 0, "discharged_wh")));
  CHECK(*quantity(section, "throughput", "discharged").value == Approx(2.0 * 99 / 3600).epsilon(1e-6));
}

TEST_CASE("the end of a charge has its reason") {
  CHECK(end_reason([](double, Told&) {}) == "task");
  CHECK(end_reason([](double, Told& now) { now.task = 0, now.standing = 1; }) == "unplugged");
  CHECK(end_reason([](double, Told& now) { now.task = 0, now.standing = 1, now.docked = 1; }) == "not known");
  CHECK(end_reason([](double t, Told& now) { now.errors = during(t, 2'990, 3'100) ? 1 : 0; }) == "alarm");
  CHECK(end_reason([](double t, Told& now) { now.emergency = during(t, 2'990, 3'100) ? 1 : 0; }) == "emergency");
  CHECK(end_reason([](double, Told& now) { now.soc = std::min(1.0, now.soc + 0.25); }) == "full");
}

TEST_CASE("a session that the log cuts is not whole") {
  GeneratedLog open = told(2, [](double t, Told& now) { charge(t, 5'000, 99'999, now); });
  const Section at_end = run_battery(open);
  REQUIRE(sessions(at_end).rows.size() == 1);
  CHECK(std::get<std::string>(cell(sessions(at_end), 0, "end_reason")) == "end of record");
  CHECK_FALSE(std::get<bool>(cell(sessions(at_end), 0, "whole")));

  GeneratedLog begun = told(2, [](double t, Told& now) { charge(t, 0, 3'000, now); });
  CHECK_FALSE(std::get<bool>(cell(sessions(run_battery(begun)), 0, "whole")));

  GeneratedLog cut = told(3, [](double t, Told& now) { charge(t, 1'000, 6'000, now); });
  cut.lose(2'000, 3'000);
  const Section joined = run_battery(cut);
  REQUIRE(sessions(joined).rows.size() == 1);
  CHECK_FALSE(std::get<bool>(cell(sessions(joined), 0, "whole")));

  GeneratedLog lost = told(3, [](double t, Told& now) { charge(t, 1'000, 6'000, now); });
  lost.lose(2'000, 7'000);
  CHECK(std::get<std::string>(cell(sessions(run_battery(lost)), 0, "end_reason")) == "gap");
}

TEST_CASE("short pulses of current into the battery are no charge") {
  GeneratedLog log = told(2, [](double t, Told& now) {
    now.soc = 0.6 - 1e-5 * t;
    now.current = during(std::fmod(t, 300), 0, 20) ? 6.0 : -6.0;  // braking
  });
  const Section section = run_battery(log);
  CHECK(sessions(section).rows.empty());
  CHECK(finding(section, "BAT-07", "amr").verdict == Verdict::pass);
}

TEST_CASE("a flag that flickers is one session") {
  GeneratedLog log = told(2, [](double t, Told& now) {
    charge(t, 1'000, 3'000, now);
    if (during(t, 2'000, 2'020)) {
      now.charging = 0;
      now.current = 0.0;
    }
  });
  CHECK(sessions(run_battery(log)).rows.size() == 1);
}

TEST_CASE("charging without current is a failed charge, with its place and time") {
  GeneratedLog log = told(6, [](double t, Told& now) {
    now.soc = 0.5;
    const double within = std::fmod(t, 3'600);
    if (during(within, 1'000, 1'300)) {
      now.current = -1.2;
      now.charging = now.docked = now.standing = 1;
      now.task = 0;
    }
  });
  const Section section = run_battery(log);
  const Finding& f = finding(section, "BAT-05", "amr");
  CHECK(f.verdict == Verdict::fail);
  CHECK(*f.value.value == 6);
  REQUIRE(f.evidence.size() == 6);
  CHECK(f.evidence[0].from_us == MemoryLog::micros(1'000));
  CHECK(f.evidence[0].note.find("CP1") != std::string::npos);
  CHECK(table(section, "failed_charges").rows.size() == 6);
}

TEST_CASE("standing on the dock without charging is a failed charge, resting there after one is not") {
  GeneratedLog docked = told(2, [](double t, Told& now) {
    now.soc = 0.5;
    now.current = -1.2;
    now.docked = during(t, 1'000, 1'500) ? 1 : 0;
  });
  const Finding failed = finding(run_battery(docked), "BAT-05", "amr");
  CHECK(failed.verdict == Verdict::warn);
  CHECK(*failed.value.value == 1);

  GeneratedLog rested = told(2, [](double t, Told& now) {
    charge(t, 1'000, 3'000, now);
    now.docked = during(t, 1'000, 5'000) ? 1 : 0;
  });
  CHECK(finding(run_battery(rested), "BAT-05", "amr").verdict == Verdict::pass);
}

TEST_CASE("a full battery that takes no current has not failed to charge") {
  GeneratedLog log = told(2, [](double t, Told& now) {
    now.soc = 0.99;
    now.current = -0.1;
    now.charging = now.docked = during(t, 1'000, 5'000) ? 1 : 0;
  });
  CHECK(finding(run_battery(log), "BAT-05", "amr").verdict == Verdict::pass);
}

TEST_CASE("a flag that contradicts the current is found either way") {
  GeneratedLog on = told(3, [](double t, Told& now) {
    charge(t, 1'000, 3'000, now);
    if (during(t, 5'000, 9'000)) {
      now.charging = 1;
      now.current = -1.353;
    }
  });
  const Finding f = finding(run_battery(on), "BAT-07", "amr");
  CHECK(f.verdict == Verdict::fail);
  REQUIRE(f.evidence.size() == 1);
  CHECK(f.evidence[0].from_us == MemoryLog::micros(5'000));
  CHECK(f.evidence[0].note == "charging is on while the battery is discharged");

  GeneratedLog off = told(3, [](double t, Told& now) {
    charge(t, 1'000, 3'000, now);
    now.charging = 0;
  });
  const Section section = run_battery(off);
  CHECK(finding(section, "BAT-07", "amr").evidence.at(0).note == "charging is off while current flows in");
  CHECK(sessions(section).rows.size() == 1);
}

TEST_CASE("deep discharge and heat are found with their times") {
  GeneratedLog deep = told(3, [](double t, Told& now) { now.soc = 0.2501 - 2e-5 * t; });
  const Finding low = finding(run_battery(deep), "BAT-04", "amr");
  CHECK(low.verdict == Verdict::fail);
  CHECK(*low.value.value == Approx(3.42).margin(0.05));
  CHECK(low.title == "Lowest state of charge");  // what the value is
  CHECK(low.threshold == "PASS when it never fell below 20 %, FAIL when it fell below 10 % (deep discharge)");
  CHECK(low.advice.find("before it is down to 20 %") != std::string::npos);
  CHECK(low.evidence.at(0).from_us == MemoryLog::micros(7'510));

  GeneratedLog hot = told(3, [](double t, Told& now) { now.temp = during(t, 4'000, 4'200) ? 57 : 30; });
  const Finding heat = finding(run_battery(hot), "BAT-06", "amr");
  CHECK(heat.verdict == Verdict::fail);
  CHECK(*heat.value.value == 57);
  GeneratedLog spike = told(3, [](double t, Told& now) { now.temp = during(t, 4'000, 4'020) ? 57 : 30; });
  CHECK(finding(run_battery(spike), "BAT-06", "amr").verdict == Verdict::pass);
  GeneratedLog cold = told(3, [](double, Told& now) { now.temp = -5; });
  CHECK(finding(run_battery(cold), "BAT-06", "amr").verdict == Verdict::warn);
}

TEST_CASE("a reading that may lie on either side of a threshold warns, it does not fail") {
  GeneratedLog log = told(2, [](double t, Told& now) { now.soc = std::round(50 - t / 180) / 100; });
  Settings settings;
  settings.set("battery.deep_soc", 0.103, "test");
  const Finding f = finding(run_battery(log, settings), "BAT-04", "amr");
  CHECK(*f.value.value == Approx(10));
  CHECK(*f.value.hi == Approx(10.5));
  CHECK(f.verdict == Verdict::warn);
}

TEST_CASE("thresholds come from the settings and say so") {
  GeneratedLog log = told(3, [](double t, Told& now) { now.soc = 0.5 - 1e-5 * t; });
  Settings settings;
  settings.set("battery.deep_soc", 0.45, "site.toml:3");
  settings.set("battery.low_soc", 0.48, "site.toml:4");
  const Finding f = finding(run_battery(log, settings), "BAT-04", "amr");
  CHECK(f.verdict == Verdict::fail);
  CHECK(f.threshold == "PASS when it never fell below 48 %, FAIL when it fell below 45 % (deep discharge)");
  CHECK(f.threshold_source == "site.toml:4, site.toml:3");
}

TEST_CASE("a counter that falls for good is another pack, a glitch is not") {
  GeneratedLog changed = told(8, [](double t, Told& now) {
    now.soc = 0.9 - 2e-5 * std::fmod(t, 14'400);
    now.counter = t < 14'400 ? 122 : 3;
  });
  const Section two = run_battery(changed);
  CHECK(table(two, "equivalent_full_cycles").rows.size() == 2);
  CHECK(table(two, "trends").rows.size() == 6);
  CHECK(has_note(two, "2 battery packs"));

  GeneratedLog glitch = told(8, [](double t, Told& now) {
    now.soc = 0.9 - 2e-5 * std::fmod(t, 14'400);
    now.counter = during(t, 5'000, 5'020) ? 1 : 122;
  });
  const Section one = run_battery(glitch);
  CHECK(table(one, "equivalent_full_cycles").rows.size() == 1);
  CHECK(std::get<std::string>(cell(table(one, "cycle_counter"), 0, "class")) == "erratic");
  CHECK(finding(one, "BAT-03", "amr").verdict == Verdict::warn);
}

TEST_CASE("a counter that stands still while the battery cycles is frozen") {
  Sawtooth s;
  s.count_share = 1e9;
  SawtoothLog saw(s, 4, 30);
  const Section section = run_battery(saw.log);
  CHECK(std::get<std::string>(cell(table(section, "cycle_counter"), 0, "class")) == "frozen");
  CHECK(finding(section, "BAT-03", "amr").verdict == Verdict::warn);
}

TEST_CASE("a field that falls silent is named") {
  GeneratedLog log(86'400, 10, [] {
    return [](Micros t_us, Sample& sample) {
      const double t = static_cast<double>(t_us - MemoryLog::micros(0)) * 1e-6;
      MemoryLog::set(sample, "battery_level", 0.5);
      MemoryLog::set(sample, "current", -2.0);
      if (t < 20'000) {
        MemoryLog::set(sample, "battery_temp", 25.0);
      }
    };
  });
  const DataTable t = table(run_battery(log), "battery_fields");
  for (std::size_t i = 0; i < t.rows.size(); ++i) {
    const std::string name = std::get<std::string>(cell(t, i, "field"));
    const std::string remark = std::get<std::string>(cell(t, i, "remark"));
    CHECK(remark == (name == "battery_temp"                         ? "silent: not given any more"
                     : name == "battery_level" || name == "current" ? ""
                                                                    : name + " is in no answer of this log"));
  }
}

TEST_CASE("habits: pauses without charging and weeks without a full charge are shown") {
  GeneratedLog log = told(24 * 16, [](double t, Told& now) {
    now.soc = 0.6 - 0.1 * std::sin(t / 20'000);
    const bool idle = during(std::fmod(t, 7'200), 0, 1'800);
    now.standing = idle ? 1 : 0;
    now.task = idle ? 4 : 2;
  });
  const Section section = run_battery(log);
  CHECK(*measure(section, "habits", "longest time without a full charge").value == Approx(16).margin(0.01));
  CHECK(*measure(section, "habits", "missed charging").value == Approx(16 * 12 * 0.5).epsilon(0.02));
}

TEST_CASE("registers and inputs alone are enough, in whole percents") {
  MemoryLog log;
  const RobotId id = log.add_robot("amr");
  Sawtooth s;
  s.quantum = 0.01;
  const auto truth = std::make_shared<SawtoothTruth>();
  SawtoothBattery battery(s, truth);
  for (int i = 0; i < 2'000; ++i) {
    Sample row;
    battery(MemoryLog::micros(i * 60.0), row);
    Sample& registers = log.row(id, Source::registers, i * 60.0);
    for (const std::string_view name : {"battery_level", "current", "voltage", "battery_temp"}) {
      MemoryLog::set(registers, name, row.at(find_field(name)).real);
    }
    MemoryLog::set_int(log.row(id, Source::inputs, i * 60.0 + 1), "charging", row.at(field("charging")).integer);
  }
  const auto run = [&](std::size_t rows) {
    log.slice_rows(rows);
    return run_battery(log);
  };
  const Section section = run(0);
  CHECK(holds(quantity(section, "equivalent_full_cycles", "efc"), truth->efc));
  CHECK(number(cell(table(section, "equivalent_full_cycles"), 0, "soc_quantum")) == Approx(1.0));
  CHECK(sessions(section).rows.size() == static_cast<std::size_t>(truth->sessions));
  CHECK(finding(section, "BAT-07", "amr").verdict == Verdict::pass);
  CHECK(std::get<std::string>(cell(table(section, "battery_fields"), 0, "source")) == "registers");
  for (const std::size_t rows : std::vector<std::size_t>{1, 3, 64}) {
    REQUIRE(text(run(rows)) == text(section));
  }
}
