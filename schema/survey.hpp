#pragma once
// Everything a log holds, decoded once: what is missing, what is there twice, and sums that two logs can be compared
// by.

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <tuple>
#include <vector>

#include "schema/store/coverage.hpp"
#include "schema/store/log_reader.hpp"
#include "schema/store/manifest.hpp"

namespace tacho {

/// Planned polls that are neither stored nor in a gap row; the last poll is `seq_from + seq_count - 1`.
struct Hole {
  std::uint64_t seq_from = 0;
  std::uint64_t seq_count = 0;
  Micros t_from_us = 0;  ///< end of what is known before it, or start of the session
  Micros t_to_us = 0;
};

/// Over the text of all members.
std::uint64_t row_hash(const Gap& gap);
std::uint64_t row_hash(const Event& event);
std::uint64_t row_hash(const ClockPoint& point);

struct StreamSurvey {
  std::uint64_t first = 0;    ///< first poll that can be here
  std::uint64_t planned = 0;  ///< from there on; without a word of the schedule what left a trace
  std::uint64_t from = 0;     ///< first poll that can be here, or is
  std::uint64_t to = 0;       ///< after the last poll that was planned, or is here
  std::uint64_t stored = 0;
  std::uint64_t missed = 0;  ///< by gap rows
  std::uint64_t bytes = 0;
  std::uint64_t undecodable = 0;
  std::uint64_t doubled = 0;     ///< polls that are stored or missed more than once
  std::uint64_t beyond = 0;      ///< polls after the last planned one, or before the first
  std::uint64_t disordered = 0;  ///< answers that repeat or come after a later one
  std::vector<Hole> holes;
};

/// The events that answers lead to, derived again.
struct EventCheck {
  std::uint64_t sessions = 0;  ///< robot by robot
  /// Sessions in which Ingest cannot be repeated exactly, by what stands in the way (literals).
  std::map<std::string_view, std::uint64_t> left_out;
  std::uint64_t derived = 0;
  std::uint64_t only_stored = 0;
  std::uint64_t only_derived = 0;
  std::vector<std::string> first;  ///< differences, the first few
};

/// What a log holds, whatever the order of its rows.
struct LogSums {
  store::Manifest hours;
  store::RowSum gaps;
  store::RowSum events;
  store::RowSum clock;
};

struct Survey : LogSums {
  std::map<store::StreamKey, StreamSurvey> streams;
  std::vector<std::string> wrong_summaries;  ///< coverage that is not what is there
  std::uint64_t wrong_hours = 0;             ///< of closed parts whose answers are not those that were written
  std::vector<std::string> first_hours;      ///< of them, the first few in words
  std::uint64_t wrong_rollups = 0;           ///< rows of closed parts that are not what their answers say
  std::vector<std::string> first_rollups;    ///< of them, the first few in words
  EventCheck event_check;
};

/// Robots of which the log holds anything, by id.
std::vector<RobotId> robots_in(const store::LogReader& log);
/// Reads everything; damage is in log.problems() afterwards.
Survey survey(store::LogReader& log);

}  // namespace tacho
