// Whole programs as a user runs them: one JSON object per line.
// Usage: program_bench report | recorder [ROBOTS] | dead [MINUTES] | kill [KILLS]
//
// report: `tacho-analyzer report` on 30 simulated days at 0.1 Hz, three times, medians.
// recorder: `tacho-recorder run` on simulated robots (100 unless said otherwise), each with 1100 at 1 Hz, 1013 at 2 Hz,
// registers and inputs at 5 Hz. Processor time and memory of 20 s, after 5 s in which everything is connected. The
// robots are served by this process, so what they cost is not in the figures, but they compete for the same cores.
// dead: 32 robots of which 16 are silent, refuse, drip or are late, for a minute or as many as given; of the others,
// how far after their time requests were sent, and how much later at the end than at the beginning. A schedule begins
// where its earliest request was.
// kill: a recorder of eight robots that commits every second and is killed (20 times unless said otherwise): how much
// older than the kill the newest answer in the log is. One comes every 25 ms.

#include <fcntl.h>
#include <fmt/format.h>
#include <stdlib.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <map>
#include <random>
#include <sstream>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "samples/simulator/serve.hpp"
#include "samples/simulator/write.hpp"
#include "schema/log.hpp"
#include "schema/time.hpp"
#include "tests/support/measure.hpp"

namespace {

using namespace tacho;
namespace fs = std::filesystem;
using std::chrono::steady_clock;
using namespace std::chrono_literals;

constexpr auto kWarmUp = std::chrono::seconds(5);
constexpr auto kMeasured = std::chrono::seconds(20);

void print(const std::string& name, double value, std::string_view unit, std::string_view goal = "") {
  fmt::print("{{\"name\":\"{}\",\"value\":{:.4g},\"unit\":\"{}\"{}}}\n", name, value, unit, goal);
  std::fflush(stdout);
}

double seconds_since(steady_clock::time_point start) {
  return std::chrono::duration<double>(steady_clock::now() - start).count();
}

/// Starts a program of this build. What it prints goes to a file, which is shown when it fails.
pid_t start(const std::string& program, const std::vector<std::string>& arguments, const fs::path& printed) {
  const std::string path = std::string(TACHO_BINARY_DIR) + "/" + program;
  std::vector<char*> argv{const_cast<char*>(path.c_str())};
  for (const std::string& argument : arguments) {
    argv.push_back(const_cast<char*>(argument.c_str()));
  }
  argv.push_back(nullptr);
  const pid_t pid = fork();
  if (pid == 0) {
    const int file = open(printed.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    dup2(file, STDOUT_FILENO);
    dup2(file, STDERR_FILENO);
    execv(path.c_str(), argv.data());
    _exit(127);
  }
  return pid;
}

struct Ended {
  bool ok = false;
  rusage usage{};
};

Ended wait_for(pid_t pid) {
  Ended ended;
  int status = 0;
  wait4(pid, &status, 0, &ended.usage);
  ended.ok = WIFEXITED(status) && WEXITSTATUS(status) == 0;
  return ended;
}

/// Processor time of a running process, s: fields 14 and 15 of /proc/PID/stat.
double cpu_seconds(pid_t pid) {
  std::ifstream file(fmt::format("/proc/{}/stat", pid));
  std::string text{std::istreambuf_iterator<char>(file), {}};
  std::istringstream fields(text.substr(text.rfind(')') + 1));
  std::string skipped;
  for (int i = 3; i < 14; ++i) {
    fields >> skipped;
  }
  double user = 0;
  double system = 0;
  fields >> user >> system;
  return (user + system) / static_cast<double>(sysconf(_SC_CLK_TCK));
}

double stored_rows(const fs::path& folder, std::uint64_t& planned) {
  const std::vector<fs::path> paths{folder};
  const auto log = open_log(paths);
  std::uint64_t stored = 0;
  for (const Coverage& c : log->coverage()) {
    stored += c.stored;
    planned += c.planned;
  }
  return static_cast<double>(stored);
}

/// Polls by the cause why they are missing.
std::map<std::string, std::uint64_t> missed_polls(const fs::path& folder) {
  const std::vector<fs::path> paths{folder};
  const auto log = open_log(paths);
  Selection selection;
  selection.rows.fill(true);
  std::map<std::string, std::uint64_t> missed;
  for (const Robot& robot : log->robots()) {
    log->read(robot.id, {}, selection, [&](const Slice& slice) {
      for (const Gap& gap : slice.gaps) {
        missed[std::string(cause_name(gap.cause))] += gap.partial ? 0 : gap.seq_count;
      }
    });
  }
  return missed;
}

bool bench_report(const fs::path& dir) {
  sim::WriteOptions options;
  options.duration_us = Micros{30} * 86'400'000'000;
  options.status_period_us = 10'000'000;
  sim::write_log({sim::busy_day(1)}, options, dir / "month");
  std::uint64_t planned = 0;
  const double rows = stored_rows(dir / "month", planned);
  std::vector<double> seconds;
  double peak_mb = 0;
  for (int i = 0; i < 3; ++i) {
    const auto begin = steady_clock::now();
    const Ended ended =
        wait_for(start("analyzer/tacho-analyzer", {"report", (dir / "month").string(), "-o", (dir / "out").string()},
                       dir / "printed"));
    if (!ended.ok) {
      return false;
    }
    seconds.push_back(seconds_since(begin));
    peak_mb = std::max(peak_mb, static_cast<double>(ended.usage.ru_maxrss) * 1024.0 / 1e6);
  }
  std::sort(seconds.begin(), seconds.end());
  print("report/month_01hz", seconds[1], "s");
  print("report/rows", rows / seconds[1], "rows/s");
  print("report/peak_memory", peak_mb, "MB");
  return true;
}

std::vector<sim::ServedRobot> served_robots(int count) {
  std::vector<sim::ServedRobot> served;
  for (int i = 0; i < count; ++i) {
    served.push_back({sim::busy_day(static_cast<std::uint64_t>(i + 1)), 0, 0, 0});
  }
  return served;
}

/// A recorder of all of them, r1, r2, ..., into dir/live.
pid_t start_recorder(const sim::Server& server, std::size_t robots, const fs::path& dir) {
  std::vector<std::string> arguments{"run", "--log", (dir / "live").string(), "--period",
                                     "status=1Hz,io=2Hz,registers=5Hz,inputs=5Hz"};
  for (std::size_t i = 0; i < robots; ++i) {
    arguments.push_back("--robot");
    arguments.push_back(fmt::format("r{}=127.0.0.1:{}:{}", i + 1, server.status_port(i), server.modbus_port(i)));
  }
  return start("recorder/tacho-recorder", arguments, dir / "printed");
}

/// How long after its time each request of a stream was sent, in order; the earliest was in time.
std::vector<double> lateness_ms(RowSource& log, const Stream& stream) {
  std::vector<double> late;
  log.read_raw(stream.robot, stream.source, {}, [&](const Answer& answer) {
    late.push_back(
        static_cast<double>(answer.meta.t_send_us - static_cast<Micros>(answer.meta.seq) * stream.period_us) / 1e3);
  });
  const double first = late.empty() ? 0 : *std::min_element(late.begin(), late.end());
  std::for_each(late.begin(), late.end(), [first](double& ms) { ms -= first; });
  return late;
}

bool bench_dead(const fs::path& dir, int minutes) {
  constexpr int kRobots = 32;
  constexpr std::array kFaults{"silence", "refuse", "slow_drip", "late"};
  std::vector<sim::ServedRobot> served = served_robots(kRobots);
  for (std::size_t i = 1; i < served.size(); i += 2) {
    served[i].scenario.link_faults.push_back(sim::parse_fault_window(kFaults[i / 2 % kFaults.size()]));
  }
  const sim::Server server(served, {});
  const pid_t pid = start_recorder(server, served.size(), dir);
  std::this_thread::sleep_for(std::chrono::minutes(minutes));
  kill(pid, SIGTERM);
  if (!wait_for(pid).ok) {
    return false;
  }
  const std::vector<fs::path> paths{dir / "live"};
  const auto log = open_log(paths);
  std::vector<double> all;
  double drift = 0;
  std::uint64_t missed = 0;
  for (const Coverage& c : log->coverage()) {
    missed += c.robot % 2 == 1 ? c.missed : 0;
  }
  for (const Stream& stream : log->streams()) {
    const std::vector<double> late = lateness_ms(*log, stream);
    if (stream.robot % 2 == 1 && late.size() >= 8) {  // the healthy ones are r1, r3, ...
      const auto quarter = static_cast<std::ptrdiff_t>(late.size() / 4);
      drift = std::max(drift, std::abs(test::median({late.end() - quarter, late.end()}) -
                                       test::median({late.begin(), late.begin() + quarter})));
      all.insert(all.end(), late.begin(), late.end());
    }
  }
  std::sort(all.begin(), all.end());
  print("recorder/jitter_p99_16_of_32_dead", all[all.size() * 99 / 100], "ms", ",\"limit\":2,\"better\":\"lower\"");
  print("recorder/jitter_p50_16_of_32_dead", all[all.size() / 2], "ms");
  print("recorder/drift_16_of_32_dead", drift, fmt::format("ms in {} min, of the worst stream", minutes));
  print("recorder/missed_by_healthy_16_of_32_dead", static_cast<double>(missed), "polls");
  return true;
}

bool bench_kill(const fs::path& dir, int kills) {
  constexpr int kRobots = 8;
  const sim::Server server(served_robots(kRobots), {});
  std::mt19937 random(1);
  std::vector<double> missing;
  for (int i = 0; i < kills; ++i) {
    const pid_t pid = start_recorder(server, kRobots, dir);  // into the same log
    std::this_thread::sleep_for(2500ms + std::chrono::microseconds(random() % 1'000'000));
    const Micros killed_us = wall_now_us();
    kill(pid, SIGKILL);
    wait_for(pid);
    const std::vector<fs::path> paths{dir / "live"};
    Micros newest_us = 0;
    for (const Coverage& c : open_log(paths)->coverage()) {
      newest_us = std::max(newest_us, c.last_us);
    }
    missing.push_back(static_cast<double>(killed_us - newest_us) / 1e3);
  }
  std::sort(missing.begin(), missing.end());
  print("recorder/missing_after_kill_most", missing.back(), "ms", ",\"limit\":1100,\"better\":\"lower\"");
  print("recorder/missing_after_kill_p50", missing[missing.size() / 2], "ms");
  return true;
}

bool bench_recorder(const fs::path& dir, int robots) {
  const std::vector<sim::ServedRobot> served = served_robots(robots);
  const sim::Server server(served, {});
  const pid_t pid = start_recorder(server, served.size(), dir);
  std::this_thread::sleep_for(kWarmUp);
  const double before = cpu_seconds(pid);
  const auto begin = steady_clock::now();
  std::this_thread::sleep_for(kMeasured);
  const double share = (cpu_seconds(pid) - before) / seconds_since(begin);
  const double memory = test::resident_bytes(std::to_string(pid)) / 1e6;
  kill(pid, SIGTERM);
  if (!wait_for(pid).ok) {
    return false;
  }
  std::uint64_t planned = 0;
  const double stored = stored_rows(dir / "live", planned);
  // The goals are for 100 robots.
  const bool goal = robots == 100;
  print(fmt::format("recorder/cpu_{}_robots", robots), 100.0 * share, "% of one core",
        goal ? ",\"limit\":25,\"better\":\"lower\"" : "");
  print(fmt::format("recorder/memory_{}_robots", robots), memory, "MB",
        goal ? ",\"limit\":64,\"better\":\"lower\"" : "");
  print(fmt::format("recorder/stored_{}_robots", robots), 100.0 * stored / static_cast<double>(planned),
        "% of planned polls");
  for (const auto& [cause, polls] : missed_polls(dir / "live")) {
    print(fmt::format("recorder/missed_{}_{}_robots", cause, robots), static_cast<double>(polls), "polls");
  }
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  struct Bench {
    int usual;  // number
    bool (*run)(const fs::path&, int number);
  };
  const std::map<std::string, Bench> benches{
      {"report", {1, [](const fs::path& dir, int) { return bench_report(dir); }}},
      {"recorder", {100, bench_recorder}},
      {"dead", {1, bench_dead}},
      {"kill", {20, bench_kill}}};
  const auto bench = benches.find(argc > 1 ? argv[1] : "");
  const int number = argc > 2 ? std::stoi(argv[2]) : bench != benches.end() ? bench->second.usual : 0;
  std::string folder = (fs::temp_directory_path() / "tacho-bench-XXXXXX").string();
  if (bench == benches.end() || number < 1 || mkdtemp(folder.data()) == nullptr) {
    fmt::print(stderr, "usage: program_bench report | recorder [ROBOTS] | dead [MINUTES] | kill [KILLS]\n");
    return 2;
  }
  const bool ok = bench->second.run(folder, number);
  if (!ok) {
    std::ifstream printed(fs::path(folder) / "printed");
    fmt::print(stderr, "program_bench: error: the program failed\n{}",
               std::string{std::istreambuf_iterator<char>(printed), {}});
  }
  fs::remove_all(folder);
  return ok ? 0 : 1;
}
