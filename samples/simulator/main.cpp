// tacho-sim: simulated robots to record from, or a log of them written at full speed.

#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <ctime>
#include <optional>

#include "samples/simulator/serve.hpp"
#include "samples/simulator/write.hpp"
#include "schema/error.hpp"
#include "schema/store/part.hpp"
#include "schema/text.hpp"
#include "schema/time.hpp"

namespace tacho::sim {
namespace {

constexpr int kUsage = 2;

struct Arguments {
  std::vector<std::string> robots;
  std::string scenario;
  std::uint64_t seed = 1;
  // serve
  std::string bind = "127.0.0.1";
  std::string push_every;
  std::string truth;
  std::string duration;
  int max_clients = 10;
  std::vector<std::string> faults;
  bool list_faults = false;
  // write
  std::string log;
  double days = 1;
  std::string from = "2026-01-01";
  double rate = 1;
  double io_rate = 0;
  double pose_rate = 0;
  double push_rate = 0;
  double registers_rate = 0;
  double inputs_rate = 0;
};

// "NAME", "NAME:19204", "NAME:19204:502" or "NAME:19204:502:19301"
ServedRobot parse_robot(const std::string& text) {
  ServedRobot robot;
  std::vector<std::string> parts = CLI::detail::split(text, ':');
  const auto port = [&text](const std::string& part) {
    unsigned value = 0;
    if (!CLI::detail::lexical_cast(part, value) || value > 65535) {
      throw CLI::ValidationError("--robot", "'" + text + "' is not NAME[:STATUS_PORT[:MODBUS_PORT[:PUSH_PORT]]]");
    }
    return static_cast<std::uint16_t>(value);
  };
  robot.scenario.name = parts[0];
  robot.status_port = parts.size() > 1 ? port(parts[1]) : std::uint16_t{0};
  robot.modbus_port = parts.size() > 2 ? port(parts[2]) : std::uint16_t{0};
  robot.push_port = parts.size() > 3 ? port(parts[3]) : std::uint16_t{0};
  if (parts.size() > 4 || parts[0].empty()) {
    throw CLI::ValidationError("--robot", "'" + text + "' is not NAME[:STATUS_PORT[:MODBUS_PORT[:PUSH_PORT]]]");
  }
  return robot;
}

// --robot names robots and their ports; the scenarios of the file are dealt to them in turn. Without --robot every
// scenario of the file is one robot; without a file everybody has a busy day.
std::vector<ServedRobot> robots_of(const Arguments& arguments) {
  std::vector<Scenario> scenarios;
  if (!arguments.scenario.empty()) {
    scenarios = load_scenarios(arguments.scenario);
  }
  std::vector<ServedRobot> robots;
  for (const std::string& text : arguments.robots) {
    ServedRobot robot = parse_robot(text);
    const std::size_t i = robots.size();
    const std::string name = robot.scenario.name;
    robot.scenario = scenarios.empty() ? busy_day(arguments.seed + i) : scenarios[i % scenarios.size()];
    robot.scenario.seed += scenarios.empty() ? 0 : i / scenarios.size();
    robot.scenario.name = name;
    robots.push_back(robot);
  }
  if (robots.empty() && scenarios.empty()) {
    scenarios.push_back(busy_day(arguments.seed));
  }
  if (robots.empty()) {
    for (const Scenario& scenario : scenarios) {
      robots.push_back({scenario, 0, 0, 0});
    }
  }
  return robots;
}

Micros duration_of(const std::string& text, const std::string& option) {
  const std::optional<Micros> duration = parse_duration(text);
  if (!duration || *duration <= 0) {
    throw CLI::ValidationError(option, "'" + text + "' is no duration; write 90s, 5min, 2h or 1d");
  }
  return *duration;
}

// Waits for SIGINT or SIGTERM, which are blocked in all threads, or until the time is over.
void wait_for_end(const sigset_t& signals, std::optional<Micros> duration) {
  if (!duration) {
    int signal = 0;
    sigwait(&signals, &signal);
    return;
  }
  const Micros end = mono_now_us() + *duration;
  for (Micros left = *duration; left > 0; left = end - mono_now_us()) {
    const timespec patience{static_cast<time_t>(left / 1'000'000), static_cast<long>(left % 1'000'000) * 1000};
    if (sigtimedwait(&signals, nullptr, &patience) > 0 || errno == EAGAIN) {
      return;
    }
  }
}

FaultWindow fault_of(const std::string& text) {
  try {
    return parse_fault_window(text);
  } catch (const Error& e) {
    throw CLI::ValidationError(std::string(e.what()) + "; --list-faults lists them all");
  }
}

void print_faults() {
  for (const LinkFault& fault : link_faults()) {
    const bool everywhere = fault.status != nullptr && fault.modbus != nullptr;
    fmt::print("{:<22} {:<7} {}\n", fault.name,
               everywhere                ? "both"
               : fault.status != nullptr ? "status"
                                         : "modbus",
               fault.what);
  }
}

int serve(const Arguments& arguments) {
  const std::optional<Micros> duration =
      arguments.duration.empty() ? std::nullopt : std::optional(duration_of(arguments.duration, "--for"));
  if (arguments.list_faults) {
    print_faults();
    return 0;
  }
  std::vector<ServedRobot> robots = robots_of(arguments);
  for (const std::string& text : arguments.faults) {
    for (ServedRobot& robot : robots) {
      robot.scenario.link_faults.push_back(fault_of(text));
    }
  }
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);

  ServeOptions options;
  options.bind = arguments.bind;
  options.push_period_us = arguments.push_every.empty() ? 0 : duration_of(arguments.push_every, "--push-every");
  options.truth_file = arguments.truth;
  options.max_clients = arguments.max_clients;
  Server server(robots, options);
  const std::string host = arguments.bind == "0.0.0.0" ? "127.0.0.1" : arguments.bind;
  std::string command = "run tacho-recorder run";
  for (std::size_t i = 0; i < robots.size(); ++i) {
    std::string address = fmt::format("{}:{}:{}", host, server.status_port(i), server.modbus_port(i));
    if (server.push_port(i) != 0) {
      address += fmt::format(":{}", server.push_port(i));
    }
    fmt::print("robot {} {}\n", robots[i].scenario.name, address);
    command += fmt::format(" --robot {}={}", robots[i].scenario.name, address);
  }
  fmt::print("{} --log LOG\n", command);
  std::fflush(stdout);
  wait_for_end(signals, duration);
  server.finish();
  return 0;
}

Micros period_of(double rate_hz) { return rate_hz > 0 ? std::llround(1e6 / rate_hz) : 0; }

int write(const Arguments& arguments) {
  std::vector<Scenario> scenarios;
  for (const ServedRobot& robot : robots_of(arguments)) {
    scenarios.push_back(robot.scenario);
  }
  const std::optional<Micros> from = parse_time(arguments.from, "UTC");
  if (!from) {
    throw CLI::ValidationError("--from", "'" + arguments.from + "' is no time; write 2026-01-01 or 2026-01-01T06:00Z");
  }
  WriteOptions options;
  options.t0_us = *from;
  options.duration_us = std::llround(arguments.days * 86400e6);
  options.status_period_us = period_of(arguments.rate);
  options.io_period_us = period_of(arguments.io_rate);
  options.pose_period_us = period_of(arguments.pose_rate);
  options.push_period_us = period_of(arguments.push_rate);
  options.registers_period_us = period_of(arguments.registers_rate);
  options.inputs_period_us = period_of(arguments.inputs_rate);
  if (isatty(STDERR_FILENO) != 0) {
    options.progress = [](double share) {
      fmt::print(stderr, "\rwriting {:3.0f} %{}", share * 100, share < 1 ? "" : "\n");
    };
  }
  if (std::filesystem::exists(arguments.log) && !store::list_parts(arguments.log).empty()) {
    throw Error(arguments.log, "holds a log already, and truth.json tells of one only", "give another folder");
  }
  const std::vector<Truth> truths = write_log(scenarios, options, arguments.log);
  for (std::size_t i = 0; i < truths.size(); ++i) {
    fmt::print("robot {} path {:.1f} m, {:.2f} equivalent full cycles, {} alarms, {} blocked\n", scenarios[i].name,
               truths[i].path_m, truths[i].equivalent_full_cycles_soc, truths[i].alarms.size(),
               truths[i].blocked.size());
  }
  fmt::print("log {}\ntruth {}\n", arguments.log, (std::filesystem::path(arguments.log) / "truth.json").string());
  return 0;
}

void common_options(CLI::App& command, Arguments& a) {
  command.add_option("--scenario", a.scenario, "scenario file (JSON); without it everybody has a busy day");
  command.add_option("--seed", a.seed, "seed of the first robot without a scenario file")->capture_default_str();
}

int run(int argc, char** argv) {
  Arguments a;
  CLI::App app{"tacho-sim: simulated robots with known truth"};
  app.set_version_flag("--version", "tacho-sim " TACHO_VERSION);
  app.require_subcommand(1);

  CLI::App* serving = app.add_subcommand("serve", "serve robots in real time, to record from");
  common_options(*serving, a);
  serving->add_option("--robot", a.robots,
                      "NAME[:STATUS_PORT[:MODBUS_PORT[:PUSH_PORT]]], repeatable; port 0 = any free one");
  serving->add_option("--push-every", a.push_every, "also serve the push port, at this period, for example 500ms");
  serving->add_option("--truth", a.truth, "file for what was true, written at the end");
  serving->add_option("--for", a.duration, "how long, for example 60s or 2h; else until interrupted");
  serving->add_option(
      "--fault", a.faults,
      "[status:|modbus:|push:]NAME[@FROM..TO], seconds; what goes wrong on the ports of all robots; repeatable");
  serving->add_flag("--list-faults", a.list_faults, "lists the names for --fault and what they do");
  serving->add_option("--bind", a.bind, "address to listen on")->capture_default_str();
  serving->add_option("--max-clients", a.max_clients, "further ones are refused")
      ->check(CLI::Range(0, 1000))
      ->capture_default_str();

  CLI::App* writing = app.add_subcommand("write", "write a log directly, at full speed");
  common_options(*writing, a);
  writing->add_option("--robot", a.robots, "NAME, repeatable");
  writing->add_option("--log", a.log, "folder of the new log; truth.json is put beside its parts")->required();
  writing->add_option("--days", a.days, "length")->check(CLI::PositiveNumber)->capture_default_str();
  writing->add_option("--from", a.from, "first day or time, UTC")->capture_default_str();
  const auto rate = [&](const char* name, double& value, const char* help) {
    writing->add_option(name, value, help)->check(CLI::Range(0.0, 1000.0))->capture_default_str();
  };
  rate("--rate", a.rate, "status answers per second; 0 = none");
  rate("--io-rate", a.io_rate, "io answers per second");
  rate("--pose-rate", a.pose_rate, "pose answers per second");
  rate("--push-rate", a.push_rate, "pushes per second");
  rate("--registers-rate", a.registers_rate, "register sweeps per second");
  rate("--inputs-rate", a.inputs_rate, "reads of the discrete inputs per second");

  const std::vector<std::string> commands{"serve", "write"};
  if (const std::string why = not_a_command(argc > 1 ? argv[1] : "", commands); !why.empty()) {
    fmt::print(stderr, "tacho-sim: error: {}; see tacho-sim --help\n", why);
    return kUsage;
  }
  try {
    app.parse(argc, argv);
    return serving->parsed() ? serve(a) : write(a);
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() == 0) {
      return app.exit(e);  // --help, --version
    }
    fmt::print(stderr, "tacho-sim: error: {}; see tacho-sim --help\n", e.what());
    return kUsage;
  }
}

}  // namespace
}  // namespace tacho::sim

int main(int argc, char** argv) {
  try {
    return tacho::sim::run(argc, argv);
  } catch (const std::exception& e) {
    fmt::print(stderr, "tacho-sim: error: {}\n", e.what());
    return 1;
  }
}
