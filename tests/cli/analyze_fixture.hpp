#pragma once
// Logs written by simulated robots, and the analyzer program run on them.

#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "samples/simulator/write.hpp"
#include "schema/log.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/process.hpp"
#include "tests/support/temp_dir.hpp"

namespace tacho::test {

using Json = nlohmann::json;

inline Outcome analyze(const std::vector<std::string>& arguments) { return run("analyzer/tacho-analyzer", arguments); }

/// Never a crash: sanitizers and signals end with other codes.
inline bool civil(const Outcome& outcome) { return outcome.code >= 0 && outcome.code <= 3; }

inline sim::Scenario robot(const std::string& name, std::uint64_t seed) {
  sim::Scenario scenario = sim::busy_day(seed);
  scenario.name = name;
  return scenario;
}

/// Twenty minutes of two robots, with a gap of 60 polls in the status of the first; written once per program.
inline const std::string& two_robots() {
  static const TempDir dir;
  static const std::string log = [] {
    sim::WriteOptions options;
    options.duration_us = 1'200'000'000;
    options.io_period_us = 2'000'000;
    options.registers_period_us = 1'000'000;
    options.inputs_period_us = 1'000'000;
    Gap gap;
    gap.robot = 1;
    gap.source = Source::status;
    gap.t_from_us = options.t0_us + 300'000'000;
    gap.t_to_us = options.t0_us + 360'000'000;
    gap.cause = Cause::timeout;
    options.gaps = {gap};
    sim::write_log({robot("amb-01", 1), robot("amb-02", 2)}, options, dir / "log");
    return (dir / "log").string();
  }();
  return log;
}

/// A log with `polls` answers of one robot; 0 = a recorder that was started and ended at once.
inline void write_short_log(const std::filesystem::path& folder, int polls) {
  if (polls > 0) {
    sim::WriteOptions options;
    options.duration_us = polls * 1'000'000;
    sim::write_log({robot("amb-01", 1)}, options, folder);
    return;
  }
  store::LogWriter writer(folder);
  Session session;
  session.t_start_us = 1'767'225'600'000'000;
  session.software = "test";
  writer.begin_session(session);
  writer.end_session(session.t_start_us + 1'000'000, true);
}

inline const std::vector<std::string>& analysis_names() {
  static const std::vector<std::string> names{"odometry", "battery", "alarms", "blockage"};
  return names;
}

inline std::map<std::string, std::string> contents(const std::filesystem::path& folder) {
  std::map<std::string, std::string> out;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) {
      out[std::filesystem::relative(entry.path(), folder).generic_string()] = read_file(entry.path());
    }
  }
  return out;
}

inline std::size_t lines(const std::string& text) {
  return static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
}

/// Rows of a table of the first section.
inline Json table(const Json& document, const std::string& name) {
  for (const Json& t : document["sections"][0]["tables"]) {
    if (t["name"] == name) {
      return t["rows"];
    }
  }
  FAIL("no table " << name);
  return {};
}

}  // namespace tacho::test
