#pragma once
// Standard error, shared by messages and the dashboard, which exists only on a terminal: below the messages, rewritten
// in place by one write, so that it does not flicker. Nobody waits for it to be read: what does not fit is left out and
// counted.

#include <unistd.h>

#include <chrono>
#include <cstddef>
#include <mutex>
#include <string>
#include <string_view>
#include <vector>

#include "recorder/outlet.hpp"
#include "recorder/recorder.hpp"

namespace tacho::recorder {

/// Thread-safe.
class Console {
 public:
  /// `terminal`: `fd` is one that can show a dashboard.
  explicit Console(bool terminal, int fd = STDERR_FILENO) : terminal_(terminal), fd_(fd) {}
  ~Console() { end_status(); }
  Console(const Console&) = delete;
  Console& operator=(const Console&) = delete;
  /// A line of its own: time, text.
  void message(std::string_view text);
  void status(const Snapshot& snapshot);
  /// Leaves the dashboard standing, the cursor below it and visible.
  void end_status();
  /// Until all is printed, or a second has passed.
  void flush() { outlet_.flush(std::chrono::seconds(1)); }
  /// "robots 3/3  rows 1234  missed 0  queue 0  commit 0.4 ms  12.3 MB"
  static std::string status_text(const Progress& progress);

 private:
  [[nodiscard]] std::string to_top() const;
  [[nodiscard]] std::string block() const;
  const bool terminal_;
  const int fd_;
  std::mutex mutex_;
  std::vector<std::string> lines_;  // of the dashboard that stands; none: a message has taken its place
  bool cursor_hidden_ = false;
  std::size_t lost_ = 0;  // messages since the last one that was taken
  Outlet outlet_{fd_};
};

/// The table printed at the end of a recording: per robot and source planned, stored, missed by cause.
std::string summary_text(const std::vector<SourceSummary>& rows);

/// "nothing was recorded: no answer in time" with the most frequent cause; empty when an answer was stored.
std::string nothing_recorded(const std::vector<SourceSummary>& rows);

/// "12.3 MB"
std::string bytes_text(std::uint64_t bytes);

}  // namespace tacho::recorder
