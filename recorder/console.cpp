#include "recorder/console.hpp"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <functional>
#include <numeric>
#include <utility>

#include "recorder/dashboard.hpp"
#include "schema/time.hpp"

namespace tacho::recorder {

std::string bytes_text(std::uint64_t bytes) {
  constexpr std::array<std::string_view, 4> kUnits{"kB", "MB", "GB", "TB"};
  double value = static_cast<double>(bytes) / 1e3;
  std::size_t unit = 0;
  while (value >= 1000.0 && unit + 1 < kUnits.size()) {
    value /= 1e3;
    ++unit;
  }
  return fmt::format("{:.1f} {}", value, kUnits[unit]);
}

std::string Console::status_text(const Progress& p) {
  return fmt::format("robots {}/{}  rows {}  missed {}  queue {}  commit {:.1f} ms  {}", p.robots_ok, p.robots, p.rows,
                     p.missed, p.queued, static_cast<double>(p.last_commit.count()) / 1e3, bytes_text(p.stored_bytes));
}

namespace {

constexpr const char* kHideCursor = "\x1b[?25l";
constexpr const char* kShowCursor = "\x1b[?25h";
constexpr std::size_t kRoomForDashboards = Outlet::kMostBytes / 8;  // the rest is for messages

Screen screen(int fd) {
  winsize size{};
  if (ioctl(fd, TIOCGWINSZ, &size) != 0 || size.ws_col == 0 || size.ws_row == 0) {
    return {};
  }
  return {size.ws_col, size.ws_row};
}

}  // namespace

/// To where the dashboard begins. In a window that was made narrower its lines take several rows each.
std::string Console::to_top() const {
  const std::size_t columns = screen(fd_).columns;
  std::size_t rows = 0;
  for (const std::string& line : lines_) {
    rows += std::max<std::size_t>(1, (shown_width(line) + columns - 1) / columns);
  }
  return rows == 0 ? "" : fmt::format("\r\x1b[{}A", rows);
}

std::string Console::block() const {
  std::string out;
  for (const std::string& line : lines_) {
    out += line + "\x1b[K\n";
  }
  return lines_.empty() ? "" : out + "\x1b[J";
}

void Console::message(std::string_view text) {
  const std::lock_guard lock(mutex_);
  const std::string lost = lost_ > 0 ? fmt::format("({} messages before this one were not read in time) ", lost_) : "";
  const std::string top = to_top();
  std::vector<std::string> standing = lines_;
  if (outlet_.waiting() > kRoomForDashboards) {
    lines_.clear();  // as long as dozens of messages: the next status() brings it back
  }
  const std::string_view clear = top.empty() ? "" : lines_.empty() ? "\x1b[J" : "\x1b[K";
  const bool taken =
      outlet_.put(fmt::format("{}{} {}{}{}\n{}", top, iso_utc(wall_now_us()), lost, text, clear, block()));
  lost_ = taken ? 0 : lost_ + 1;
  if (!taken) {
    lines_ = std::move(standing);
  }
}

void Console::status(const Snapshot& snapshot) {
  if (!terminal_ || outlet_.waiting() > 0) {
    return;
  }
  const std::lock_guard lock(mutex_);
  const std::string top = kHideCursor + to_top();
  const std::vector<std::string> standing = std::exchange(lines_, dashboard(snapshot, screen(fd_)));
  cursor_hidden_ = true;
  if (!outlet_.put(top + block())) {
    lines_ = standing;
  }
}

void Console::end_status() {
  const std::lock_guard lock(mutex_);
  if (std::exchange(cursor_hidden_, false) && !outlet_.put(kShowCursor)) {
    flush();  // it must not stay so when a burst of messages is still being read
    outlet_.put(kShowCursor);
  }
  lines_.clear();
}

std::string summary_text(const std::vector<SourceSummary>& rows) {
  std::size_t width = 5;
  for (const SourceSummary& row : rows) {
    width = std::max(width, row.robot.size());
  }
  std::string out = fmt::format("{:<{}}  {:<9}  {:>9}  {:>9}  {:>9}  {}\n", "robot", width, "source", "planned",
                                "stored", "missed", "why");
  for (const SourceSummary& row : rows) {
    std::uint64_t missed = 0;
    std::string causes;
    for (std::size_t c = 0; c < row.missed.size(); ++c) {
      missed += row.missed[c];
      if (row.missed[c] > 0) {
        causes +=
            fmt::format("{}{} {}", causes.empty() ? "  " : ", ", cause_name(static_cast<Cause>(c)), row.missed[c]);
      }
    }
    if (row.aged_out > 0) {
      causes += fmt::format("{}{} aged out: nothing happened", causes.empty() ? "  " : ", ", row.aged_out);
    }
    if (row.partial > 0) {
      causes += fmt::format("{}{} stored in part", causes.empty() ? "  " : ", ", row.partial);
    }
    out += fmt::format("{:<{}}  {:<9}  {:>9}  {:>9}  {:>9}{}\n", row.robot, width, source_name(row.source), row.planned,
                       row.stored, missed, causes);
  }
  return out;
}

std::string nothing_recorded(const std::vector<SourceSummary>& rows) {
  std::array<std::uint64_t, kCauseCount> missed{};
  for (const SourceSummary& row : rows) {
    if (row.stored > 0) {
      return "";
    }
    std::transform(missed.begin(), missed.end(), row.missed.begin(), missed.begin(), std::plus<>());
  }
  std::uint64_t& shutdown = missed[static_cast<std::size_t>(Cause::shutdown)];
  if (std::accumulate(missed.begin(), missed.end(), std::uint64_t{0}) > shutdown) {
    shutdown = 0;  // follows from something else
  }
  const auto most = std::max_element(missed.begin(), missed.end());
  const std::string_view why =
      *most == 0 ? "it ended before the first poll" : cause_meaning(static_cast<Cause>(most - missed.begin()));
  return fmt::format("nothing was recorded: {}", why);
}

}  // namespace tacho::recorder
