#include "schema/store/retention.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <numeric>

#include "schema/time.hpp"

namespace tacho::store {

namespace {

constexpr std::array<std::string_view, 4> kReasons{"age", "size", "reserve", "disk_full"};
constexpr Micros kHourUs = 3'600'000'000;
constexpr double kDayUs = 86'400e6;
constexpr Micros kEnoughUs = 7 * 24 * kHourUs;  // of recording, to tell how fast a log grows

/// When the part had ended at the latest; empty: no confirmed clock has seen that yet.
std::optional<Micros> ended_by(std::span<const KeptPart> parts, std::size_t i, Micros now_us) {
  for (; i < parts.size(); ++i) {
    if (parts[i].ended_us && *parts[i].ended_us <= now_us) {
      return parts[i].ended_us;
    }
  }
  return std::nullopt;
}

bool too_old(const RetentionRules& rules, std::span<const KeptPart> parts, std::size_t i, const Surroundings& around) {
  if (rules.age_us == 0 || !around.now_us) {
    return false;
  }
  const std::optional<Micros> ended = ended_by(parts, i, *around.now_us);
  return ended && *around.now_us - *ended >= rules.age_us;
}

std::uint64_t bytes_of(std::span<const KeptPart> parts) {
  return std::accumulate(parts.begin(), parts.end(), std::uint64_t{0},
                         [](std::uint64_t sum, const KeptPart& part) { return sum + part.bytes; });
}

/// Growth as the newest parts tell it.
std::optional<double> growth(std::span<const KeptPart> parts) {
  Micros recorded_us = 0;
  std::uint64_t bytes = 0;
  for (auto part = parts.rbegin(); part != parts.rend() && recorded_us < kEnoughUs; ++part) {
    if (part->recorded_us > 0) {
      recorded_us += part->recorded_us;
      bytes += part->bytes;
    }
  }
  if (recorded_us < kHourUs) {
    return std::nullopt;
  }
  return static_cast<double>(bytes) * kDayUs / static_cast<double>(recorded_us);
}

std::optional<double> smaller(std::optional<double> a, std::optional<double> b) {
  return a && b ? std::min(*a, *b) : a ? a : b;
}

/// Where all parts together are not enough (somebody else has filled the disk, or the reserve is a mistake) removing
/// them would gain nothing: they stay until a write fails.
bool reserve_can_be_reached(const RetentionRules& rules, std::span<const KeptPart> parts, const Surroundings& around) {
  if (rules.reserve_bytes == 0 || !around.free_bytes) {
    return false;
  }
  std::uint64_t reached = *around.free_bytes;
  for (std::size_t i = 0; i + 1 < parts.size() && parts[i].closed; ++i) {
    reached += parts[i].bytes;
  }
  return reached >= rules.reserve_bytes;
}

}  // namespace

std::string_view removal_reason_name(RemovalReason reason) { return kReasons[static_cast<std::size_t>(reason)]; }

std::vector<Removal> parts_to_remove(const RetentionRules& rules, std::span<const KeptPart> parts,
                                     const Surroundings& around) {
  std::vector<Removal> out;
  std::uint64_t used = bytes_of(parts);
  std::uint64_t freed = 0;
  const bool reachable = reserve_can_be_reached(rules, parts, around);
  for (std::size_t i = 0; i + 1 < parts.size() && parts[i].closed; ++i) {
    const bool low = reachable && *around.free_bytes + freed < rules.reserve_bytes;
    const bool full = rules.reserve_bytes > 0 && around.disk_full && out.empty();
    if (too_old(rules, parts, i, around)) {
      out.push_back({parts[i].number, RemovalReason::age});
    } else if (rules.size_bytes > 0 && used > rules.size_bytes) {
      out.push_back({parts[i].number, RemovalReason::size});
    } else if (full) {
      out.push_back({parts[i].number, RemovalReason::disk_full});
    } else if (low) {
      out.push_back({parts[i].number, RemovalReason::reserve});
    } else {
      break;
    }
    used -= parts[i].bytes;
    freed += parts[i].bytes;
  }
  return out;
}

Forecast forecast(const RetentionRules& rules, std::span<const KeptPart> parts,
                  std::optional<std::uint64_t> free_bytes) {
  Forecast out;
  out.used_bytes = bytes_of(parts);
  out.free_bytes = free_bytes;
  out.bytes_per_day = growth(parts);
  if (!out.bytes_per_day || *out.bytes_per_day <= 0.0) {
    return out;
  }
  const auto days = [&](std::uint64_t bytes) { return static_cast<double>(bytes) / *out.bytes_per_day; };
  const auto above = [](std::uint64_t a, std::uint64_t b) { return a > b ? a - b : 0; };
  std::optional<double> disk_days;
  if (free_bytes) {
    disk_days = days(above(*free_bytes, rules.reserve_bytes));
  }
  std::optional<double> size_days;
  if (rules.size_bytes > 0) {
    size_days = days(above(rules.size_bytes, out.used_bytes));
  }
  out.days_left = smaller(disk_days, size_days);
  std::optional<double> kept;
  if (rules.size_bytes > 0) {
    kept = days(rules.size_bytes);
  }
  if (rules.reserve_bytes > 0 && free_bytes) {
    kept = smaller(kept, days(out.used_bytes + above(*free_bytes, rules.reserve_bytes)));
  }
  if (rules.age_us > 0) {
    const double age_days = static_cast<double>(rules.age_us) / kDayUs;
    if (out.days_left && days(out.used_bytes) + *out.days_left > age_days) {
      out.days_left.reset();  // age keeps the log from growing that large
    }
    kept = smaller(kept, age_days);
  }
  out.days_kept = kept;
  return out;
}

std::string size_text(std::uint64_t bytes) {
  constexpr std::array<std::string_view, 5> kUnits{"B", "KB", "MB", "GB", "TB"};
  auto value = static_cast<double>(bytes);
  std::size_t unit = 0;
  while (value >= 1024.0 && unit + 1 < kUnits.size()) {
    value /= 1024.0;
    ++unit;
  }
  return fmt::format("{:.{}f} {}", value, unit == 0 ? 0 : 1, kUnits[unit]);
}

std::string rules_text(const RetentionRules& rules) {
  std::vector<std::string> words;
  if (rules.age_us > 0) {
    words.push_back(fmt::format("it ended more than {} ago", duration_text(rules.age_us)));
  }
  if (rules.size_bytes > 0) {
    words.push_back(fmt::format("the log is above {}", size_text(rules.size_bytes)));
  }
  if (rules.reserve_bytes > 0) {
    words.push_back(fmt::format("less than {} of the disk is free", size_text(rules.reserve_bytes)));
  }
  return words.empty() ? "nothing is ever removed"
                       : fmt::format("the oldest closed part is removed when {}", fmt::join(words, ", or "));
}

std::string forecast_text(const Forecast& f, const RetentionRules& rules) {
  const std::string room = f.free_bytes ? fmt::format(", {} free on the disk", size_text(*f.free_bytes)) : "";
  const std::string used = fmt::format("the log has {}{}", size_text(f.used_bytes), room);
  if (!f.bytes_per_day) {
    return used + "; how fast it grows is known after an hour of recording";
  }
  std::string text =
      fmt::format("{}, and grows by {} a day", used, size_text(static_cast<std::uint64_t>(*f.bytes_per_day)));
  if (f.days_left) {
    const bool removes = rules.size_bytes > 0 || rules.reserve_bytes > 0;
    text += fmt::format(": room for {:.1f} days{}", *f.days_left, removes ? ", then the oldest parts go" : "");
  }
  if (f.days_kept) {
    text += fmt::format("; it will keep about {:.1f} days", *f.days_kept);
  }
  return text;
}

}  // namespace tacho::store
