#include "schema/row_source.hpp"

namespace tacho {

const Column* Batch::find(FieldIndex f) const {
  for (const Column& column : columns) {
    if (column.field == f) {
      return &column;
    }
  }
  return nullptr;
}

std::span<const AlarmItem> Batch::alarms_of(std::size_t row) const {
  if (alarm_begin.empty()) {
    return {};
  }
  return std::span(alarms).subspan(alarm_begin[row], alarm_begin[row + 1] - alarm_begin[row]);
}

bool Batch::incomplete(std::size_t row, AlarmLevel level) const {
  return row < alarms_incomplete.size() && alarms_incomplete[row][static_cast<std::size_t>(level)];
}

std::span<const IoPoint> Batch::points_of(std::size_t row) const {
  if (point_begin.empty()) {
    return {};
  }
  return std::span(points).subspan(point_begin[row], point_begin[row + 1] - point_begin[row]);
}

void GapSums::add(const Gap& gap) {
  if (gap.partial) {
    return;
  }
  ByCause& sum = causes[gap.cause];
  sum.polls += gap.seq_count;
  sum.length_us += gap.t_to_us - gap.t_from_us;
  ++sum.gaps;
  if (gap.cause == Cause::recorder_off) {
    off.emplace_back(gap.t_from_us, gap.t_to_us);
  }
}

void GapSums::add(const GapSums& more) {
  for (const auto& [cause, other] : more.causes) {
    ByCause& sum = causes[cause];
    sum.polls += other.polls;
    sum.gaps += other.gaps;
    sum.length_us += other.length_us;
  }
  off.insert(off.end(), more.off.begin(), more.off.end());
}

const Batch* Slice::find(Source source) const {
  for (const Batch& batch : batches) {
    if (batch.source == source) {
      return &batch;
    }
  }
  return nullptr;
}

}  // namespace tacho
