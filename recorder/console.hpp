#pragma once
// Standard error, shared by messages and the status line. The line exists only on a terminal: one line, rewritten.

#include <mutex>
#include <string>
#include <string_view>

#include "recorder/recorder.hpp"

namespace tacho::recorder {

/// Thread-safe.
class Console {
 public:
  explicit Console(bool terminal) : terminal_(terminal) {}
  /// A line of its own: time, text.
  void message(std::string_view text);
  void status(const Progress& progress);
  /// Leaves the status line standing and goes to a new line.
  void end_status();
  /// "robots 3/3  rows 1234  missed 0  queue 0  commit 0.4 ms  12.3 MB"
  static std::string status_text(const Progress& progress);

 private:
  void erase();
  const bool terminal_;
  std::mutex mutex_;
  std::string line_;
};

/// The table printed at the end of a recording: per robot and source planned, stored, missed by cause.
std::string summary_text(const std::vector<SourceSummary>& rows);

/// "nothing was recorded: no answer in time" with the most frequent cause; empty when an answer was stored.
std::string nothing_recorded(const std::vector<SourceSummary>& rows);

/// "12.3 MB"
std::string bytes_text(std::uint64_t bytes);

}  // namespace tacho::recorder
