#pragma once
// Standard error, shared by messages and the dashboard, which exists only on a terminal: below the messages, rewritten
// in place by one write, so that it does not flicker. Nobody waits for it to be read: what does not fit is left out and
// counted.

#include <unistd.h>

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
  explicit Console(bool terminal) : terminal_(terminal) {}
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
  std::mutex mutex_;
  std::vector<std::string> lines_;
  std::size_t lost_ = 0;  // messages since the last one that was taken
  Outlet outlet_{STDERR_FILENO};
};

/// The table printed at the end of a recording: per robot and source planned, stored, missed by cause.
std::string summary_text(const std::vector<SourceSummary>& rows);

/// "nothing was recorded: no answer in time" with the most frequent cause; empty when an answer was stored.
std::string nothing_recorded(const std::vector<SourceSummary>& rows);

/// "12.3 MB"
std::string bytes_text(std::uint64_t bytes);

}  // namespace tacho::recorder
