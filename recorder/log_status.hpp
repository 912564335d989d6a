#pragma once
// `tacho-recorder status LOG`: how a recording is doing, from the log alone. Read only; the recorder does not notice.

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "schema/records.hpp"
#include "schema/store/retention.hpp"

namespace tacho::recorder {

struct StreamStatus {
  std::string robot;
  Source source = Source::status;
  Micros period_us = 0;       ///< 0: no longer asked
  Micros last_answer_us = 0;  ///< wall clock; 0: never
  bool late = false;          ///< the last answer is older than it should be; only while recorded
  std::uint64_t stored = 0;   ///< in the whole log, as all counts but the next two
  std::uint64_t missed = 0;
  std::uint64_t last_minute = 0;  ///< answers; while nobody records, of the minute before the newest
  std::array<std::uint64_t, kCauseCount> missed_in_day{};  ///< polls in the day before the newest answer of the log
  std::string lost;                                        ///< why its connection is down; empty: it is up
  std::string word_order;                                  ///< of registers
  std::optional<Micros> clock_offset_us;                   ///< of status: robot's clock minus the host's, last seen
};

struct LogStatus {
  std::filesystem::path log;
  Micros now_us = 0;
  std::string holder;    ///< who records; empty: nobody that can be seen from here
  Session session;       ///< the last one
  Micros newest_us = 0;  ///< newest answer of all; 0: none
  std::size_t parts = 0;
  std::vector<std::string> problems;
  store::RetentionRules rules;  ///< as configured
  store::Forecast forecast;
  std::vector<StreamStatus> streams;  ///< of the last session
  /// Somebody records it: seen by the lock, or by answers that keep coming.
  [[nodiscard]] bool alive() const;
};

/// Throws Error when there is no log.
LogStatus read_status(const std::filesystem::path& log, Micros now_us);

std::string status_text(const LogStatus& status);
/// One JSON object and a line feed.
std::string status_json(const LogStatus& status);

}  // namespace tacho::recorder
