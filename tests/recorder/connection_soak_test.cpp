// Months of bad networks in seconds: connections break in every way there is, robots come and go by reloads. The
// recorder holds no more files and memory for it. With TACHO_SOAK=1 for an hour, from a release build.

#include <fmt/format.h>

#include <cstdlib>

#include "samples/simulator/serve.hpp"
#include "tests/recorder/recording.hpp"
#include "tests/support/measure.hpp"
#include "tests/support/temp_dir.hpp"

using namespace tacho;
using namespace tacho::recorder;
using namespace tacho::recorder::test;
using namespace tacho::test;
using namespace std::chrono_literals;

namespace {

constexpr auto kEachFault = 12ms;

bool all_up(const Recorder& recorder, std::size_t links) {
  const Snapshot now = recorder.snapshot();
  return now.links.size() == links &&
         std::all_of(now.links.begin(), now.links.end(), [](const LinkNow& link) { return link.up; });
}

/// One robot, its connections broken in every way; then a second one that comes, is asked otherwise, and goes.
class BadWeek {
 public:
  explicit BadWeek(const std::filesystem::path& folder)
      : robot_({{scenario(), 0, 0, 0}, {scenario(), 0, 0, 0}}, serving()), config_(config(folder)) {
    recorder_ = std::make_unique<Recorder>(config_, Recorder::Options{});
  }

  void round() {
    for (const sim::LinkFault& fault : sim::link_faults()) {
      set_fault(&fault);
      std::this_thread::sleep_for(kEachFault);
    }
    set_fault(nullptr);
    Config two = config_;
    two.robots.push_back(other_);
    recorder_->reload(two, "");
    two.robots.back().settings.period_us[static_cast<std::size_t>(Source::io)] = 200'000;
    recorder_->reload(two, "");
    reloads_ += 3;
    recorder_->reload(config_, "");
    for (int i = 0; i < 1000 && !all_up(*recorder_, 3); ++i) {
      std::this_thread::sleep_for(5ms);
    }
    REQUIRE(all_up(*recorder_, 3));
  }
  std::vector<SourceSummary> finish() {
    recorder_->stop();
    return recorder_->finish();
  }
  [[nodiscard]] int reloads() const { return reloads_; }

 private:
  sim::Server robot_;
  RobotConfig other_;  // config() sets it
  Config config_;
  std::unique_ptr<Recorder> recorder_;
  int reloads_ = 0;

  static sim::Scenario scenario() {
    sim::Scenario out;
    out.always_idle = true;
    return out;
  }
  static sim::ServeOptions serving() {
    sim::ServeOptions out;
    out.push_period_us = 50'000;
    return out;
  }
  Config config(const std::filesystem::path& folder) {
    Config out = config_for(
        folder, {{robot_.status_port(0), robot_.modbus_port(0)}, {robot_.status_port(1), robot_.modbus_port(1)}});
    for (std::size_t i = 0; i < 2; ++i) {
      out.robots[i].push_port = robot_.push_port(i);
      out.robots[i].settings.period_us[static_cast<std::size_t>(Source::push)] = 50'000;
      out.robots[i].settings.status.timeout_us = out.robots[i].settings.modbus.timeout_us = 60'000;
    }
    other_ = out.robots[1];
    out.robots.pop_back();
    return out;
  }
  void set_fault(const sim::LinkFault* fault) {
    for (const sim::Port port : sim::kPorts) {
      robot_.fault(0, port, fault);
    }
  }
};

}  // namespace

TEST_CASE("connections that break and robots that come and go leave nothing open and nothing in memory") {
  const bool long_run = std::getenv("TACHO_SOAK") != nullptr;
  const auto end = std::chrono::steady_clock::now() + (long_run ? 3600s : 8s);
  const TempDir dir;
  BadWeek week(dir / "log");
  std::vector<double> bytes;
  std::vector<std::size_t> files;
  for (int rounds = 0; rounds < 5 || std::chrono::steady_clock::now() < end; ++rounds) {
    week.round();
    files.push_back(open_files());
    bytes.push_back(resident_bytes());
  }
  const int reloads = week.reloads();
  check_log(dir / "log", week.finish());
  // The server may not have closed its end of the last connections yet.
  const auto most = std::max_element(files.begin() + 1, files.end());
  CHECK(*most <= files.front() + 8);
  if (long_run) {
    constexpr std::ptrdiff_t kParts = 10;
    std::vector<double> medians;
    for (std::ptrdiff_t part = 0; part < kParts; ++part) {
      const auto size = static_cast<std::ptrdiff_t>(bytes.size());
      medians.push_back(median({bytes.begin() + part * size / kParts, bytes.begin() + (part + 1) * size / kParts}) /
                        1e6);
    }
    fmt::print(
        "{} rounds of {} faults on three ports, {} reloads; resident by tenths of the time, MB: {:.2f}; {} to {} files "
        "open\n",
        bytes.size(), sim::link_faults().size(), reloads, fmt::join(medians, " "),
        *std::min_element(files.begin(), files.end()), *most);
    // The first blocks are made after half an hour: what that takes is kept.
    CHECK(medians[9] - medians[6] < 1);
  }
}
