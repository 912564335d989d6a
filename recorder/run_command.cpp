#include "recorder/run_command.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <memory>
#include <optional>
#include <system_error>
#include <utility>

#include "recorder/console.hpp"
#include "recorder/mark.hpp"
#include "recorder/metrics.hpp"
#include "recorder/metrics_server.hpp"
#include "recorder/notify.hpp"
#include "recorder/outlet.hpp"
#include "recorder/recorder.hpp"
#include "schema/time.hpp"

namespace tacho::recorder {

namespace {

constexpr Micros kStatusInterval = 1'000'000;
constexpr Micros kLongestRun = Micros{3'650} * 86'400'000'000;

/// Blocked in every thread and fetched by main alone, so that no code runs inside a handler and a second Ctrl-C while
/// the log is being closed changes nothing.
sigset_t block_signals() {
  sigset_t set;
  sigemptyset(&set);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGUSR1}) {
    sigaddset(&set, signal);
  }
  pthread_sigmask(SIG_BLOCK, &set, nullptr);
  std::signal(SIGPIPE, SIG_IGN);
  return set;
}

std::optional<Micros> run_time(const std::string& text) {
  return text.empty() ? std::nullopt : std::optional<Micros>(parse_length(text, "--for", 1000, kLongestRun));
}

/// A terminal that only prints.
bool dumb() {
  const char* const term = std::getenv("TERM");
  return term == nullptr || std::strcmp(term, "dumb") == 0;
}

/// The recording, and everybody who is kept informed of it.
class Run {
 public:
  explicit Run(const RunArguments& arguments)
      : arguments_(arguments),
        loaded_(load_config(arguments.config_file, arguments.overrides)),
        signals_((require_log(loaded_.config), block_signals())),
        terminal_(isatty(STDERR_FILENO) == 1),
        console_(terminal_ && !dumb()),
        recorder_(loaded_.config, options()) {
    const Config& config = loaded_.config;
    console_.message(fmt::format("recording {} robot{} into {}", config.robots.size(),
                                 config.robots.size() == 1 ? "" : "s", config.log.string()));
    for (const std::string& line : recorder_.outlook()) {
      console_.message(line);
    }
    serve_metrics();
    take_marks();
  }

  int until_end() {
    notifier_.ready();
    while (!recorder_.done() && !ended_by_signal()) {
      tick();
    }
    notifier_.stopping();
    const std::vector<SourceSummary> summary = recorder_.finish();
    console_.status(recorder_.snapshot());
    console_.end_status();
    console_.flush();  // before the table, when both go to one terminal
    print(summary_text(summary));
    if (const std::string why = nothing_recorded(summary); !why.empty()) {
      Outlet(STDERR_FILENO).put(fmt::format("tacho-recorder: error: {}\n", why));
      return 1;
    }
    return 0;
  }

 private:
  /// On standard output, as far as somebody reads it.
  static void print(std::string text) {
    Outlet out(STDOUT_FILENO);
    out.put(std::move(text));
    out.flush(std::chrono::seconds(1));
    if (out.error() != 0) {
      throw Error("standard output", std::generic_category().message(out.error()),
                  "the log is complete, what was printed is not");
    }
  }

  static void require_log(const Config& config) {
    if (config.log.empty()) {
      throw UsageError("log", "no folder given", "use --log DIR, or log = \"DIR\" in the --config file");
    }
  }

  Recorder::Options options() {
    Recorder::Options out;
    out.config_text = loaded_.text;
    out.run_for_us = run_time(arguments_.run_for);
    out.notice = [this](const std::string& text) { console_.message(text); };
    return out;
  }

  /// A port that is taken must not cost the recording.
  void serve_metrics() {
    const std::string& listen = loaded_.config.metrics;
    if (listen.empty()) {
      return;
    }
    try {
      metrics_ = std::make_unique<MetricsServer>(listen, [this] { return metrics_text(recorder_.snapshot()); });
      console_.message(fmt::format("metrics at http://{}/metrics", listen));
    } catch (const Error& error) {
      console_.message(fmt::format("{}; recording goes on without metrics", error.what()));
    }
  }

  /// Nor must a folder that can hold no socket.
  void take_marks() {
    try {
      marks_ = std::make_unique<MarkSocket>(loaded_.config.log);
    } catch (const Error& error) {
      console_.message(fmt::format("{}; recording goes on without", error.what()));
    }
  }

  void mark(const Mark& mark) {
    const std::size_t robots = recorder_.mark(mark);
    console_.message(robots > 0 ? fmt::format("mark: {}", mark.text)
                                : fmt::format("mark for '{}', which is not recorded: {}", mark.robot, mark.text));
  }

  void mark_what_was_told() {
    while (const std::optional<Mark> told = marks_ ? marks_->next() : std::nullopt) {
      mark(*told);
    }
  }

  bool ended_by_signal() {
    const timespec wait{0, 50'000'000};
    const int signal = sigtimedwait(&signals_, nullptr, &wait);
    const bool hung_up = signal == SIGHUP && terminal_ && isatty(STDERR_FILENO) != 1;
    if (signal == SIGHUP && !hung_up) {
      reload();
      return false;
    }
    if (signal == SIGUSR1) {
      mark_what_was_told();  // it came before
      mark({"", "signal SIGUSR1"});
      return false;
    }
    if (signal > 0) {
      console_.message(fmt::format("{}: ending", signal == SIGINT ? "interrupted" : "told to stop"));
    }
    return signal > 0;
  }

  void tick() {
    const Micros now_us = mono_now_us();
    mark_what_was_told();
    const std::string sick = stuck(recorder_.beats());
    if (sick.empty()) {
      notifier_.alive(now_us);
    } else if (sick_.empty()) {
      console_.message(fmt::format("{}{}", sick, notifier_.watchdog_us() ? "; the watchdog is no longer fed" : ""));
    }
    sick_ = sick;
    if (now_us >= next_status_us_) {
      const Snapshot snapshot = recorder_.snapshot();
      console_.status(snapshot);
      notifier_.status(sick.empty() ? Console::status_text(progress_of(snapshot)) : sick);
      next_status_us_ = now_us + kStatusInterval;
    }
  }

  /// Whatever is wrong with the new configuration, the recording goes on with the present one.
  void reload() {
    if (arguments_.config_file.empty()) {
      console_.message("reload: there is no --config file to read again; nothing changed");
      return;
    }
    notifier_.reloading();
    try {
      const LoadedConfig next = load_config(arguments_.config_file, arguments_.overrides);
      console_.message(fmt::format("reload: {}", recorder_.reload(next.config, next.text)));
    } catch (const Error& error) {
      console_.message(fmt::format("reload: {}; nothing changed", error.what()));
    }
    notifier_.ready();
  }

  const RunArguments& arguments_;
  const LoadedConfig loaded_;
  const sigset_t signals_;
  const bool terminal_;
  Console console_;
  Notifier notifier_;
  Recorder recorder_;
  std::unique_ptr<MarkSocket> marks_;
  std::unique_ptr<MetricsServer> metrics_;  // last: its threads ask the recorder
  std::string sick_;
  Micros next_status_us_ = 0;
};

}  // namespace

int run_command(const RunArguments& arguments) { return Run(arguments).until_end(); }

}  // namespace tacho::recorder
