#pragma once
// Which parts a log gives up, and how long the rest will do. Values and pure functions: no files, no clocks.
//
// Whole parts go, the oldest first, never the newest and never one that is still written or not closed yet.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "schema/sample.hpp"

namespace tacho::store {

/// 0 switches a rule off.
struct RetentionRules {
  Micros age_us = 0;             ///< a part goes when it ended longer ago
  std::uint64_t size_bytes = 0;  ///< the oldest part goes while the log is larger
  /// ... while less than this is free on the disk and removing can change that, or the disk is full
  std::uint64_t reserve_bytes = 0;
};

/// One part, as retention sees it.
struct KeptPart {
  std::uint32_t number = 0;
  std::filesystem::path path;
  std::uint64_t bytes = 0;
  bool closed = false;             ///< nobody writes it, and nothing is left to do for it or can be done now
  std::optional<Micros> ended_us;  ///< UTC, when a confirmed clock saw it closed
  Micros first_us = 0;             ///< of its answers, by whatever clock; 0: none, or not readable
  Micros last_us = 0;
  Micros recorded_us = 0;  ///< polls planned in it times their period: time that no step of a clock can change
};

/// The world around the log at one moment; empty: not known.
struct Surroundings {
  std::optional<Micros> now_us;  ///< UTC, only when the clock is confirmed (clock_trust.hpp)
  std::optional<std::uint64_t> free_bytes;
  bool disk_full = false;  ///< a write has just failed for want of space, whatever free_bytes says
};

enum class RemovalReason : std::uint8_t { age, size, reserve, disk_full };
std::string_view removal_reason_name(RemovalReason reason);

struct Removal {
  std::uint32_t number = 0;
  RemovalReason reason = RemovalReason::age;
};

/// The parts to remove now, oldest first: always the first ones of `parts`, which are in order of their numbers.
///
/// Age is counted from `ended_us`, never from the times of rows, which a wrong clock may have made. A part without it,
/// or with one that is still to come, is as old as the first later part that has one: it ended before that. So a wrong
/// clock makes no part look older than it is, and none is kept for ever.
std::vector<Removal> parts_to_remove(const RetentionRules& rules, std::span<const KeptPart> parts,
                                     const Surroundings& around);

/// How fast the log grows and what that means.
struct Forecast {
  std::uint64_t used_bytes = 0;
  std::optional<std::uint64_t> free_bytes;
  std::optional<double> bytes_per_day;  ///< empty: less than an hour is recorded
  std::optional<double> days_left;      ///< until size or disk say stop; empty: not known, or neither ever will
  std::optional<double> days_kept;      ///< what the log will hold in the end; empty: not known, or no rule removes
};
/// From the newest parts, which tell best what comes.
Forecast forecast(const RetentionRules& rules, std::span<const KeptPart> parts,
                  std::optional<std::uint64_t> free_bytes);
/// "120.3 MB per day; full in 41 days, then the oldest parts go"
std::string forecast_text(const Forecast& forecast, const RetentionRules& rules);
/// "parts older than 90 d, a log above 20.0 GB, less than 1.0 GB free"; "nothing is ever removed".
std::string rules_text(const RetentionRules& rules);
/// "12.3 MB"; powers of 1024, as part_size and [retention] are given.
std::string size_text(std::uint64_t bytes);

}  // namespace tacho::store
