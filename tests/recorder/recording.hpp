#pragma once
// A recording of tiny robots over sockets, and its log checked from its rows.

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "recorder/recorder.hpp"
#include "schema/log.hpp"
#include "schema/wire/frame.hpp"
#include "tests/recorder/modbus_server.hpp"
#include "tests/recorder/tiny_server.hpp"
#include "tests/support/catch.hpp"

namespace tacho::recorder::test {

/// A robot's status port: answers 1100 and 1013 with fixed bodies.
inline void serve_status(Peer& peer) {
  wire::FrameDecoder decoder;
  wire::Frame frame;
  for (std::string byte = peer.read(1); !byte.empty(); byte = peer.read(1)) {
    decoder.feed(byte);
    if (decoder.next(frame)) {
      const std::string body = frame.header.type == 1100 ? R"({"x":1.5,"vehicle_id":"AMB-1"})" : R"({"DI":[],"DO":[]})";
      peer.write(wire::encode_frame(1, frame.header.sequence, wire::answer_type(frame.header.type), body));
    }
  }
}

inline Config config_for(const std::filesystem::path& log,
                         const std::vector<std::pair<std::uint16_t, std::uint16_t>>& ports) {
  Config config;
  config.log = log;
  config.commit_us = 50'000;
  config.defaults.period_us = {50'000, 100'000, 25'000, 25'000};
  config.defaults.status.spacing_us = 0;
  config.defaults.modbus.spacing_us = 0;
  config.defaults.status.timeout_us = config.defaults.modbus.timeout_us = 5'000'000;
  for (std::size_t i = 0; i < ports.size(); ++i) {
    RobotConfig robot;
    robot.name = "r" + std::to_string(i + 1);
    robot.host = "127.0.0.1";
    robot.status_port = ports[i].first;
    robot.modbus_port = ports[i].second;
    robot.settings = config.defaults;
    config.robots.push_back(robot);
  }
  return config;
}

inline std::unique_ptr<RowSource> open(const std::filesystem::path& log) {
  return open_log(std::vector<std::filesystem::path>{log});
}

/// Each planned poll of each stream occurs exactly once among rows and gaps of the log; agrees with the summary.
inline void check_log(const std::filesystem::path& folder, const std::vector<SourceSummary>& summary) {
  const auto log = open(folder);
  const auto robots = log->robots();
  const auto streams = log->streams();
  REQUIRE(streams.size() == summary.size());
  for (const SourceSummary& row : summary) {
    INFO(row.robot << " " << source_name(row.source));
    const auto robot = std::find_if(robots.begin(), robots.end(), [&](const Robot& r) { return r.name == row.robot; });
    REQUIRE(robot != robots.end());
    const auto stream = std::find_if(streams.begin(), streams.end(),
                                     [&](const Stream& s) { return s.robot == robot->id && s.source == row.source; });
    REQUIRE(stream != streams.end());
    REQUIRE(stream->planned);
    CHECK(*stream->planned == row.planned);
    std::vector<int> seen(row.planned, 0);
    std::uint64_t stored = 0;
    log->read_raw(robot->id, row.source, {}, [&](const Answer& a) {
      ++seen.at(a.meta.seq);
      ++stored;
    });
    Selection selection;
    selection.rows[static_cast<std::size_t>(row.source)] = true;
    log->read(robot->id, {}, selection, [&](const Slice& slice) {
      for (const Gap& g : slice.gaps) {
        for (std::uint64_t k = 0; g.source == row.source && !g.partial && k < g.seq_count; ++k) {
          ++seen.at(g.seq_from + k);
        }
      }
    });
    CHECK(stored == row.stored);
    CHECK(std::all_of(seen.begin(), seen.end(), [](int n) { return n == 1; }));
  }
}

inline std::vector<Event> events_of(const std::filesystem::path& folder, RobotId robot) {
  std::vector<Event> out;
  Selection selection;
  selection.rows.fill(true);
  open(folder)->read(robot, {}, selection,
                     [&](const Slice& s) { out.insert(out.end(), s.events.begin(), s.events.end()); });
  return out;
}

inline void wait_done(const Recorder& recorder) {
  while (!recorder.done()) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
}

}  // namespace tacho::recorder::test
