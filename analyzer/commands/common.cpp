#include "analyzer/commands/common.hpp"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <optional>

#include "analyzer/commands/progress.hpp"
#include "analyzer/report/csv.hpp"
#include "analyzer/report/folder.hpp"
#include "analyzer/report/png.hpp"
#include "analyzer/report/terminal.hpp"
#include "schema/error.hpp"
#include "schema/log.hpp"
#include "schema/text.hpp"
#include "schema/time.hpp"

namespace tacho::commands {
namespace {

namespace fs = std::filesystem;

std::string listed(const std::vector<std::string>& names) {
  std::string out;
  for (const std::string& name : names) {
    out += (out.empty() ? "" : ", ") + name;
  }
  return out;
}

std::vector<Robot> choose_robots(const RowSource& log, const std::vector<std::string>& wanted) {
  std::vector<Robot> robots = log.robots();
  std::sort(robots.begin(), robots.end(), [](const Robot& a, const Robot& b) { return a.id < b.id; });
  if (wanted.empty()) {
    return robots;
  }
  std::vector<std::string> names;
  for (const Robot& robot : robots) {
    names.push_back(robot.name);
  }
  for (const std::string& name : wanted) {
    if (std::find(names.begin(), names.end(), name) == names.end()) {
      throw UsageError("--robot " + name + ": no such robot in this log" + did_you_mean(name, names) +
                       (names.empty() ? "" : " (robots: " + listed(names) + ")"));
    }
  }
  std::erase_if(robots,
                [&](const Robot& r) { return std::find(wanted.begin(), wanted.end(), r.name) == wanted.end(); });
  return robots;
}

void warn_about_settings(const Settings& settings, const RowSource& log) {
  std::vector<std::string> names;
  for (const Robot& robot : log.robots()) {
    names.push_back(robot.name);
  }
  for (const std::string& robot : settings.robots()) {
    if (std::find(names.begin(), names.end(), robot) == names.end()) {
      std::fprintf(stderr, "tacho-analyzer: warning: [robot.%s] in the configuration: no such robot in this log%s\n",
                   robot.c_str(), did_you_mean(robot, names).c_str());
    }
  }
}

std::string csv_of_one_table(const Section& section, const std::string& wanted) {
  std::vector<DataTable> tables{report::findings_table(section), report::evidence_table(section)};
  tables.insert(tables.end(), section.tables.begin(), section.tables.end());
  std::vector<std::string> names;
  for (const DataTable& table : tables) {
    names.push_back(table.name);
  }
  const bool findings_first = wanted.empty() && (!section.findings.empty() || section.tables.empty());
  const std::string name = !wanted.empty() ? wanted : findings_first ? "findings" : section.tables.front().name;
  const auto at = std::find(names.begin(), names.end(), name);
  if (at == names.end()) {
    throw UsageError("--table " + name + ": no such table" + did_you_mean(name, names) + " (tables: " + listed(names) +
                     ")");
  }
  if (wanted.empty() && names.size() > 1) {
    std::fprintf(stderr, "tacho-analyzer: this is table '%s'; --table NAME gives another (%s), -o DIR all\n",
                 name.c_str(), listed(names).c_str());
  }
  return report::csv_text(tables[static_cast<std::size_t>(at - names.begin())]);
}

void write_files(const std::vector<report::File>& files, const std::string& folder) {
  for (const report::File& file : files) {
    report::write_file(fs::path(folder) / file.name, file.bytes);
  }
}

void emit_csv(const Section& section, const Options& options) {
  if (options.output.empty() || fs::path(options.output).extension() == ".csv") {
    write_result(csv_of_one_table(section, options.table), options);
    return;
  }
  write_files(report::csv_files(section), options.output);
}

void emit_png(const Section& section, const Options& options) {
  if (options.output.empty()) {
    throw UsageError("--format png writes files: give a folder with -o");
  }
  const std::vector<report::File> files = report::png_files(section);
  if (files.empty()) {
    throw Error(section.name, "has no map to draw", "the findings (--format table) say why, or use another format");
  }
  write_files(files, options.output);
}

}  // namespace

std::vector<RobotId> Job::robot_ids() const {
  std::vector<RobotId> ids;
  for (const Robot& robot : robots) {
    ids.push_back(robot.id);
  }
  return ids;
}

report::Origin Job::origin() const {
  report::Origin origin;
  origin.tool = "tacho-analyzer " TACHO_VERSION;
  origin.window = window;
  origin.zone = options.zone;
  for (const Robot& robot : robots) {
    origin.robots.push_back(robot.name);
  }
  std::vector<std::string> prefixes{""};
  for (const std::string& robot : settings.robots()) {
    prefixes.push_back(robot);
  }
  for (const std::string& robot : prefixes) {
    for (const SettingRow& row : setting_rows()) {
      const SettingValue general = settings.get(row.name);
      const SettingValue value = settings.get(row.name, robot);
      if (!robot.empty() && value.value == general.value && value.source == general.source) {
        continue;
      }
      Quantity quantity;
      quantity.value = value.value;
      quantity.unit = row.unit;
      quantity.reason = value.value ? "" : "not configured";
      origin.settings.push_back({(robot.empty() ? "" : robot + "/") + std::string(row.name), quantity, value.source});
    }
  }
  return origin;
}

InfoQuery Job::info() const { return {robots, reader, settings, window, options.zone}; }

Micros time_option(const std::string& what, const std::string& text, const std::string& zone) {
  const std::optional<Micros> t = parse_time(text, zone);
  if (!t) {
    throw UsageError(what + " " + text +
                     ": no time; write 2026-01-08, \"2026-01-08 14:32:10\" or 2026-01-08T14:32:10Z");
  }
  return *t;
}

Job open_job(const Options& options) {
  Job job;
  job.options = options;
  if (!zone_offset_s(options.zone, wall_now_us())) {
    throw UsageError("--tz " + options.zone + ": no such time zone; write UTC, +02:00 or a name like Europe/Berlin");
  }
  if (!options.from.empty()) {
    job.window.from_us = time_option("--from", options.from, options.zone);
  }
  if (!options.to.empty()) {
    job.window.to_us = time_option("--to", options.to, options.zone);
  }
  if (job.window.from_us >= job.window.to_us) {
    throw UsageError("--from " + options.from + " is not before --to " + options.to);
  }
  if (!options.config.empty()) {
    job.settings = Settings::load(options.config);
  }
  const std::vector<fs::path> paths(options.logs.begin(), options.logs.end());
  job.log = open_log_fast(paths);
  job.reader = dynamic_cast<const store::LogReader*>(job.log.get());
  job.robots = choose_robots(*job.log, options.robots);
  warn_about_settings(job.settings, *job.log);
  if (!options.from.empty() || !options.to.empty()) {
    require_answers(job, options.to.empty() ? "--from" : options.from.empty() ? "--to" : "--from/--to");
  }
  if (isatty(STDERR_FILENO) == 1) {
    job.log = std::make_unique<ProgressLog>(std::move(job.log), job.robots, job.window);
  }
  return job;
}

void require_answers(const Job& job, const std::string& what) {
  std::optional<Window> covered;
  for (const Coverage& c : job.log->coverage()) {
    const bool chosen =
        std::any_of(job.robots.begin(), job.robots.end(), [&](const Robot& r) { return r.id == c.robot; });
    if (c.stored == 0 || !chosen) {
      continue;
    }
    if (c.last_us >= job.window.from_us && c.first_us < job.window.to_us) {
      return;
    }
    covered = covered ? Window{std::min(covered->from_us, c.first_us), std::max(covered->to_us, c.last_us)}
                      : Window{c.first_us, c.last_us};
  }
  if (!covered) {
    return;
  }
  const auto text = [&](Micros t_us) { return iso_zone(t_us, job.options.zone); };
  const Window open;
  const std::string asked = job.window.to_us == open.to_us ? "from " + text(job.window.from_us) + " on"
                            : job.window.from_us == open.from_us
                                ? "before " + text(job.window.to_us)
                                : "between " + text(job.window.from_us) + " and " + text(job.window.to_us);
  throw UsageError(what + ": no answer " + asked + (job.options.robots.empty() ? "" : " of the chosen robots") +
                   "; the log covers " + text(covered->from_us) + " to " + text(covered->to_us));
}

int emit(const Section& section, const report::Origin& origin, const Options& options) {
  if (options.format == "json") {
    write_result(report::json_text({&section, 1}, origin), options);
  } else if (options.format == "csv") {
    emit_csv(section, options);
  } else if (options.format == "png") {
    emit_png(section, options);
  } else {
    report::TerminalOptions terminal;
    terminal.zone = options.zone;
    terminal.colour = options.output.empty() && isatty(STDOUT_FILENO) == 1;
    terminal.all = options.all;
    terminal.rows = options.rows;
    write_result(report::terminal_text(section, terminal), options);
  }
  return exit_code(section.findings, options.fail_on);
}

std::size_t tell_problems(const RowSource& log) {
  const std::vector<ReadProblem> problems = log.problems();
  for (const ReadProblem& problem : problems) {
    std::fprintf(stderr, "tacho-analyzer: warning: %s: %s\n", problem.where.c_str(), problem.what.c_str());
  }
  return problems.size();
}

int exit_code(const std::vector<Finding>& findings, const std::string& fail_on) {
  const bool reached = std::any_of(findings.begin(), findings.end(), [&](const Finding& f) {
    return (fail_on == "fail" && f.verdict == Verdict::fail) ||
           (fail_on == "warn" && (f.verdict == Verdict::fail || f.verdict == Verdict::warn));
  });
  return reached ? kExitFindings : kExitOk;
}

void write_stdout(std::string_view text) {
  errno = 0;
  if (std::fwrite(text.data(), 1, text.size(), stdout) != text.size() || std::fflush(stdout) != 0) {
    throw Error("standard output", std::strerror(errno), "use -o to write a file");
  }
}

void write_result(const std::string& text, const Options& options) {
  if (options.output.empty()) {
    write_stdout(text);
  } else {
    report::write_file(options.output, text);
  }
}

}  // namespace tacho::commands
