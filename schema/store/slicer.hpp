#pragma once
// Cuts the rows of one robot into slices and hands out gaps, events and clock points with them, each exactly once.

#include <array>
#include <functional>
#include <map>
#include <optional>
#include <vector>

#include "schema/batch_builder.hpp"
#include "schema/row_source.hpp"

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
  /// `selection` and `yield` must outlive the slicer.
  Slicer(RobotId robot, const Selection& selection, const Yield& yield);

  void begin_part(PartRecords records);
  /// Rows in order of arrival. Sessions never come back.
  void add(const Sample& sample);
  /// Yields what is left of the part.
  void end_part();

  /// A slice is cut before it spans more time or more rows of one source than this.
  static constexpr Micros kSpanUs = 3'600'000'000;
  static constexpr std::size_t kRows = 4096;

 private:
  struct Waiting {
    std::vector<Gap> gaps;
    std::vector<Event> events;
    std::vector<ClockPoint> clock;
  };
  RobotId robot_;
  const Yield* yield_;
  std::array<std::optional<BatchBuilder>, kSourceCount> builders_;
  std::map<SessionId, Waiting> waiting_;  ///< not yet handed out, per session
  std::optional<SessionId> session_;      ///< of the rows collected so far
  Micros first_us_ = 0;

  void yield_rows(std::optional<Micros> until_us);
  void yield_sessions_before(SessionId session);
  void emit(SessionId session, std::optional<Micros> until_us);
};

}  // namespace tacho::store
