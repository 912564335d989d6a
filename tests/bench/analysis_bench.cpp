// Speed of the analyses on logs of a simulated robot: one JSON object per line. Usage: analysis_bench [FILTER]
//
// The peer is the same log read with nothing computed from it, so that the cost of an analysis is told apart from the
// cost of decoding; both are measured in turn, five times, medians are printed.

#include <fmt/format.h>
#include <stdlib.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <string>
#include <vector>

#include "analyzer/analysis.hpp"
#include "samples/simulator/write.hpp"
#include "schema/log.hpp"
#include "tests/support/measure.hpp"

namespace {

using namespace tacho;
namespace fs = std::filesystem;

template <typename Work>
double seconds(const Work& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

void print(const std::string& name, double value, const char* unit) {
  fmt::print("{{\"name\":\"{}\",\"value\":{:.4g},\"unit\":\"{}\"}}\n", name, value, unit);
}

/// Decodes what the analysis needs and drops it.
void read_only(const AnalysisSpec& spec, RowSource& log) {
  Selection selection;
  for (const Need& need : spec.needs()) {
    selection.add(need.sources.front(), need.field);
  }
  for (const Robot& robot : log.robots()) {
    log.read(robot.id, {}, selection, [](const Slice&) {});
  }
}

void bench(const AnalysisSpec& spec, const fs::path& folder) {
  const Settings settings;
  std::vector<double> read;
  std::vector<double> whole;
  for (int i = 0; i < 5; ++i) {
    const auto log = open_log(std::vector<fs::path>{folder});
    read.push_back(seconds([&] { read_only(spec, *log); }));
    whole.push_back(seconds([&] { run_analysis(spec, *log, {}, {}, "UTC", settings); }));
  }
  const std::string name(spec.name);
  print(name + "_day_1hz", test::median(whole), "s");
  print(name + "_day_1hz_read_only", test::median(read), "s");
  print(name + "_over_read", test::median(whole) / test::median(read), "ratio");
}

}  // namespace

int main(int argc, char** argv) {
  const std::string filter = argc > 1 ? argv[1] : "";
  std::string folder = (fs::temp_directory_path() / "tacho-bench-XXXXXX").string();
  if (mkdtemp(folder.data()) == nullptr) {
    return 1;
  }
  sim::WriteOptions options;
  options.duration_us = 86'400'000'000;
  sim::write_log({sim::busy_day(1)}, options, fs::path(folder) / "log");
  for (const AnalysisSpec& spec : analyses()) {
    if (filter.empty() || filter == spec.name) {
      bench(spec, fs::path(folder) / "log");
    }
  }
  fs::remove_all(folder);
}
