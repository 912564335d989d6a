#include "schema/store/slicer.hpp"

#include <algorithm>
#include <cstdlib>
#include <iterator>
#include <limits>
#include <utility>

namespace tacho::store {

namespace {

constexpr std::int64_t kEnd = std::numeric_limits<std::int64_t>::max();
constexpr auto kRegisters = static_cast<std::size_t>(Source::registers);
constexpr auto kInputs = static_cast<std::size_t>(Source::inputs);

/// Moves the rows before `until` (all when empty) from the front of `from` to `to`.
template <class Row, class Time>
void move_until(std::vector<Row>& from, std::vector<Row>& to, std::optional<Micros> until, Time time) {
  const auto end =
      until ? std::find_if(from.begin(), from.end(), [&](const Row& row) { return time(row) >= *until; }) : from.end();
  to.assign(std::make_move_iterator(from.begin()), std::make_move_iterator(end));
  from.erase(from.begin(), end);
}

/// The first of rows [begin, end) that is too far from a time to be in one slice with it, or `end`.
std::size_t first_far(const std::vector<Micros>& t_us, std::size_t begin, std::size_t end, Micros first_us) {
  const auto far =
      std::find_if(t_us.begin() + static_cast<std::ptrdiff_t>(begin), t_us.begin() + static_cast<std::ptrdiff_t>(end),
                   [&](Micros t) { return std::abs(t - first_us) > Slicer::kSpanUs; });
  return static_cast<std::size_t>(far - t_us.begin());
}

}  // namespace

Slicer::Slicer(RobotId robot, const Selection& selection, InputGates& gates, const Yield& yield)
    : robot_(robot), yield_(&yield), gates_(&gates) {
  for (std::size_t s = 0; s < kSourceCount; ++s) {
    if (selection.rows[s] || selection.fields[s].any()) {
      builders_[s].emplace(static_cast<Source>(s), selection.fields[s]);
    }
    reads_[s] = builders_[s].has_value();
  }
  reads_[kInputs] = reads_[kInputs] || gates.flags().any();
}

void Slicer::begin_part(PartRecords records) {
  for (Gap& gap : records.gaps) {
    waiting_[gap.session].gaps.push_back(std::move(gap));
  }
  for (Event& event : records.events) {
    waiting_[event.session].events.push_back(std::move(event));
  }
  for (ClockPoint& point : records.clock) {
    waiting_[point.session].clock.push_back(point);
  }
}

void Slicer::rows(ColumnScan& scan) {
  scan_ = &scan;
  if (std::count(reads_.begin(), reads_.end(), true) == 1) {
    one_source(static_cast<std::size_t>(std::find(reads_.begin(), reads_.end(), true) - reads_.begin()));
    return;
  }
  while (const std::optional<std::size_t> first = first_lane()) {
    const Lane& lane = lanes_[*first];
    const SessionId session = lane.chunks.front().session;
    const Cut cut = find_cut(session, lane.chunks.front().batch.t_send_us[lane.at]);
    yield_sessions_before(session);
    take_all(cut.place);
    finish_batches(session);
    emit(session, cut.t_us);
    recycle_batches();
  }
  take_all(kEnd);
  gates_->catch_up();
}

/// A single source is handed out as it was read, without copying: its chunks are slices, but for those that are too
/// long.
void Slicer::one_source(std::size_t source) {
  auto& [chunk, next] = single_;
  bool more = scan_->next(static_cast<Source>(source), kEnd, chunk);
  while (more) {
    more = scan_->next(static_cast<Source>(source), kEnd, next);
    yield_sessions_before(chunk.session);
    if (source == kRegisters && gates_->needed()) {
      gates_->apply(chunk.session, chunk.place, chunk.batch);
    }
    const std::optional<Micros> until =
        more && next.session == chunk.session ? std::optional(next.batch.t_send_us.front()) : std::nullopt;
    if (chunk.t_max_us - chunk.batch.t_send_us.front() <= kSpanUs &&
        chunk.batch.t_send_us.front() - chunk.t_min_us <= kSpanUs) {
      slice_.batches.push_back(std::move(chunk.batch));
      emit(chunk.session, until);
      scan_->recycle(std::move(slice_.batches.front()));
      slice_.batches.clear();
    } else {
      cut_up(source, chunk, until);
    }
    std::swap(chunk, next);
  }
}

/// Yields a chunk that is too long for one slice.
void Slicer::cut_up(std::size_t source, const Chunk& chunk, std::optional<Micros> until_us) {
  const std::vector<Micros>& t = chunk.batch.t_send_us;
  for (std::size_t begin = 0; begin < chunk.place.size();) {
    const std::size_t end = first_far(t, begin, t.size(), t[begin]);
    builders_[source]->append(chunk.batch, begin, end);
    slice_.batches.push_back(builders_[source]->take());
    emit(chunk.session, end < t.size() ? std::optional(t[end]) : until_us);
    recycle_batches();
    begin = end;
  }
}

void Slicer::end_part() {
  lanes_ = {};
  for (std::optional<BatchBuilder>& builder : builders_) {  // of a slice that an error cut off
    if (builder && builder->rows() > 0) {
      builder->take();
    }
  }
  register_places_.clear();
  gates_->catch_up();
  slice_.batches.clear();
  while (!waiting_.empty()) {
    emit(waiting_.begin()->first, std::nullopt);
  }
}

/// Reads on until the lane has its chunk number `chunk`. False: it has none that begins before the place `before`.
bool Slicer::fill(std::size_t source, std::size_t chunk, std::int64_t before) {
  Lane& lane = lanes_[source];
  while (lane.chunks.size() <= chunk) {
    Chunk next;
    if (!reads_[source] || !scan_->next(static_cast<Source>(source), before, next)) {
      return false;
    }
    lane.chunks.push_back(std::move(next));
  }
  return true;
}

/// The lane with the next row in order of arrival, of those that somebody asked for.
std::optional<std::size_t> Slicer::first_lane() {
  std::optional<std::size_t> first;
  std::int64_t place = kEnd;
  for (std::size_t s = 0; s < kSourceCount; ++s) {
    if (builders_[s] && fill(s, 0, place) && lanes_[s].chunks.front().place[lanes_[s].at] < place) {
      first = s;
      place = lanes_[s].chunks.front().place[lanes_[s].at];
    }
  }
  return first;
}

/// Where the slice that begins with the next row ends.
Slicer::Cut Slicer::find_cut(SessionId session, Micros first_us) {
  Cut cut{kEnd, std::nullopt};
  for (std::size_t s = 0; s < kSourceCount; ++s) {
    if (builders_[s]) {
      shorten(s, session, first_us, cut);
    }
  }
  return cut;
}

/// Brings the cut forward to the first row of this source that does not belong to the slice.
void Slicer::shorten(std::size_t source, SessionId session, Micros first_us, Cut& cut) {
  const Lane& lane = lanes_[source];
  std::size_t rows = 0;
  for (std::size_t number = 0; fill(source, number, cut.place); ++number) {
    const Chunk& chunk = lane.chunks[number];
    const std::size_t begin = number == 0 ? lane.at : 0;
    if (chunk.place[begin] >= cut.place) {
      return;
    }
    if (chunk.session != session) {
      cut = {chunk.place[begin], std::nullopt};
      return;
    }
    const std::vector<Micros>& t = chunk.batch.t_send_us;
    const std::size_t room = std::min(t.size() - begin, kRows - rows);
    if (const std::size_t row = first_far(t, begin, begin + room, first_us); row < t.size()) {
      if (chunk.place[row] < cut.place) {
        cut = {chunk.place[row], t[row]};
      }
      return;
    }
    rows += room;
  }
}

/// Moves the rows before a place to the slice.
void Slicer::take_all(std::int64_t before) {
  for (std::size_t s = 0; s < kSourceCount; ++s) {
    take_rows(s, before);
  }
}

void Slicer::take_rows(std::size_t source, std::int64_t before) {
  Lane& lane = lanes_[source];
  while (fill(source, 0, before)) {
    Chunk& chunk = lane.chunks.front();
    const auto begin = chunk.place.begin() + static_cast<std::ptrdiff_t>(lane.at);
    const auto end = std::lower_bound(begin, chunk.place.end(), before);
    const auto last = static_cast<std::size_t>(end - chunk.place.begin());
    if (source == kInputs && gates_->flags().any()) {
      gates_->inputs(chunk.session, chunk.batch, chunk.place, lane.at, last);
    }
    if (source == kRegisters && gates_->needed()) {
      register_places_.insert(register_places_.end(), begin, end);
    }
    if (builders_[source]) {
      builders_[source]->append(chunk.batch, lane.at, last);
    }
    lane.at = last;
    if (end != chunk.place.end()) {
      return;
    }
    scan_->recycle(std::move(chunk.batch));
    lane.chunks.pop_front();
    lane.at = 0;
  }
}

void Slicer::yield_sessions_before(SessionId session) {
  slice_.batches.clear();
  while (!waiting_.empty() && waiting_.begin()->first < session) {
    emit(waiting_.begin()->first, std::nullopt);
  }
}

/// Moves what the builders have to the slice.
void Slicer::finish_batches(SessionId session) {
  for (std::optional<BatchBuilder>& builder : builders_) {
    if (builder && builder->rows() > 0) {
      slice_.batches.push_back(builder->take());
      if (slice_.batches.back().source == Source::registers && gates_->needed()) {
        gates_->apply(session, register_places_, slice_.batches.back());
      }
    }
  }
  gates_->catch_up();
  register_places_.clear();
}

/// Memory of a slice serves the next one.
void Slicer::recycle_batches() {
  for (Batch& batch : slice_.batches) {
    builders_[static_cast<std::size_t>(batch.source)]->reuse(std::move(batch));
  }
  slice_.batches.clear();
}

/// Yields the batches of the slice with the records up to a time, or all of the session.
void Slicer::emit(SessionId session, std::optional<Micros> until_us) {
  Slice& slice = slice_;
  slice.robot = robot_;
  slice.session = session;
  slice.gaps.clear();
  slice.events.clear();
  slice.clock.clear();
  if (const auto found = waiting_.find(session); found != waiting_.end()) {
    Waiting& waiting = found->second;
    move_until(waiting.gaps, slice.gaps, until_us, [](const Gap& g) { return g.t_from_us; });
    move_until(waiting.events, slice.events, until_us, [](const Event& e) { return e.t_us; });
    move_until(waiting.clock, slice.clock, until_us, [](const ClockPoint& c) { return c.wall_us; });
    if (!until_us) {
      waiting_.erase(found);
    }
  }
  if (!slice.batches.empty() || !slice.gaps.empty() || !slice.events.empty() || !slice.clock.empty()) {
    (*yield_)(slice);
  }
}

}  // namespace tacho::store
