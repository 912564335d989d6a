#include "schema/store/slicer.hpp"

#include <algorithm>
#include <cstdlib>
#include <iterator>
#include <utility>

namespace tacho::store {

namespace {

/// Moves the rows before `until` (all when empty) from the front of `from` to `to`.
template <class Row, class Time>
void move_until(std::vector<Row>& from, std::vector<Row>& to, std::optional<Micros> until, Time time) {
  const auto end =
      until ? std::find_if(from.begin(), from.end(), [&](const Row& row) { return time(row) >= *until; }) : from.end();
  to.assign(std::make_move_iterator(from.begin()), std::make_move_iterator(end));
  from.erase(from.begin(), end);
}

}  // namespace

Slicer::Slicer(RobotId robot, const Selection& selection, const Yield& yield) : robot_(robot), yield_(&yield) {
  for (std::size_t s = 0; s < kSourceCount; ++s) {
    if (selection.rows[s] || selection.fields[s].any()) {
      builders_[s].emplace(static_cast<Source>(s), selection.fields[s]);
    }
  }
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

void Slicer::add(const Sample& sample) {
  std::optional<BatchBuilder>& builder = builders_[static_cast<std::size_t>(sample.meta.source)];
  if (!builder) {
    return;
  }
  const Micros t = sample.meta.t_send_us;
  if (session_ && *session_ != sample.meta.session) {
    yield_rows(std::nullopt);
  } else if (session_ && (builder->rows() >= kRows || std::abs(t - first_us_) > kSpanUs)) {
    yield_rows(t);
  }
  if (!session_) {
    yield_sessions_before(sample.meta.session);
    session_ = sample.meta.session;
    first_us_ = t;
  }
  builder->append(sample);
}

void Slicer::end_part() {
  if (session_) {
    yield_sessions_before(*session_);
    yield_rows(std::nullopt);
  }
  while (!waiting_.empty()) {
    emit(waiting_.begin()->first, std::nullopt);
  }
}

void Slicer::yield_rows(std::optional<Micros> until_us) {
  emit(*session_, until_us);
  session_.reset();
}

void Slicer::yield_sessions_before(SessionId session) {
  while (!waiting_.empty() && waiting_.begin()->first < session) {
    emit(waiting_.begin()->first, std::nullopt);
  }
}

void Slicer::emit(SessionId session, std::optional<Micros> until_us) {
  Slice slice;
  slice.robot = robot_;
  slice.session = session;
  for (std::optional<BatchBuilder>& builder : builders_) {
    if (session_ == session && builder && builder->rows() > 0) {
      slice.batches.push_back(builder->take());
    }
  }
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
