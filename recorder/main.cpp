// tacho-recorder: keeps everything the robots say. Reads only.

#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <iterator>
#include <optional>
#include <string>

#include "recorder/check.hpp"
#include "recorder/config.hpp"
#include "recorder/console.hpp"
#include "recorder/recorder.hpp"
#include "schema/time.hpp"

namespace tacho::recorder {
namespace {

constexpr int kFailed = 1;
constexpr int kUsage = 2;

struct Arguments {
  std::string config_file;
  std::string run_for;
  Overrides overrides;
};

/// The signals that end a recording. Blocked in every thread and fetched by main alone, so that no code runs inside a
/// handler and a second Ctrl-C while the log is being closed changes nothing.
sigset_t ending_signals() {
  sigset_t set;
  sigemptyset(&set);
  sigaddset(&set, SIGINT);
  sigaddset(&set, SIGTERM);
  sigaddset(&set, SIGHUP);
  return set;
}

Config load(const Arguments& arguments) {
  Config config = arguments.config_file.empty() ? Config{} : read_config(arguments.config_file);
  apply(arguments.overrides, config);
  validate(config);
  return config;
}

/// The file as it is when nothing on the command line changes it, else everything that is in force.
std::string config_text(const Arguments& arguments, const Config& config) {
  const Overrides& o = arguments.overrides;
  const bool changed =
      !o.robots.empty() || o.log || o.periods || o.sources || o.commit || o.timeout || o.word_order || o.unit;
  if (arguments.config_file.empty() || changed) {
    return to_toml(config);
  }
  std::ifstream in(arguments.config_file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

int run(const Arguments& arguments) {
  const Config config = load(arguments);
  if (config.log.empty()) {
    throw UsageError("log", "no folder given", "use --log DIR, or log = \"DIR\" in the --config file");
  }
  std::optional<Micros> run_for;
  if (!arguments.run_for.empty()) {
    run_for = parse_length(arguments.run_for, "--for", 1000, Micros{3'650} * 86'400'000'000);
  }
  const sigset_t signals = ending_signals();
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  std::signal(SIGPIPE, SIG_IGN);

  Console console(isatty(STDERR_FILENO) == 1);
  Recorder::Options options;
  options.config_text = config_text(arguments, config);
  options.run_for_us = run_for;
  options.notice = [&console](const std::string& text) { console.message(text); };
  Recorder recorder(config, std::move(options));
  console.message(fmt::format("recording {} robot{} into {}", config.robots.size(),
                              config.robots.size() == 1 ? "" : "s", config.log.string()));
  for (const std::string& line : recorder.outlook()) {
    console.message(line);
  }
  Micros next_status = mono_now_us();
  while (!recorder.done()) {
    const timespec tick{0, 50'000'000};
    const int signal = sigtimedwait(&signals, nullptr, &tick);
    if (signal > 0) {
      console.message(fmt::format("{}: ending", signal == SIGINT ? "interrupted" : "told to stop"));
      break;
    }
    if (mono_now_us() >= next_status) {
      console.status(recorder.progress());
      next_status = mono_now_us() + 1'000'000;
    }
  }
  const std::vector<SourceSummary> summary = recorder.finish();
  console.status(recorder.progress());
  console.end_status();
  fmt::print("{}", summary_text(summary));
  std::fflush(stdout);
  if (const std::string why = nothing_recorded(summary); !why.empty()) {
    fmt::print(stderr, "tacho-recorder: error: {}\n", why);
    return kFailed;
  }
  return 0;
}

int check_command(const Arguments& arguments) {
  const CheckResult result = check(load(arguments));
  fmt::print("{}", result.text);
  return result.problems == 0 ? 0 : kFailed;
}

void add_options(CLI::App& command, Arguments& arguments) {
  Overrides& o = arguments.overrides;
  command.add_option("--config", arguments.config_file, "TOML file; flags win over it (see samples/config/site.toml)");
  command.add_option("--robot", o.robots, "NAME=HOST[:STATUS_PORT[:MODBUS_PORT]]; repeat for more robots")
      ->type_name("ROBOT")
      ->allow_extra_args(false);
  command.add_option("--log", o.log, "folder of the log; made when it does not exist")->type_name("DIR");
  command.add_option("--sources", o.sources, "record these and no others: status,io,registers,inputs")
      ->type_name("LIST");
  command
      .add_option("--period", o.periods, "how often, as durations or rates: status=1s,io=2Hz,registers=5Hz,inputs=off")
      ->type_name("LIST");
  command.add_option("--timeout", o.timeout, "longest wait for an answer, connecting included (1s)")->type_name("TIME");
  command.add_option("--unit", o.unit, "Modbus unit id (1)");
  command.add_option("--word-order", o.word_order, "auto, cdab, abcd, badc or dcba (auto)")->type_name("ORDER");
}

int parse_and_run(int argc, char** argv) {
  CLI::App app{"Records SEER Robokit robots: status port and Modbus TCP, read only.", "tacho-recorder"};
  app.set_version_flag("--version", "tacho-recorder " TACHO_VERSION);
  app.require_subcommand(1);
  Arguments arguments;
  CLI::App* const run_cmd = app.add_subcommand("run", "record until a signal comes or the time is over");
  add_options(*run_cmd, arguments);
  run_cmd->add_option("--for", arguments.run_for, "stop after this time: 60s, 5min, 2h")->type_name("TIME");
  run_cmd->add_option("--commit", arguments.overrides.commit, "how often the log is made durable (1s)")
      ->type_name("TIME");
  CLI::App* const check_cmd = app.add_subcommand("check", "connect once, say what would be recorded; writes nothing");
  add_options(*check_cmd, arguments);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) {
      return app.exit(error);  // --help, --version
    }
    throw UsageError("arguments", error.what(), "see tacho-recorder --help");
  }
  return check_cmd->parsed() ? check_command(arguments) : run(arguments);
}

}  // namespace
}  // namespace tacho::recorder

int main(int argc, char** argv) {
  try {
    return tacho::recorder::parse_and_run(argc, argv);
  } catch (const tacho::recorder::UsageError& error) {
    fmt::print(stderr, "tacho-recorder: error: {}\n", error.what());
    return tacho::recorder::kUsage;
  } catch (const std::exception& error) {
    fmt::print(stderr, "tacho-recorder: error: {}\n", error.what());
    return tacho::recorder::kFailed;
  }
}
