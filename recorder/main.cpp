// tacho-recorder: keeps everything the robots say. Reads only.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <string>
#include <system_error>
#include <vector>

#include "recorder/check.hpp"
#include "recorder/config.hpp"
#include "recorder/log_status.hpp"
#include "recorder/log_tail.hpp"
#include "recorder/mark.hpp"
#include "recorder/run_command.hpp"
#include "schema/log.hpp"
#include "schema/text.hpp"
#include "schema/time.hpp"

namespace tacho::recorder {
namespace {

constexpr int kFailed = 1;
constexpr int kUsage = 2;
constexpr int kNotRecorded = 3;

/// Of the commands that look at a log.
struct LogArguments {
  std::string log;
  std::string format = "table";
  std::vector<std::string> robots;
  std::vector<std::string> sources;
  std::vector<std::string> fields;
  std::string text;
  bool events = false;
  std::string last;
  std::string run_for;
};

int check_command(const RunArguments& arguments) {
  const CheckResult result = check(load_config(arguments.config_file, arguments.overrides).config);
  fmt::print("{}", result.text);
  return result.problems == 0 ? 0 : kFailed;
}

int status_command(const LogArguments& arguments) {
  const LogStatus status = read_status(arguments.log, wall_now_us());
  fmt::print("{}", arguments.format == "json" ? status_json(status) : status_text(status));
  return status.alive() ? 0 : kNotRecorded;
}

int tail_command(const LogArguments& arguments) {
  const auto length = [](const std::string& text, const std::string& what) {
    return parse_length(text, what, 0, Micros{3'650} * 86'400'000'000);
  };
  TailOptions options;
  options.log = arguments.log;
  options.robots = arguments.robots;
  options.sources = parse_sources(arguments.sources);
  options.fields = parse_fields(arguments.fields);
  options.answers = !arguments.events;
  options.json = arguments.format == "json";
  const Micros last_us = arguments.last.empty() ? 0 : length(arguments.last, "--last");
  std::optional<Micros> for_us;
  if (!arguments.run_for.empty()) {
    for_us = length(arguments.run_for, "--for");
  }
  Tail(std::move(options), wall_now_us() - last_us).follow(for_us);
  std::clearerr(stdout);  // it ends when nobody reads any more
  return 0;
}

int mark_command(const LogArguments& arguments) {
  const Mark mark{arguments.robots.empty() ? "" : arguments.robots.front(), arguments.text};
  check_mark_text(mark.text);
  if (!mark.robot.empty()) {
    const std::vector<std::filesystem::path> logs{arguments.log};
    std::vector<std::string> names;
    for (const Robot& robot : open_log(logs)->robots()) {
      names.push_back(robot.name);
    }
    if (std::find(names.begin(), names.end(), mark.robot) == names.end()) {
      throw UsageError("--robot " + mark.robot, "no such robot in this log" + did_you_mean(mark.robot, names),
                       fmt::format("the robots are {}", fmt::join(names, ", ")));
    }
  }
  send_mark(arguments.log, mark);
  return 0;
}

void add_log_options(CLI::App& command, LogArguments& arguments) {
  command.add_option("log", arguments.log, "folder of the log")->type_name("LOG")->required();
  command.add_option("--format", arguments.format, "table or json (table)")
      ->check(CLI::IsMember({"table", "json"}))
      ->type_name("FORMAT");
}

void add_tail_options(CLI::App& command, LogArguments& arguments) {
  add_log_options(command, arguments);
  command.add_option("--robot", arguments.robots, "these robots (all)")->delimiter(',')->type_name("NAME");
  command.add_option("--source", arguments.sources, "answers of these sources (all)")
      ->delimiter(',')
      ->type_name("SOURCE");
  command.add_option("--fields", arguments.fields, "fields to show; `tacho-analyzer fields` lists them")
      ->delimiter(',')
      ->type_name("FIELD");
  command.add_flag("--events", arguments.events, "events and gaps alone, no answers");
  command.add_option("--last", arguments.last, "begin with what came in this time: 10min")->type_name("TIME");
  command.add_option("--for", arguments.run_for, "stop after this time")->type_name("TIME");
}

void add_options(CLI::App& command, RunArguments& arguments) {
  Overrides& o = arguments.overrides;
  command.add_option("--config", arguments.config_file, "TOML file; flags win over it (see samples/config/site.toml)");
  command.add_option("--robot", o.robots, "NAME=HOST[:STATUS_PORT[:MODBUS_PORT[:PUSH_PORT]]]; repeat for more robots")
      ->type_name("ROBOT")
      ->allow_extra_args(false);
  command.add_option("--log", o.log, "folder of the log; made when it does not exist")->type_name("DIR");
  command
      .add_option("--sources", o.sources,
                  "record these and no others: " + fmt::format("{}", fmt::join(source_names(), ",")))
      ->join(',')
      ->type_name("LIST");
  command
      .add_option("--period", o.periods,
                  "how often: status=1s,status.idle=5s,io=2Hz,inputs=off (.moving, .idle, .charging: what it is doing)")
      ->join(',')
      ->type_name("LIST");
  command.add_option("--timeout", o.timeout, "longest wait for an answer, connecting included (1s)")->type_name("TIME");
  command.add_option("--unit", o.unit, "Modbus unit id (1)");
  command.add_option("--word-order", o.word_order, "auto, cdab, abcd, badc or dcba (auto)")->type_name("ORDER");
}

int parse_and_run(int argc, char** argv) {
  CLI::App app{"Records SEER Robokit robots: status port and Modbus TCP, read only.", "tacho-recorder"};
  app.set_version_flag("--version", "tacho-recorder " TACHO_VERSION);
  app.require_subcommand(1);
  RunArguments arguments;
  CLI::App* const run_cmd = app.add_subcommand("run", "record until a signal comes or the time is over");
  add_options(*run_cmd, arguments);
  run_cmd->add_option("--for", arguments.run_for, "stop after this time: 60s, 5min, 2h")->type_name("TIME");
  run_cmd->add_option("--commit", arguments.overrides.commit, "how often the log is made durable (1s)")
      ->type_name("TIME");
  run_cmd
      ->add_option("--metrics", arguments.overrides.metrics,
                   "numbers for Prometheus at http://127.0.0.1:PORT/metrics; ADDRESS:PORT opens it to others (off)")
      ->type_name("[ADDRESS:]PORT");
  CLI::App* const check_cmd = app.add_subcommand("check", "connect once, say what would be recorded; writes nothing");
  add_options(*check_cmd, arguments);
  LogArguments of_log;
  CLI::App* const status_cmd =
      app.add_subcommand("status", "how the recording of a log is doing; exit code 3 when nobody records it");
  add_log_options(*status_cmd, of_log);
  CLI::App* const tail_cmd = app.add_subcommand("tail", "follow a log: new answers, events and gaps, one line each");
  add_tail_options(*tail_cmd, of_log);
  CLI::App* const mark_cmd =
      app.add_subcommand("mark", "write a text into the log that is being recorded, as an event");
  mark_cmd->add_option("log", of_log.log, "folder of the log")->type_name("LOG")->required();
  mark_cmd->add_option("text", of_log.text, "what to find again later")->type_name("TEXT")->required();
  mark_cmd->add_option("--robot", of_log.robots, "of this robot (all)")->expected(1)->type_name("NAME");
  std::vector<std::string> commands;
  for (const CLI::App* const command : app.get_subcommands({})) {
    commands.push_back(command->get_name());
  }
  if (const std::string why = not_a_command(argc > 1 ? argv[1] : "", commands); !why.empty()) {
    throw UsageError("arguments", why, "see tacho-recorder --help");
  }
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) {
      return app.exit(error);  // --help, --version
    }
    throw UsageError("arguments", error.what(), "see tacho-recorder --help");
  }
  if (status_cmd->parsed()) {
    return status_command(of_log);
  }
  if (tail_cmd->parsed()) {
    return tail_command(of_log);
  }
  if (mark_cmd->parsed()) {
    return mark_command(of_log);
  }
  return check_cmd->parsed() ? check_command(arguments) : run_command(arguments);
}

/// What was printed must have gone somewhere. A reader that has left is no error.
int with_output(int code) {
  errno = 0;
  if ((std::fflush(stdout) != 0 || std::ferror(stdout) != 0) && errno != EPIPE) {
    throw Error("standard output", errno != 0 ? std::generic_category().message(errno) : "cannot be written",
                "what was printed is not complete");
  }
  return code;
}

}  // namespace
}  // namespace tacho::recorder

int main(int argc, char** argv) {
  try {
    return tacho::recorder::with_output(tacho::recorder::parse_and_run(argc, argv));
  } catch (const tacho::recorder::UsageError& error) {
    fmt::print(stderr, "tacho-recorder: error: {}\n", error.what());
    return tacho::recorder::kUsage;
  } catch (const std::exception& error) {
    fmt::print(stderr, "tacho-recorder: error: {}\n", error.what());
    return tacho::recorder::kFailed;
  }
}
