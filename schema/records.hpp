#pragma once
// Rows of a log that are not answers: robots, sessions, streams, gaps, events, clock points.

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "schema/sample.hpp"

namespace tacho {

/// A robot as configured (name, address) and as it says it is (vehicle_id, mac, model_md5).
struct Robot {
  RobotId id = 0;
  std::string name;     ///< the user's name for it, unique in a log
  std::string address;  ///< where it was found, host:status_port:modbus_port
  std::string vehicle_id;
  std::string mac;
  std::string model_md5;
  std::string firmware;  ///< registers 37-40, "3.4.6.18"
};

/// One start of the recorder (or of the simulator's `write`).
struct Session {
  SessionId id = 0;
  Micros t_start_us = 0;
  Micros t_end_us = 0;   ///< 0 while running or after a kill
  bool clean = false;    ///< ended by a signal or at the end of --for
  std::string software;  ///< "tacho-recorder 0.1.0"
  std::string config;    ///< configuration text, verbatim
  std::string host;      ///< host name and zone offset
};

enum class WordOrder : std::uint8_t { cdab, abcd, badc, dcba };
std::string_view word_order_name(WordOrder order);
bool parse_word_order(std::string_view name, WordOrder& out);

/// One source of one robot in one session. `planned` counts polls the schedule asked for, also the missed ones, and is
/// kept by the scheduler, not derived from gaps: "stored + missed = planned" is a real check.
struct Stream {
  SessionId session = 0;
  RobotId robot = 0;
  Source source = Source::status;
  Micros period_us = 0;
  WordOrder word_order = WordOrder::cdab;
  std::string request;                   ///< request body, or register ranges "1-100,120-140"
  std::optional<std::uint64_t> planned;  ///< set when the session ends; empty while running
};

/// Why planned polls have no answer. Names are stored in the log: append only.
enum class Cause : std::uint8_t {
  connect_refused,
  connect_timeout,
  unreachable,
  timeout,
  closed,
  malformed,
  wrong_sequence,
  error_frame,
  client_limit,
  modbus_exception,
  overrun,
  backoff,  ///< of older recordings: outages carry the cause they began with
  queue_full,
  disk,
  recorder_off,     ///< no polls were planned: between two sessions, or while the source was off
  recorder_killed,  ///< lost with the process: not yet committed when it died
  shutdown,
  damaged,      ///< was in a log of which this one holds what could be read
  other_robot,  ///< answered by a robot with another identity
};
inline constexpr std::size_t kCauseCount = static_cast<std::size_t>(Cause::other_robot) + 1;
std::string_view cause_name(Cause cause);
std::string_view cause_meaning(Cause cause);

/// Planned polls without an answer: seq_from..seq_to, both inclusive. For recorder_off there are none and seq_count is
/// 0. `partial`: the poll is stored, but some of its register ranges are not; those do not count as missed.
struct Gap {
  RobotId robot = 0;
  Source source = Source::status;
  SessionId session = 0;
  std::uint64_t seq_from = 0;
  std::uint64_t seq_count = 0;
  Micros t_from_us = 0;  ///< last good answer, or when the first missed poll was due
  Micros t_to_us = 0;    ///< first good answer after, or the last missed due time
  Cause cause = Cause::timeout;
  bool partial = false;
  std::string detail;  ///< words of the system or the robot, or the ranges that failed
};

/// What happened, as derived from the answers while recording (schema/events.hpp) or reported by the links.
/// Names are stored in the log: append only.
enum class EventKind : std::uint8_t {
  link_up,
  link_down,
  client_limit,
  error_frame,
  no_sequence_echo,
  alarm_raised,
  alarm_cleared,
  alarm_repeated,
  blocked,
  slowed,
  emergency,
  driver_emergency,
  charging,
  station,
  task,
  map,
  localisation,
  reboot,
  digital_input,
  digital_output,
  control_owner,
  identity,
  rate,
  word_order,
  unknown_key,
  undecodable,
  clock_step,
  mark,
  part_removed,      ///< retention has removed a part of the log; of no robot
  config_changed,    ///< the recorder goes on with another configuration, its text is in detail; of no robot
  identity_changed,  ///< another robot answers where this one was found; its row is in detail
  pose_jump,
  ring_kept,  ///< a trigger had the ring written; subject: the trigger, values: answers aged out and kept
};
inline constexpr std::size_t kEventKindCount = 33;
std::string_view event_kind_name(EventKind kind);
/// Values of an event `rate`, exactly: "off" (0), "200 ms", "1.0 s". The other way round; empty when it is none.
std::string rate_text(Micros period_us);
std::optional<Micros> parse_rate(std::string_view text);

/// An edge seen between two polls: it happened in (t_from_us, t_us]. For things without a previous poll both are equal.
struct Event {
  RobotId robot = 0;
  SessionId session = 0;
  Source source = Source::status;
  EventKind kind = EventKind::mark;
  std::uint64_t seq = 0;  ///< answer it was seen in
  Micros t_from_us = 0;
  Micros t_us = 0;
  std::string subject;    ///< alarm "error 52201", input "DI 3", empty where the kind says it all
  std::string old_value;  ///< as text; empty when unknown
  std::string new_value;
  std::string detail;  ///< alarm description, robot's own words
};

/// Host wall clock, host monotonic clock and, where known, the robot's clock, at one instant.
struct ClockPoint {
  RobotId robot = 0;  ///< 0: host clocks only
  SessionId session = 0;
  Micros wall_us = 0;
  Micros mono_us = 0;
  std::optional<Micros> robot_us;  ///< robot clock as UTC
};

/// What one field of one source did in one minute. Only cells that are present count.
struct Rollup {
  RobotId robot = 0;
  Source source = Source::status;
  std::int64_t minute = 0;  ///< UTC minutes since 1970, by the middle of the answers (AnswerMeta::t_mid_us)
  FieldIndex field = kNoField;
  std::uint64_t rows = 0;
  double min = 0;
  double max = 0;
  double sum = 0;
  double last = 0;  ///< in order of arrival
  /// `later` is of the same field and minute, and arrived after this.
  void add(const Rollup& later);
};

}  // namespace tacho
