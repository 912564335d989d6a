#pragma once
// How analyses get data: column batches per robot, source and time slice. Anything that can yield slices in order can
// stand behind an analysis: SQLite parts now, a central store later, a vector in a test.

#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "schema/records.hpp"
#include "schema/sample.hpp"

namespace tacho {

/// One field of a batch, struct of arrays: element i belongs to row i of the batch.
struct Column {
  FieldIndex field = kNoField;
  std::vector<State> state;
  std::vector<double> real;           ///< filled for Kind::real, else empty
  std::vector<std::int64_t> integer;  ///< filled for every other kind; text kinds: id into Batch::texts
  [[nodiscard]] bool has(std::size_t row) const { return state[row] == State::present; }
};

/// Rows of one source of one robot, in (session, seq) order, without duplicates. All vectors have `rows()` elements,
/// alarm_begin and point_begin one more.
struct Batch {
  Source source = Source::status;
  std::vector<std::uint64_t> seq;
  std::vector<Micros> t_send_us;
  std::vector<Micros> t_recv_us;
  std::vector<Column> columns;              ///< only the fields asked for
  std::vector<AlarmItem> alarms;            ///< filled when one of fatals / errors / warnings / notices was asked for
  std::vector<std::uint32_t> alarm_begin;   ///< row i has alarms [alarm_begin[i], alarm_begin[i+1])
  std::vector<LevelSet> alarms_incomplete;  ///< by row, filled like alarms; see incomplete()
  std::vector<IoPoint> points;              ///< filled when DI or DO was asked for
  std::vector<std::uint32_t> point_begin;
  TextPool texts;

  [[nodiscard]] std::size_t rows() const { return seq.size(); }
  [[nodiscard]] Micros t_mid_us(std::size_t row) const {
    return t_send_us[row] + (t_recv_us[row] - t_send_us[row]) / 2;
  }
  /// Null when the field was not asked for from this source.
  [[nodiscard]] const Column* find(FieldIndex f) const;
  [[nodiscard]] std::string_view text(const Column& column, std::size_t row) const {
    return texts.at(static_cast<std::uint32_t>(column.integer[row]));
  }
  [[nodiscard]] std::span<const AlarmItem> alarms_of(std::size_t row) const;
  /// The array of this level is present in the row, with elements that could not be read: an alarm that is not among
  /// alarms_of(row) may stand all the same.
  [[nodiscard]] bool incomplete(std::size_t row, AlarmLevel level) const;
  [[nodiscard]] std::span<const IoPoint> points_of(std::size_t row) const;
};

/// A stretch of one robot's log: one session, consecutive rows of every source in arrival order (at most about an
/// hour). Slices of a robot follow each other; a row, gap or event belongs to exactly one slice.
struct Slice {
  RobotId robot = 0;
  SessionId session = 0;
  std::vector<Batch> batches;  ///< one per source that was asked for and has rows here
  std::vector<Gap> gaps;       ///< by t_from_us
  std::vector<Event> events;   ///< by t_us
  std::vector<ClockPoint> clock;
  [[nodiscard]] const Batch* find(Source source) const;
};

struct Window {
  Micros from_us = std::numeric_limits<Micros>::min();
  Micros to_us = std::numeric_limits<Micros>::max();  ///< exclusive
  [[nodiscard]] bool contains(Micros t) const { return t >= from_us && t < to_us; }
};

/// A field and the sources that can give it, best first.
struct Need {
  FieldIndex field = kNoField;
  std::vector<Source> sources;
};

/// Which fields to read from each source.
struct Selection {
  std::array<FieldSet, kSourceCount> fields;
  /// Sources to read even when no field of theirs is asked for (row times only).
  std::array<bool, kSourceCount> rows{};
  /// Hand out gaps, events and clock points too.
  bool records = true;
  void add(Source source, FieldIndex field) {
    fields[static_cast<std::size_t>(source)].set(field);
    rows[static_cast<std::size_t>(source)] = true;
  }
};

/// What the gap rows of one source add up to; partial gaps are not in it.
struct GapSums {
  struct ByCause {
    std::uint64_t polls = 0;
    std::uint64_t gaps = 0;
    Micros length_us = 0;
  };
  std::map<Cause, ByCause> causes;
  std::vector<std::pair<Micros, Micros>> off;  ///< from, to: the recorder was not running
  void add(const Gap& gap);
  void add(const GapSums& more);
};

/// What a log holds of one source of one robot, without opening a body.
struct Coverage {
  RobotId robot = 0;
  Source source = Source::status;
  std::uint64_t stored = 0;
  std::uint64_t missed = 0;   ///< polls inside gap rows, partial gaps not counted
  std::uint64_t planned = 0;  ///< from the schedule; for a session that did not end cleanly, last seq + 1
  std::uint64_t partial = 0;
  std::uint64_t undecodable = 0;
  std::uint64_t bytes = 0;  ///< sum of body lengths as received
  Micros first_us = 0;
  Micros last_us = 0;
  Micros period_us = 0;  ///< planned period of the last session
  FieldSet seen;         ///< fields that were ever not absent
  FieldSet valued;       ///< of them, fields that ever were present, see Sample::valued()
  GapSums gaps;
};

struct UnknownKey {
  RobotId robot = 0;
  Source source = Source::status;
  std::string key;
  Micros first_us = 0;
};

/// A problem met while reading: part, what is damaged, what was skipped.
struct ReadProblem {
  std::string where;
  std::string what;
  bool beside = false;  ///< a file that does not belong to the log, or repeats a part: nothing of the log is damaged
};

/// Thread rule: one thread per RowSource at a time; open one per thread.
class RowSource {
 public:
  virtual ~RowSource() = default;
  [[nodiscard]] virtual std::vector<Robot> robots() const = 0;
  [[nodiscard]] virtual std::vector<Session> sessions() const = 0;
  [[nodiscard]] virtual std::vector<Stream> streams() const = 0;
  [[nodiscard]] virtual std::vector<Coverage> coverage() const = 0;
  [[nodiscard]] virtual std::vector<UnknownKey> unknown_keys() const = 0;
  /// Damage met so far, in opening and in reading.
  [[nodiscard]] virtual std::vector<ReadProblem> problems() const = 0;
  /// Yields the slices of one robot in order. `slice` is only valid during the call.
  virtual void read(RobotId robot, Window window, const Selection& selection,
                    const std::function<void(const Slice&)>& yield) = 0;
  /// Yields every stored answer of one source of one robot in order, byte for byte.
  virtual void read_raw(RobotId robot, Source source, Window window,
                        const std::function<void(const Answer&)>& yield) = 0;
  /// One-minute rollups of a robot by source, minute and field, in portions because a year of them is large. A minute
  /// may be in two portions: their sums add.
  [[nodiscard]] virtual std::size_t rollup_portions() const { return 0; }
  [[nodiscard]] virtual std::vector<Rollup> rollups(RobotId /*robot*/, std::size_t /*portion*/) { return {}; }
};

}  // namespace tacho
