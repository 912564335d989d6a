#include "analyzer/commands/info.hpp"

#include "tests/support/catch.hpp"
#include "tests/support/memory_log.hpp"

using namespace tacho;
using namespace tacho::test;

namespace {

/// 95 of 100 planned polls are stored.
MemoryLog mostly_recorded() {
  MemoryLog log;
  const RobotId robot = log.add_robot("a");
  for (int t = 0; t < 95; ++t) {
    MemoryLog::set(log.row(robot, Source::status, t), "x", 1.0);
  }
  Gap gap;
  gap.robot = robot;
  gap.source = Source::status;
  gap.seq_from = 95;
  gap.seq_count = 5;
  gap.t_from_us = MemoryLog::micros(95.0);
  gap.t_to_us = MemoryLog::micros(100.0);
  gap.cause = Cause::timeout;
  log.gap(gap);
  return log;
}

Finding stored_share(const Settings& settings) {
  MemoryLog log = mostly_recorded();
  const Section section = commands::info(log, {log.robots(), nullptr, settings});
  REQUIRE(section.findings.at(0).id == "DATA-01");
  return section.findings[0];
}

}  // namespace

TEST_CASE("95 % of the planned polls are a warning unless the site has said otherwise") {
  const Finding usual = stored_share({});
  CHECK(*usual.value.value == Approx(95.0));
  CHECK(usual.verdict == Verdict::warn);
  CHECK(usual.threshold == "PASS >= 99 %, FAIL < 90 %");
  CHECK(usual.threshold_source == "default");

  Settings wireless;
  wireless.set("info.stored_pass", 0.95, "site.toml:2");
  CHECK(stored_share(wireless).verdict == Verdict::pass);
  CHECK(stored_share(wireless).threshold == "PASS >= 95 %, FAIL < 90 %");
  CHECK(stored_share(wireless).threshold_source == "site.toml:2, default");

  Settings wired;
  wired.set("a/info.stored_fail", 0.97, "site.toml:4");
  CHECK(stored_share(wired).verdict == Verdict::fail);
}

namespace {

/// Recorded from 0 s to 41 s and from 90 s to 101 s.
class RecordedTwice final : public MemoryLog {
 public:
  [[nodiscard]] std::vector<Session> sessions() const override {
    std::vector<Session> out(2);
    out[0].t_start_us = micros(0.0);
    out[0].t_end_us = micros(41.0);
    out[1].t_start_us = micros(90.0);
    out[1].t_end_us = micros(101.0);
    return out;
  }
};

}  // namespace

TEST_CASE("time with the recorder off is counted in seconds, told in a note, and no part of the rate") {
  RecordedTwice log;
  const RobotId robot = log.add_robot("a");
  for (int t = 0; t <= 100; ++t) {
    if (t <= 40 || t >= 90) {
      MemoryLog::set(log.row(robot, Source::status, t), "x", 1.0);
    }
  }
  Gap off;
  off.robot = robot;
  off.source = Source::status;
  off.t_from_us = MemoryLog::micros(41.0);
  off.t_to_us = MemoryLog::micros(90.0);
  off.cause = Cause::recorder_off;
  log.gap(off);
  const Section section = commands::info(log, {log.robots()});
  const auto cell = [&](const char* table_name, const char* column) {
    for (const DataTable& table : section.tables) {
      for (std::size_t c = 0; table.name == table_name && c < table.columns.size(); ++c) {
        if (table.columns[c].name == column) {
          return std::get<double>(table.rows.at(0).at(c));
        }
      }
    }
    throw std::runtime_error("no such cell");
  };
  CHECK(cell("missed", "duration_s") == Approx(49.0));
  CHECK(cell("sources", "rate") == Approx(1.0).epsilon(0.001));
  CHECK(std::find(section.notes.begin(), section.notes.end(),
                  "the recorder was running for 51 % of the 100 s from the first answer to the last, off for 49 s") !=
        section.notes.end());
}

namespace {

class NamedRobots final : public MemoryLog {
 public:
  explicit NamedRobots(std::vector<Robot> named) : named_(std::move(named)) {}
  [[nodiscard]] std::vector<Robot> robots() const override { return named_; }

 private:
  std::vector<Robot> named_;
};

std::vector<std::string> notes_of_robots(std::vector<Robot> robots, std::size_t chosen) {
  NamedRobots log(robots);
  robots.resize(chosen);
  std::vector<std::string> notes;
  for (const std::string& note : commands::info(log, {robots}).notes) {
    if (note.find("put together") != std::string::npos || note.find("one address") != std::string::npos) {
      notes.push_back(note);
    }
  }
  return notes;
}

}  // namespace

TEST_CASE("robots that share identity or address are told of in a note, and stay two robots") {
  const Robot first{1, "amr-1", "10.0.0.5:19204:502", "V7", "02AA", "m1", ""};
  const Robot renamed{2, "tug", "10.0.0.9:19204:502", "V7", "02AA", "m1", ""};
  const Robot changed{2, "amr-1 (2)", "10.0.0.5:19204:502", "V7", "02AA", "m2", ""};
  const Robot silent{2, "tug", "10.0.0.5:19204:502", "", "", "", ""};
  const Robot other{2, "amr-1 (2)", "10.0.0.5:19204:502", "V8", "02BB", "m1", ""};
  const Robot elsewhere{2, "amr-2", "10.0.0.6:19204:502", "V7", "02BB", "m1", ""};
  struct Case {
    Robot second;
    std::string words;
  };
  for (const Case& c :
       {Case{renamed, "amr-1 and tug say that they are the same robot (vehicle_id V7, MAC 02AA)"},
        Case{changed, "amr-1 and amr-1 (2) have one MAC (02AA) and differ in model_md5"},
        Case{silent, "amr-1 and tug were found at one address (10.0.0.5:19204:502), and neither tells"},
        Case{other, "at one address (10.0.0.5:19204:502) and differ in vehicle_id, MAC: another robot"}}) {
    const std::vector<std::string> notes = notes_of_robots({first, c.second}, 2);
    INFO(c.words);
    REQUIRE(notes.size() == 1);
    CHECK(notes[0].find(c.words) != std::string::npos);
    CHECK(notes_of_robots({first, c.second}, 1).size() == 1);  // also when only one of the two was asked for
  }
  CHECK(notes_of_robots({first, elsewhere}, 2).empty());
  Robot third = renamed;
  third.id = 3;
  third.name = "tug 3";
  CHECK(notes_of_robots({first, renamed, third}, 3).size() == 2);
  CHECK(notes_of_robots({first, renamed, third}, 0).empty());
}

TEST_CASE("info of a period counts its answers and its share of a gap, and says what is of the whole log") {
  MemoryLog log = mostly_recorded();
  commands::InfoQuery query{log.robots()};
  query.window = {MemoryLog::micros(90.0), MemoryLog::micros(97.0)};  // 5 answers, 2 s of 5 s of the gap
  query.zone = "Europe/Berlin";
  const Section section = commands::info(log, query);
  const auto cell = [&](const std::string& table_name, const std::string& column) {
    for (const DataTable& table : section.tables) {
      for (std::size_t c = 0; table.name == table_name && c < table.columns.size(); ++c) {
        if (table.columns[c].name == column) {
          return table.rows.at(0).at(c);
        }
      }
    }
    throw std::runtime_error("no such cell");
  };
  CHECK(std::get<std::int64_t>(cell("sources", "stored")) == 5);
  CHECK(std::get<std::int64_t>(cell("sources", "missed")) == 2);
  CHECK(std::holds_alternative<Missing>(cell("sources", "accounted")));
  CHECK(std::get<Time>(cell("sources", "first")).us == MemoryLog::micros(90.0));
  CHECK(std::get<std::int64_t>(cell("missed", "polls")) == 2);
  CHECK(std::get<double>(cell("missed", "duration_s")) == Approx(2.0));
  REQUIRE(section.findings.at(0).id == "DATA-01");
  CHECK(*section.findings[0].value.value == Approx(100.0 * 5 / 7));
  for (const Finding& finding : section.findings) {
    CHECK(finding.title.ends_with("(whole log)") == (finding.id != "DATA-01"));
  }
  CHECK(section.notes.at(0).find("from 2026-01-01T01:01:30") == 0);
  CHECK(section.notes[0].find("DATA-01 are of this period; all else is of the whole log") != std::string::npos);

  query.window.to_us = MemoryLog::micros(95.5);  // half a second of the gap: rounded, as polls are whole
  CHECK(commands::info(log, query).findings.at(0).value.n == 6);
}
