#pragma once
// What the commands share: options, the opened log, and where results go.

#include <filesystem>
#include <iosfwd>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "analyzer/commands/info.hpp"
#include "analyzer/report/json.hpp"
#include "analyzer/report/section.hpp"
#include "analyzer/settings.hpp"
#include "schema/row_source.hpp"
#include "schema/store/log_reader.hpp"

namespace tacho::commands {

inline constexpr int kExitOk = 0;
inline constexpr int kExitFailed = 1;
inline constexpr int kExitUsage = 2;
inline constexpr int kExitFindings = 3;

/// The command line makes no sense: exit code 2.
class UsageError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Options as typed.
struct Options {
  std::vector<std::string> logs;
  std::vector<std::string> robots;  ///< empty = all
  std::string from;
  std::string to;
  std::string zone = "UTC";
  std::string format = "table";  ///< table, json, csv, png
  std::string output;            ///< empty = standard output
  std::string config;
  std::string fail_on;  ///< "", "warn", "fail"
  std::string table;    ///< the one table of --format csv on standard output
  bool all = false;
  std::size_t rows = 25;  ///< of a table on a terminal, unless `all`
};

/// An opened log and the options, understood.
struct Job {
  Options options;
  std::unique_ptr<RowSource> log;
  const store::LogReader* reader = nullptr;  ///< the same log when it is made of parts, else null
  std::vector<Robot> robots;                 ///< chosen ones, by id
  Window window;
  Settings settings;

  [[nodiscard]] std::vector<RobotId> robot_ids() const;
  [[nodiscard]] report::Origin origin() const;
  [[nodiscard]] InfoQuery info() const;
};

/// Throws UsageError (unknown robot with "did you mean", times, zone, a period outside the log) or Error (log,
/// configuration).
Job open_job(const Options& options);

/// Throws UsageError when no stored answer of the chosen robots lies in the window: "nothing there" would else look
/// like a result. `what`: the option that asked for it. A log without any answer says so in its results.
void require_answers(const Job& job, const std::string& what);

/// Names on standard error what was damaged or foreign in what has been read so far; returns how many. For after
/// reading.
std::size_t tell_problems(const RowSource& log);

/// The time in `text`, which `what` (an option) gave. Throws UsageError.
Micros time_option(const std::string& what, const std::string& text, const std::string& zone);

/// Writes the result where the options say, and returns the exit code that --fail-on asks for.
int emit(const Section& section, const report::Origin& origin, const Options& options);

/// kExitFindings when a finding is at or above `fail_on`, else kExitOk.
int exit_code(const std::vector<Finding>& findings, const std::string& fail_on);

/// Text to the file -o names, or to standard output. Throws Error when it cannot be written.
void write_result(const std::string& text, const Options& options);
/// Standard output, checked: a full disk or closed pipe behind it is an Error.
void write_stdout(std::string_view text);

/// For tables, whose whole numbers are signed.
constexpr std::int64_t count(std::uint64_t n) { return static_cast<std::int64_t>(n); }

}  // namespace tacho::commands
