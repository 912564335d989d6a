#pragma once
// One stored answer (Answer) and one decoded answer (Sample).

#include <array>
#include <bitset>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "schema/fields.hpp"

namespace tacho {

/// Microseconds since 1970-01-01 UTC by the host's wall clock, or a difference of two.
using Micros = std::int64_t;

/// Numbers and names are stored in the log: append only. What is known of each is a row of kSources (sample.cpp).
enum class Source : std::uint8_t { status, io, registers, inputs, pose, push, ring };
inline constexpr std::size_t kSourceCount = 7;
/// What the body of an answer is.
enum class Encoding : std::uint8_t { json, registers, inputs };
/// By which connection of a robot its answers come; names are for people.
enum class Protocol : std::uint8_t { status_port, modbus, push_port };
inline constexpr std::size_t kProtocolCount = 3;
struct SourceInfo {
  std::string_view name;
  Encoding encoding;
  Protocol protocol;
  bool whole = false;  ///< its answers are everything the robot says, as those of status are
};
const SourceInfo& source_info(Source source);
std::string_view source_name(Source source);
/// Of all sources, in their order.
std::vector<std::string> source_names();
std::string_view protocol_name(Protocol protocol);
/// All of them, in their order.
const std::array<Source, kSourceCount>& all_sources();
/// What source `pose` asks 1100 for: where the robot is and how it moves. Nothing of it is an edge that makes an event,
/// so that the fast poll does not tell everything twice.
inline constexpr std::array<std::string_view, 8> kPoseKeys{"x", "y", "angle", "confidence", "vx", "vy", "w", "odo"};
/// False when there is no source of this name.
bool parse_source(std::string_view name, Source& out);

using RobotId = std::uint32_t;    ///< row of the `robot` table, from 1
using SessionId = std::uint32_t;  ///< row of the `session` table (one start of the recorder), from 1

/// What identifies a stored answer. Order is (robot, source, session, seq) everywhere, never the wall clock.
struct AnswerMeta {
  RobotId robot = 0;
  Source source = Source::status;
  SessionId session = 0;
  std::uint64_t seq = 0;  ///< number of the planned poll, from 0; a missed poll uses up a number
  Micros t_send_us = 0;   ///< request handed to the kernel
  Micros t_recv_us = 0;   ///< last byte of the answer read
  [[nodiscard]] Micros t_mid_us() const { return t_send_us + (t_recv_us - t_send_us) / 2; }
};

/// One stored answer, byte for byte. `body` is the JSON body of a Robokit frame, or a register image
/// (wire/registers.hpp).
struct Answer {
  AnswerMeta meta;
  std::string body;
  std::string header;  ///< the 16 frame header bytes when they are unusual (see wire/frame.hpp), else empty
};

/// Absent, null, not meaningful now, not supplied and zero are five different things, down to the report.
enum class State : std::uint8_t {
  absent,          ///< the key or register was not in the answer
  null,            ///< the key was there and its value was null
  not_meaningful,  ///< given, but its condition is false or unknown (block_reason while not blocked)
  not_supplied,    ///< given, but the value is the documented "no sensor" mark; the value is kept
  wrong_type,      ///< given, but not decodable as the field's kind (text where a number belongs); kept in raw only
  present,
};
std::string_view state_name(State state);

struct Cell {
  State state = State::absent;
  double real = 0.0;         ///< Kind::real
  std::int64_t integer = 0;  ///< integer, flag (0/1), code; count for alarms and points; text id for the rest
  [[nodiscard]] bool has() const { return state == State::present; }
};

enum class AlarmLevel : std::uint8_t { fatal, error, warning, notice };
inline constexpr std::size_t kAlarmLevels = 4;
/// A set of alarm levels, one bit each.
using LevelSet = std::bitset<kAlarmLevels>;
std::string_view alarm_level_name(AlarmLevel level);

/// One element of fatals / errors / warnings / notices. Text members are ids into the sample's or batch's texts, 0 =
/// none.
struct AlarmItem {
  AlarmLevel level = AlarmLevel::fatal;
  std::int64_t code = 0;
  std::int64_t stamp_s = 0;  ///< robot clock, unix seconds; 0 when not given
  std::int64_t times = 0;    ///< repetitions inside one continuous alarm; 0 when not given
  std::uint32_t desc = 0;
  std::uint32_t solution = 0;  ///< describe / method / reason, joined by newlines, when the answer carries them
};

/// One element of DI / DO.
struct IoPoint {
  bool output = false;
  bool status = false;
  std::int8_t valid = -1;  ///< 1, 0, or -1 when not given
  std::int32_t id = 0;
  std::uint32_t source = 0;  ///< text id of "normal", "virtual", "modbus", ...
};

/// Interned texts of a Sample or Batch. Id 0 is the empty text. Views live as long as the pool is not cleared.
class TextPool {
 public:
  TextPool() { clear(); }
  void clear();
  std::uint32_t intern(std::string_view text);
  [[nodiscard]] std::string_view at(std::uint32_t id) const;
  [[nodiscard]] std::size_t size() const { return spans_.size(); }

 private:
  struct Span {
    std::uint32_t begin;
    std::uint32_t length;
  };
  std::string bytes_;
  std::vector<Span> spans_;
  std::vector<std::uint32_t> slots_;  // open addressing, 0 = free
  void rehash(std::size_t slots);
};

/// One decoded answer. Reused from row to row: decoders clear it first. Not thread-safe.
struct Sample {
  AnswerMeta meta;
  std::array<Cell, kFieldCount> cells;
  std::vector<AlarmItem> alarms;          ///< by level, in a level in the order of the answer
  LevelSet alarms_incomplete;             ///< levels with elements that could not be read: `alarms` has the others only
  std::vector<IoPoint> points;            ///< DI then DO
  std::vector<std::string> unknown_keys;  ///< paths no field names, sorted, each once
  TextPool texts;
  bool decodable = true;  ///< false: the body is not JSON (or not a register image); raw only

  void clear();
  [[nodiscard]] const Cell& at(FieldIndex f) const { return cells[f]; }
  [[nodiscard]] std::string_view text(FieldIndex f) const {
    return texts.at(static_cast<std::uint32_t>(cells[f].integer));
  }
  /// Fields whose state is not absent.
  [[nodiscard]] FieldSet seen() const;
  /// Fields that are present. Not those that are not meaningful: under a condition that is false or unknown nobody can
  /// tell a value from the mark for "no sensor", and a source that never knows the condition never has a usable value.
  [[nodiscard]] FieldSet valued() const;
};

/// The last known value of the flags that conditions name, carried from the `inputs` source to the `registers` source,
/// whose own answer does not contain them ([3x]44 is only meaningful while [1x]2).
struct Gates {
  FieldSet known;
  FieldSet on;
};

}  // namespace tacho
