#pragma once
// Cuts the rows of one robot into slices and hands out gaps, events and clock points with them, each exactly once.

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <vector>

#include "schema/batch_builder.hpp"
#include "schema/row_source.hpp"
#include "schema/store/column_scan.hpp"
#include "schema/store/input_gates.hpp"

namespace tacho::store {

/// Records of one part, by session and time.
struct PartRecords {
  std::vector<Gap> gaps;
  std::vector<Event> events;
  std::vector<ClockPoint> clock;
};

class Slicer {
 public:
  using Yield = std::function<void(const Slice&)>;
  /// The arguments must outlive the slicer.
  Slicer(RobotId robot, const Selection& selection, InputGates& gates, const Yield& yield);

  void begin_part(PartRecords records);
  /// Reads the scan to its end. Sessions never come back.
  void rows(ColumnScan& scan);
  /// Yields what is left of the part.
  void end_part();

  /// A slice is cut before it spans more time than this, one of several sources also before it has more rows of one of
  /// them.
  static constexpr Micros kSpanUs = 3'600'000'000;
  static constexpr std::size_t kRows = 4096;

 private:
  struct Waiting {
    std::vector<Gap> gaps;
    std::vector<Event> events;
    std::vector<ClockPoint> clock;
  };
  /// Rows of one source that were read, from `at` in the first chunk on.
  struct Lane {
    std::deque<Chunk> chunks;
    std::size_t at = 0;
  };
  /// Where a slice ends: before the row at this place, at this time, or with its session.
  struct Cut {
    std::int64_t place;
    std::optional<Micros> t_us;
  };
  RobotId robot_;
  const Yield* yield_;
  InputGates* gates_;
  ColumnScan* scan_ = nullptr;  ///< of rows()
  std::array<std::optional<BatchBuilder>, kSourceCount> builders_;
  std::array<bool, kSourceCount> reads_{};  ///< sources that are read, also those nobody asked for
  std::array<Lane, kSourceCount> lanes_;
  std::array<Chunk, 2> single_;                ///< of a single source: one that is handed out, and the next
  std::vector<std::int64_t> register_places_;  ///< of the rows of the slice that is being made
  std::map<SessionId, Waiting> waiting_;       ///< not yet handed out, per session
  Slice slice_;

  bool fill(std::size_t source, std::size_t chunk, std::int64_t before);
  std::optional<std::size_t> first_lane();
  Cut find_cut(SessionId session, Micros first_us);
  void shorten(std::size_t source, SessionId session, Micros first_us, Cut& cut);
  void take_all(std::int64_t before);
  void take_rows(std::size_t source, std::int64_t before);
  void one_source(std::size_t source);
  void cut_up(std::size_t source, const Chunk& chunk, std::optional<Micros> until_us);
  void yield_sessions_before(SessionId session);
  void finish_batches(SessionId session);
  void recycle_batches();
  void emit(SessionId session, std::optional<Micros> until_us);
};

}  // namespace tacho::store
