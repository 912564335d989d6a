#pragma once
// Writes a log directly, at full speed, through the same Ingest and LogWriter as the recorder.

#include <filesystem>
#include <functional>
#include <vector>

#include "samples/simulator/robot.hpp"

namespace tacho::sim {

struct WriteOptions {
  Micros t0_us = 1'767'225'600'000'000;  ///< 2026-01-01T00:00:00Z
  Micros duration_us = 3'600'000'000;
  Micros status_period_us = 1'000'000;  ///< 0 = source not written
  Micros io_period_us = 0;
  Micros registers_period_us = 0;
  Micros inputs_period_us = 0;
  Micros pose_period_us = 0;
  Micros push_period_us = 0;
  Micros rtt_us = 4'000;
  Micros jitter_us = 2'000;              ///< uniform on the send time
  std::vector<Gap> gaps;                 ///< per robot and source: answers in [t_from, t_to) become this gap
  std::function<void(double)> progress;  ///< 0..1
};

/// Writes `folder` and folder/truth.json. Returns the truth per scenario.
std::vector<Truth> write_log(const std::vector<Scenario>& scenarios, const WriteOptions& options,
                             const std::filesystem::path& folder);

}  // namespace tacho::sim
