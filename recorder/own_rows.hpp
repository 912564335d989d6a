#pragma once
// Rows of the log that no link tells and no answer gives: what the recorder itself did. Stamped with the time of the
// call.

#include <string>

#include "recorder/config.hpp"
#include "schema/records.hpp"

namespace tacho::recorder {

/// A stream, and a poll of it.
struct StreamPoll {
  SessionId session = 0;
  RobotId robot = 0;
  Source source = Source::status;
  std::uint64_t seq = 0;
};

/// What a source of a configured robot is asked, and how often at first.
Stream stream_of(const RobotConfig& robot, const StreamPoll& first);
/// From this poll on the source is asked at another rate; 0: not at all.
Event rate_event(const StreamPoll& from, Micros was_us, Micros is_us, const std::string& why);
/// Nothing was planned since the last answer, at `from_us`, until now.
Gap pause_gap(const StreamPoll& next, Micros from_us, const std::string& why);
/// `text`: of the new configuration.
Event config_event(SessionId session, const std::string& what_changed, const std::string& text);
Event mark_event(SessionId session, const std::string& text);
/// Of the robot that was recorded. `row`: where the other one is recorded.
Event identity_event(SessionId session, RobotId robot, const std::string& row);

}  // namespace tacho::recorder
