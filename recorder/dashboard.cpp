#include "recorder/dashboard.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <optional>

#include "recorder/console.hpp"
#include "schema/time.hpp"

namespace tacho::recorder {

namespace {

constexpr std::size_t kGap = 2;  // between columns
constexpr std::size_t kLongestName = 20;

/// One robot, all its sources together.
struct Row {
  std::string name;
  std::array<std::optional<bool>, kProtocolCount> up;  // by Protocol; empty: not asked
  std::uint64_t stored = 0;
  std::uint64_t missed = 0;
  std::array<std::uint64_t, kCauseCount> causes{};
  Micros slowest_us = 0;  // of the newest round trips
  Micros age_us = -1;     // of its newest answer; -1: none
  std::optional<Micros> clock_us;
  [[nodiscard]] const std::optional<bool>& link(Protocol protocol) const {
    return up[static_cast<std::size_t>(protocol)];
  }
  [[nodiscard]] bool trouble() const {
    return std::any_of(up.begin(), up.end(), [](const std::optional<bool>& link) { return !link.value_or(true); });
  }
};

std::vector<Row> rows_of(const Snapshot& snapshot) {
  std::vector<Row> rows;
  const auto row = [&rows](const std::string& name) -> Row& {
    const auto found = std::find_if(rows.begin(), rows.end(), [&](const Row& r) { return r.name == name; });
    if (found != rows.end()) {
      return *found;
    }
    rows.emplace_back().name = name;
    return rows.back();
  };
  for (const LinkNow& link : snapshot.links) {
    row(link.robot).up[static_cast<std::size_t>(link.protocol)] = link.up;
  }
  for (const StreamNow& stream : snapshot.streams) {
    if (stream.period_us == 0) {
      continue;  // no longer asked
    }
    Row& r = row(stream.robot);
    r.stored += stream.stored;
    r.missed += stream.missed_total();
    for (std::size_t c = 0; c < kCauseCount; ++c) {
      r.causes[c] += stream.missed[c];
    }
    r.slowest_us = std::max(r.slowest_us, stream.last_round_trip_us);
    if (stream.last_answer_us > 0) {
      const Micros age_us = std::max<Micros>(0, snapshot.now_us - stream.last_answer_us);
      r.age_us = r.age_us < 0 ? age_us : std::min(r.age_us, age_us);
    }
    if (const auto offset = snapshot.clock_offset_us.find(stream.robot); offset != snapshot.clock_offset_us.end()) {
      r.clock_us = offset->second;
    }
  }
  return rows;
}

std::string link_text(const std::optional<bool>& up) { return !up ? "off" : *up ? "up" : "DOWN"; }

std::string seconds_text(Micros us) { return fmt::format("{:.1f} s", static_cast<double>(us) / 1e6); }

std::string cause_text(const Row& row) {
  const auto most = std::max_element(row.causes.begin(), row.causes.end());
  return *most == 0 ? "" : std::string(cause_name(static_cast<Cause>(most - row.causes.begin())));
}

struct ScreenColumn {
  std::string_view title;
  std::size_t width;
  bool right;  ///< aligned
  int rank;    ///< on a narrow screen those with the highest go first
  std::string (*text)(const Row&);
};
// clang-format off
constexpr std::array kColumns{
    ScreenColumn{"robot", 0, false, 0, [](const Row& r) { return r.name; }},  // as wide as the longest
    ScreenColumn{"status", 6, false, 1, [](const Row& r) { return link_text(r.link(Protocol::status_port)); }},
    ScreenColumn{"modbus", 6, false, 2, [](const Row& r) { return link_text(r.link(Protocol::modbus)); }},
    ScreenColumn{"push", 6, false, 9, [](const Row& r) { return link_text(r.link(Protocol::push_port)); }},
    ScreenColumn{"last answer", 12, true, 4,
           [](const Row& r) {
             return r.age_us < 0 ? "never" : r.age_us < 60'000'000 ? seconds_text(r.age_us) : duration_text(r.age_us / 1'000'000 * 1'000'000);
           }},
    ScreenColumn{"stored", 10, true, 5, [](const Row& r) { return fmt::format("{}", r.stored); }},
    ScreenColumn{"missed", 8, true, 3, [](const Row& r) { return fmt::format("{}", r.missed); }},
    ScreenColumn{"slowest", 10, true, 6,
           [](const Row& r) { return r.slowest_us == 0 ? "" : fmt::format("{:.1f} ms", static_cast<double>(r.slowest_us) / 1e3); }},
    ScreenColumn{"clock", 10, true, 7,
           [](const Row& r) { return r.clock_us ? offset_text(*r.clock_us) : ""; }},
    ScreenColumn{"missed by", 16, false, 8, cause_text},
};
// clang-format on

/// The columns that fit, in their order.
std::vector<ScreenColumn> columns_for(std::size_t room, std::size_t name_width) {
  std::vector<ScreenColumn> columns(kColumns.begin(), kColumns.end());
  columns.front().width = std::min(name_width, room);
  const auto width = [&] {
    std::size_t sum = 0;
    for (const ScreenColumn& column : columns) {
      sum += column.width + kGap;
    }
    return sum - kGap;
  };
  while (columns.size() > 1 && width() > room) {
    columns.erase(std::max_element(columns.begin(), columns.end(),
                                   [](const ScreenColumn& a, const ScreenColumn& b) { return a.rank < b.rank; }));
  }
  return columns;
}

template <class Text>
std::string line_of(const std::vector<ScreenColumn>& columns, const Text& text) {
  std::string out;
  for (const ScreenColumn& column : columns) {
    const std::string cell = text(column);
    const std::size_t pad = column.width - std::min(column.width, shown_width(cell));
    out += out.empty() ? "" : std::string(kGap, ' ');
    out += fitted(column.right ? std::string(pad, ' ') + cell : cell, column.width);
  }
  out.erase(out.find_last_not_of(' ') + 1);
  return out;
}

std::string head_line(const Snapshot& snapshot, std::size_t columns) {
  std::string text = Console::status_text(progress_of(snapshot));
  if (snapshot.forecast.days_left) {
    text += fmt::format("  {:.0f} days left", *snapshot.forecast.days_left);
  }
  std::string out = fitted(text, columns);
  out.erase(out.find_last_not_of(' ') + 1);
  return out;
}

/// Code point at `at`, which moves behind it. Bytes that are no UTF-8 are a code point each.
char32_t next_point(std::string_view text, std::size_t& at) {
  const auto byte = static_cast<unsigned char>(text[at++]);
  const int more = byte >= 0xF0 ? 3 : byte >= 0xE0 ? 2 : byte >= 0xC0 ? 1 : 0;
  char32_t point = more == 0 ? byte : byte & (0x3FU >> more);
  for (int i = 0; i < more && at < text.size() && (static_cast<unsigned char>(text[at]) & 0xC0U) == 0x80; ++i) {
    point = point << 6U | (static_cast<unsigned char>(text[at++]) & 0x3FU);
  }
  return point;
}

/// From Hangul on, scripts are written in squares.
std::size_t width_of(char32_t point) { return point >= 0x1100 ? 2 : 1; }

}  // namespace

std::size_t shown_width(std::string_view text) {
  std::size_t width = 0;
  for (std::size_t at = 0; at < text.size();) {
    width += width_of(next_point(text, at));
  }
  return width;
}

std::string fitted(std::string_view text, std::size_t width) {
  std::string out;
  std::size_t used = 0;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t begin = at;
    const char32_t point = next_point(text, at);
    if (used + width_of(point) > width) {
      break;
    }
    used += width_of(point);
    const bool control = point < 0x20 || point == 0x7F || (point >= 0x80 && point < 0xA0);
    out += control ? std::string_view("?") : text.substr(begin, at - begin);
  }
  return out + std::string(width - used, ' ');
}

std::vector<std::string> dashboard(const Snapshot& snapshot, Screen screen) {
  std::vector<std::string> lines{head_line(snapshot, screen.columns)};
  const std::size_t room = screen.rows > 1 ? screen.rows - 1 : 1;  // the cursor stands below
  std::vector<Row> rows = rows_of(snapshot);
  if (room < 4 || rows.empty()) {
    return lines;
  }
  std::size_t name_width = 5;
  for (const Row& row : rows) {
    name_width = std::max(name_width, std::min(kLongestName, shown_width(row.name)));
  }
  const std::vector<ScreenColumn> columns = columns_for(screen.columns, name_width);
  lines.push_back(line_of(columns, [](const ScreenColumn& column) { return std::string(column.title); }));
  std::size_t count = rows.size();
  if (count > room - 2) {
    std::stable_partition(rows.begin(), rows.end(), [](const Row& row) { return row.trouble(); });
    count = room - 3;
  }
  for (std::size_t i = 0; i < count; ++i) {
    lines.push_back(line_of(columns, [&](const ScreenColumn& column) { return column.text(rows[i]); }));
  }
  if (count < rows.size()) {
    const auto begin = rows.begin() + static_cast<std::ptrdiff_t>(count);
    const auto down = std::count_if(begin, rows.end(), [](const Row& row) { return row.trouble(); });
    std::string rest = fmt::format("and {} more, {}", rows.size() - count,
                                   down == 0 ? "all connected" : fmt::format("{} of them not connected", down));
    rest = fitted(rest, screen.columns);
    rest.erase(rest.find_last_not_of(' ') + 1);
    lines.push_back(rest);
  }
  return lines;
}

}  // namespace tacho::recorder
