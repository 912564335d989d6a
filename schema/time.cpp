#include "schema/time.hpp"

#include <date/date.h>
#include <date/tz.h>
#include <fmt/format.h>
#include <time.h>

#include <array>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstdlib>

namespace tacho {

namespace {

constexpr Micros kSecond = 1'000'000;

Micros clock_us(clockid_t id) {
  timespec t{};
  clock_gettime(id, &t);
  return static_cast<Micros>(t.tv_sec) * kSecond + t.tv_nsec / 1000;
}

date::sys_time<std::chrono::microseconds> sys(Micros t_us) {
  return date::sys_time<std::chrono::microseconds>(std::chrono::microseconds(t_us));
}

std::string local_text(Micros local_us) {
  const auto day = date::floor<date::days>(sys(local_us));
  const date::year_month_day ymd(day);
  const Micros of_day_ms = (local_us - day.time_since_epoch() / std::chrono::microseconds(1)) / 1000;
  return fmt::format("{:04}-{:02}-{:02}T{:02}:{:02}:{:02}.{:03}", static_cast<int>(ymd.year()),
                     static_cast<unsigned>(ymd.month()), static_cast<unsigned>(ymd.day()), of_day_ms / 3'600'000,
                     of_day_ms / 60'000 % 60, of_day_ms / 1000 % 60, of_day_ms % 1000);
}

/// Reads characters off a text; each take_ returns false and reads nothing when the text is otherwise.
class Scanner {
 public:
  explicit Scanner(std::string_view text) : text_(text) {}
  bool literal(char c) {
    if (text_.empty() || text_[0] != c) {
      return false;
    }
    text_.remove_prefix(1);
    return true;
  }
  bool digits(std::size_t count, int& out) {
    if (text_.size() < count) {
      return false;
    }
    const auto [end, error] = std::from_chars(text_.data(), text_.data() + count, out);
    if (error != std::errc{} || end != text_.data() + count || out < 0) {
      return false;
    }
    text_.remove_prefix(count);
    return true;
  }
  /// Digits after a decimal point, as microseconds.
  bool fraction(Micros& out) {
    std::size_t n = 0;
    Micros value = 0;
    for (; n < text_.size() && text_[n] >= '0' && text_[n] <= '9'; ++n) {
      value = n < 6 ? value * 10 + (text_[n] - '0') : value;
    }
    for (std::size_t k = n; k < 6; ++k) {
      value *= 10;
    }
    text_.remove_prefix(n);
    out = value;
    return n > 0;
  }
  [[nodiscard]] bool done() const { return text_.empty(); }
  [[nodiscard]] std::string_view rest() const { return text_; }

 private:
  std::string_view text_;
};

/// "+02:00", "-1100", "+02". Empty when it is none of these.
std::optional<int> fixed_offset_s(std::string_view zone) {
  if (zone.empty() || (zone[0] != '+' && zone[0] != '-')) {
    return std::nullopt;
  }
  Scanner scan(zone.substr(1));
  int hours = 0;
  int minutes = 0;
  if (!scan.digits(2, hours)) {
    return std::nullopt;
  }
  scan.literal(':');
  if (!scan.done() && !scan.digits(2, minutes)) {
    return std::nullopt;
  }
  if (!scan.done() || hours > 14 || minutes > 59) {
    return std::nullopt;
  }
  return (zone[0] == '-' ? -1 : 1) * (hours * 3600 + minutes * 60);
}

const date::time_zone* named_zone(std::string_view zone) {
  try {
    return date::locate_zone(std::string(zone));
  } catch (const std::exception&) {
    return nullptr;
  }
}

struct CivilTime {
  int year = 0, month = 0, day = 0, hour = 0, minute = 0, second = 0;
  Micros fraction_us = 0;
};

std::optional<CivilTime> scan_civil(Scanner& scan) {
  CivilTime t;
  if (!scan.digits(4, t.year) || !scan.literal('-') || !scan.digits(2, t.month) || !scan.literal('-') ||
      !scan.digits(2, t.day)) {
    return std::nullopt;
  }
  if (!scan.literal('T') && !scan.literal(' ')) {
    return t;
  }
  if (!scan.digits(2, t.hour) || !scan.literal(':') || !scan.digits(2, t.minute)) {
    return std::nullopt;
  }
  if (scan.literal(':') && (!scan.digits(2, t.second) || (scan.literal('.') && !scan.fraction(t.fraction_us)))) {
    return std::nullopt;
  }
  if (t.hour > 23 || t.minute > 59 || t.second > 60) {
    return std::nullopt;
  }
  return t;
}

}  // namespace

std::optional<int> zone_offset_s(std::string_view zone, Micros t_us) {
  if (zone == "UTC" || zone == "Z") {
    return 0;
  }
  if (const auto fixed = fixed_offset_s(zone)) {
    return fixed;
  }
  const date::time_zone* named = named_zone(zone);
  if (named == nullptr) {
    return std::nullopt;
  }
  return static_cast<int>(named->get_info(sys(t_us)).offset.count());
}

std::string iso_utc(Micros t_us) { return local_text(t_us) + "Z"; }

std::string iso_zone(Micros t_us, std::string_view zone) {
  const int offset = zone_offset_s(zone, t_us).value_or(0);
  if (offset == 0) {
    return iso_utc(t_us);
  }
  const int minutes = std::abs(offset) / 60;
  return local_text(t_us + offset * kSecond) +
         fmt::format("{}{:02}:{:02}", offset < 0 ? '-' : '+', minutes / 60, minutes % 60);
}

std::optional<Micros> parse_time(std::string_view text, std::string_view zone) {
  Scanner scan(text);
  const auto civil = scan_civil(scan);
  if (!civil) {
    return std::nullopt;
  }
  const date::year_month_day ymd(date::year(civil->year), date::month(static_cast<unsigned>(civil->month)),
                                 date::day(static_cast<unsigned>(civil->day)));
  if (!ymd.ok()) {
    return std::nullopt;
  }
  const Micros local = date::sys_days(ymd).time_since_epoch() / std::chrono::microseconds(1) +
                       (civil->hour * 3600 + civil->minute * 60 + civil->second) * kSecond + civil->fraction_us;
  const std::string_view given = scan.rest();
  const std::string_view used = given.empty() ? zone : given;
  // The offset of a named zone depends on UTC, which is what we look for: one correction settles it outside the hour of
  // a switch to or from summer time.
  const auto first = zone_offset_s(used, local);
  if (!first) {
    return std::nullopt;
  }
  const auto second = zone_offset_s(used, local - *first * kSecond);
  return local - second.value_or(*first) * kSecond;
}

std::optional<Micros> parse_duration(std::string_view text) {
  struct Unit {
    std::string_view name;
    double us;
  };
  constexpr std::array<Unit, 9> units{{{"us", 1.0},
                                       {"ms", 1e3},
                                       {"s", 1e6},
                                       {"m", 6e7},
                                       {"min", 6e7},
                                       {"h", 3.6e9},
                                       {"d", 8.64e10},
                                       {"days", 8.64e10},
                                       {"w", 6.048e11}}};
  double number = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc{} || !(number >= 0.0)) {
    return std::nullopt;
  }
  std::string_view unit = text.substr(static_cast<std::size_t>(end - text.data()));
  while (!unit.empty() && unit[0] == ' ') {
    unit.remove_prefix(1);
  }
  for (const Unit& u : units) {
    if (u.name == unit && number * u.us < 9e18) {
      return static_cast<Micros>(std::llround(number * u.us));
    }
  }
  return std::nullopt;
}

std::string duration_text(Micros us) {
  const std::string sign = us < 0 ? "-" : "";
  const Micros a = us < 0 ? -us : us;
  if (a < 1000) {
    return fmt::format("{}{} us", sign, a);
  }
  if (a < kSecond) {
    return fmt::format("{}{} ms", sign, a / 1000);
  }
  const Micros s = a / kSecond;
  if (s < 60) {
    return fmt::format("{}{}.{} s", sign, s, a % kSecond / 100'000);
  }
  if (s < 3600) {
    return fmt::format("{}{} min {:02} s", sign, s / 60, s % 60);
  }
  if (s < 86400) {
    return fmt::format("{}{} h {:02} min {:02} s", sign, s / 3600, s / 60 % 60, s % 60);
  }
  return fmt::format("{}{} d {:02} h {:02} min", sign, s / 86400, s / 3600 % 24, s / 60 % 60);
}

Micros wall_now_us() { return clock_us(CLOCK_REALTIME); }
// Goes on while the host sleeps, so that a night with the lid closed is missed polls and not a clock that was set.
Micros mono_now_us() { return clock_us(CLOCK_BOOTTIME); }

std::string offset_text(Micros us) {
  const double hundredths = std::round(static_cast<double>(us) / 1e4);
  return fmt::format("{:+.2f} s", hundredths == 0 ? 0.0 : hundredths / 100);
}

}  // namespace tacho
