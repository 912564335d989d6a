// tacho-analyzer: answers from a log. Options are read here and nowhere else; the work is in commands/ and analyses/.

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <csignal>
#include <cstdio>
#include <functional>
#include <string_view>

#include "analyzer/analyses/incident.hpp"
#include "analyzer/analysis.hpp"
#include "analyzer/commands/common.hpp"
#include "analyzer/commands/export.hpp"
#include "analyzer/commands/fields.hpp"
#include "analyzer/commands/info.hpp"
#include "analyzer/commands/report.hpp"
#include "analyzer/commands/sql.hpp"
#include "analyzer/commands/verify.hpp"
#include "schema/text.hpp"
#include "schema/time.hpp"

namespace {

using namespace tacho;
using namespace tacho::commands;

/// Options of the commands that have their own.
struct Extra {
  std::string at;
  std::string before = "60s";
  std::string after = "30s";
  ExportOptions exports;
};

class Program {
 public:
  Program() : app_("Answers from the log of a robot recorder.", "tacho-analyzer") {
    app_.set_version_flag("--version", "tacho-analyzer " TACHO_VERSION);
    app_.require_subcommand(1);
    app_.footer(
        "Results go to standard output, everything else to standard error.\n"
        "Exit codes: 0 done, 1 failed, 2 wrong usage, 3 findings at or above --fail-on.");
    add_info();
    for (const AnalysisSpec& spec : analyses()) {
      add_analysis(spec);
    }
    add_incident();
    add_report();
    add_export();
    add_sql();
    add_verify();
    add_tables();
  }

  int run(int argc, char** argv) {
    refuse_unknown_command(argc, argv);
    refuse_png_without_maps(argc, argv);
    try {
      app_.parse(argc, argv);
    } catch (const CLI::ParseError& e) {
      if (e.get_exit_code() == 0) {
        app_.exit(e);  // --help, --version
        return kExitOk;
      }
      std::fprintf(stderr, "tacho-analyzer: error: %s; see tacho-analyzer --help\n", e.what());
      return kExitUsage;
    }
    return action_();
  }

 private:
  CLI::App app_;
  Options options_;
  Extra extra_;
  std::function<int()> action_;

  CLI::App* command(const std::string& name, const std::string& what, std::function<int()> action) {
    CLI::App* sub = app_.add_subcommand(name, what);
    sub->callback([this, action = std::move(action)] { action_ = action; });
    return sub;
  }

  void log_options(CLI::App* sub) {
    sub->add_option("LOG", options_.logs, "folder of a log, or its parts")->required();
    sub->add_option("--robot", options_.robots, "only this robot; may be repeated");
    sub->add_option("--tz", options_.zone, "time zone of days and of times given without one")->capture_default_str();
    sub->add_option("--config", options_.config, "thresholds and facts about the robots (TOML)");
  }
  void window_options(CLI::App* sub) {
    sub->add_option("--from", options_.from, "from this time on");
    sub->add_option("--to", options_.to, "up to, not including, this time");
  }
  void format_options(CLI::App* sub, const std::vector<std::string>& formats) {
    sub->add_option("--format", options_.format, "how results are written")
        ->check(CLI::IsMember(formats))
        ->default_str(formats.front());
    const bool png = std::find(formats.begin(), formats.end(), "png") != formats.end();
    sub->add_option("-o,--output", options_.output,
                    std::string("write to this file; for --format csv ") + (png ? "and png " : "") + "a folder");
  }
  void table_options(CLI::App* sub) {
    sub->add_option("--table", options_.table, "with --format csv: the one table to print");
    sub->add_flag("--all", options_.all, "every row of every table");
    sub->add_option("--fail-on", options_.fail_on, "exit with 3 when a finding is at or above it")
        ->check(CLI::IsMember({"warn", "fail"}));
  }

  int print(const Section& section, const Job& job) {
    tell_problems(*job.log);
    return emit(section, job.origin(), options_);
  }

  void add_info() {
    CLI::App* sub = command("info", "What the log holds, and what is missing", [this] {
      Job job = open_job(options_);
      return print(info(*job.log, job.info()), job);
    });
    log_options(sub);
    window_options(sub);
    format_options(sub, {"table", "json", "csv"});
    table_options(sub);
  }

  void add_analysis(const AnalysisSpec& spec) {
    CLI::App* sub = command(std::string(spec.name), std::string(spec.question), [this, &spec] {
      Job job = open_job(options_);
      return print(run_analysis(spec, *job.log, job.robot_ids(), job.window, options_.zone, job.settings), job);
    });
    log_options(sub);
    window_options(sub);
    if (spec.maps) {
      format_options(sub, {"table", "json", "csv", "png"});
    } else {
      format_options(sub, {"table", "json", "csv"});
    }
    table_options(sub);
  }

  void add_incident() {
    CLI::App* sub = command("incident", "What happened around one moment?", [this] { return run_incident(); });
    log_options(sub);
    sub->add_option("--at", extra_.at, "the moment")->required();
    sub->add_option("--before", extra_.before, "how much before it")->capture_default_str();
    sub->add_option("--after", extra_.after, "how much after it")->capture_default_str();
    format_options(sub, {"table", "json", "csv"});
    table_options(sub);
  }

  void add_report() {
    CLI::App* sub = command("report", "Every analysis, as a folder of JSON, CSV and PNG", [this] {
      Job job = open_job(options_);
      return report_all(job);
    });
    log_options(sub);
    window_options(sub);
    sub->add_option("-o,--output", options_.output, "the folder; an earlier report in it is replaced")->required();
    sub->add_option("--fail-on", options_.fail_on, "exit with 3 when a finding is at or above it")
        ->check(CLI::IsMember({"warn", "fail"}));
  }

  void add_export() {
    CLI::App* sub = command("export", "Rows as CSV, JSON lines or a SQLite file, or the answers byte for byte", [this] {
      Job job = open_job(options_);
      if (extra_.exports.raw) {
        export_raw(job, extra_.exports);
      } else if (options_.format == "sqlite") {
        export_database(job, extra_.exports);
      } else {
        export_rows(job, extra_.exports);
      }
      tell_problems(*job.log);
      return kExitOk;
    });
    log_options(sub);
    window_options(sub);
    sub->add_option("--source", extra_.exports.source, "status, io, registers or inputs");
    sub->add_option("--fields", extra_.exports.fields, "only these fields, separated by commas")->delimiter(',');
    sub->add_flag("--states", extra_.exports.states, "say of each missing value why it is missing");
    sub->add_flag("--raw", extra_.exports.raw, "the stored answers, each followed by a newline; -o DIR: a file each");
    format_options(sub, {"csv", "json", "sqlite"});
    sub->get_option("--output")->description("write to this file; with --raw a folder; sqlite needs it, as a new file");
  }

  void add_sql() {
    CLI::App* sub = command("sql", "One SELECT over the whole log", [this] {
      if (options_.logs.size() < 2) {
        throw UsageError("sql: a log and a statement are needed; write sql LOG \"select robot, count(*) from status\"");
      }
      const std::string statement = options_.logs.back();
      options_.logs.pop_back();
      options_.all = true;  // how many rows is for the statement to say
      Job job = open_job(options_);
      return run_sql(job, statement);
    });
    sub->add_option("LOG SQL", options_.logs,
                    "folder of a log, or its parts; then the statement. Tables: status, registers, inputs, io, robot, "
                    "session, stream, coverage, gap, event, clock, unknown_key, problem, field, code")
        ->required();
    format_options(sub, {"table", "json", "csv"});
    sub->get_option("--output")->description("write to this file");
  }

  void add_verify() {
    CLI::App* sub = command("verify", "Is everything in the log there and whole?", [this] { return verify(options_); });
    sub->add_option("LOG", options_.logs, "folder of a log, or its parts")->required();
    format_options(sub, {"table", "json", "csv"});
    table_options(sub);
    sub = command("recover", "What can be read of a log, as a new log", [this] { return recover_log(options_); });
    sub->add_option("LOG", options_.logs, "folder of a log, or its parts")->required();
    sub->add_option("-o,--output", options_.output, "the new folder")->required();
  }

  void add_tables() {
    const auto table = [this](const char* name, const char* what, Section (*make)()) {
      CLI::App* sub = command(name, what, [this, make] {
        options_.all = true;
        report::Origin origin;
        origin.tool = "tacho-analyzer " TACHO_VERSION;
        return emit(make(), origin, options_);
      });
      format_options(sub, {"table", "json", "csv"});
      sub->add_option("--table", options_.table, "with --format csv: the one table to print");
    };
    table("fields", "What each column means and where it comes from", &fields);
    table("settings", "Thresholds and facts that --config can give, with their defaults", &settings);
  }

  int run_incident() {
    const auto duration = [](const char* option, const std::string& text) {
      const std::optional<Micros> value = parse_duration(text);
      if (!value || *value < 0) {
        throw UsageError(std::string(option) + " " + text + ": no duration; write 60s, 5min or 1h");
      }
      return *value;
    };
    IncidentQuery query;
    query.before_us = duration("--before", extra_.before);
    query.after_us = duration("--after", extra_.after);
    query.zone = options_.zone;
    Job job = open_job(options_);  // checks the zone before a time is read in it
    query.at_us = time_option("--at", extra_.at, options_.zone);
    job.window = {query.at_us - query.before_us, query.at_us + query.after_us};
    const std::vector<Session> sessions = job.log->sessions();
    const bool recording = std::any_of(sessions.begin(), sessions.end(), [&](const Session& s) {
      return s.t_start_us < job.window.to_us && (s.t_end_us == 0 || s.t_end_us >= job.window.from_us);
    });
    if (!recording) {  // while it recorded, gaps alone can be the answer
      require_answers(job, "--at " + extra_.at);
    }
    options_.rows = 200;  // the time line is the answer
    return print(incident(*job.log, job.robot_ids(), query, job.settings), job);
  }

  static void refuse_png_without_maps(int argc, char** argv) {
    for (const AnalysisSpec& spec : analyses()) {
      if (argc < 2 || argv[1] != spec.name || spec.maps) {
        continue;
      }
      for (int i = 2; i < argc; ++i) {
        const std::string_view word = argv[i];
        if (word == "--format=png" || (word == "--format" && i + 1 < argc && std::string_view(argv[i + 1]) == "png")) {
          throw UsageError(std::string(spec.name) + " has curves only; use --format csv -o DIR");
        }
      }
    }
  }

  void refuse_unknown_command(int argc, char** argv) {
    if (argc < 2 || argv[1][0] == '-') {
      return;
    }
    std::vector<std::string> names;
    for (const CLI::App* sub : app_.get_subcommands(nullptr)) {
      names.push_back(sub->get_name());
    }
    if (std::find(names.begin(), names.end(), argv[1]) == names.end()) {
      throw UsageError(std::string(argv[1]) + ": no such command" + did_you_mean(argv[1], names) +
                       "; --help lists the commands");
    }
  }
};

/// Parts of a log are mapped into memory: a page that the disk cannot give ends the program, with words.
void explain_unreadable_page(int) {
  constexpr std::string_view kWords =
      "tacho-analyzer: error: a file of the log cannot be read: the disk gives an error, or the file became shorter "
      "while it was read. `tacho-analyzer verify` names the damage, `recover` copies what is left\n";
  [[maybe_unused]] const ssize_t written = ::write(STDERR_FILENO, kWords.data(), kWords.size());
  ::_exit(kExitFailed);
}

}  // namespace

int main(int argc, char** argv) {
  std::signal(SIGBUS, explain_unreadable_page);
  try {
    return Program().run(argc, argv);
  } catch (const UsageError& error) {
    std::fprintf(stderr, "tacho-analyzer: error: %s\n", error.what());
    return kExitUsage;
  } catch (const SettingsError& error) {
    std::fprintf(stderr, "tacho-analyzer: error: %s\n", error.what());
    return kExitUsage;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "tacho-analyzer: error: %s\n", error.what());
    return kExitFailed;
  }
}
