#include "schema/batch_builder.hpp"

#include <cassert>
#include <utility>

namespace tacho {

namespace {

bool is_text(Kind kind) { return kind == Kind::text || kind == Kind::list || kind == Kind::structured; }

}  // namespace

BatchBuilder::BatchBuilder(Source source, const FieldSet& fields) : fields_(fields) {
  batch_.source = source;
  for (std::size_t i = 0; i < kFieldCount; ++i) {
    alarms_ = alarms_ || (fields_[i] && kFields[i].kind == Kind::alarms);
    points_ = points_ || (fields_[i] && kFields[i].kind == Kind::points);
  }
  start(batch_);
}

void BatchBuilder::start(Batch& batch) const {
  for (std::size_t i = 0; i < kFieldCount; ++i) {
    if (fields_[i]) {
      batch.columns.push_back({static_cast<FieldIndex>(i), {}, {}, {}});
    }
  }
  clear_lists(batch);
}

void BatchBuilder::clear_lists(Batch& batch) const {
  batch.alarms.clear();
  batch.alarm_begin.assign(alarms_ ? 1 : 0, 0);
  batch.alarms_incomplete.clear();
  batch.points.clear();
  batch.point_begin.assign(points_ ? 1 : 0, 0);
  batch.texts.clear();
}

void BatchBuilder::append(const Sample& sample) {
  batch_.seq.push_back(sample.meta.seq);
  batch_.t_send_us.push_back(sample.meta.t_send_us);
  batch_.t_recv_us.push_back(sample.meta.t_recv_us);
  for (Column& column : batch_.columns) {
    const Cell& cell = sample.at(column.field);
    const Kind kind = field_at(column.field).kind;
    column.state.push_back(cell.state);
    if (kind == Kind::real) {
      column.real.push_back(cell.real);
    } else if (is_text(kind) && cell.state != State::absent && cell.state != State::null) {
      column.integer.push_back(batch_.texts.intern(sample.text(column.field)));
    } else {
      column.integer.push_back(is_text(kind) ? 0 : cell.integer);
    }
  }
  append_lists(sample.alarms, sample.alarms_incomplete, sample.points,
               [&](std::uint32_t id) { return batch_.texts.intern(sample.texts.at(id)); });
}

/// The lists of one row. `move_text`: id there -> id here.
template <class MoveText>
void BatchBuilder::append_lists(std::span<const AlarmItem> alarms, LevelSet incomplete, std::span<const IoPoint> points,
                                MoveText move_text) {
  if (alarms_) {
    for (AlarmItem item : alarms) {
      item.desc = move_text(item.desc);
      item.solution = move_text(item.solution);
      batch_.alarms.push_back(item);
    }
    batch_.alarm_begin.push_back(static_cast<std::uint32_t>(batch_.alarms.size()));
    batch_.alarms_incomplete.push_back(incomplete);
  }
  if (points_) {
    for (IoPoint point : points) {
      point.source = move_text(point.source);
      batch_.points.push_back(point);
    }
    batch_.point_begin.push_back(static_cast<std::uint32_t>(batch_.points.size()));
  }
}

void BatchBuilder::append(const Batch& from, std::size_t begin, std::size_t end) {
  const auto add = [&](auto& to, const auto& values) {
    to.insert(to.end(), values.begin() + static_cast<std::ptrdiff_t>(begin),
              values.begin() + static_cast<std::ptrdiff_t>(end));
  };
  std::vector<std::uint32_t> moved;  // text id there -> here, kNotMoved until needed
  constexpr std::uint32_t kNotMoved = 0xFFFFFFFF;
  const auto move_text = [&](std::uint32_t id) {
    if (moved.empty()) {
      moved.assign(from.texts.size(), kNotMoved);
    }
    if (moved[id] == kNotMoved) {
      moved[id] = batch_.texts.intern(from.texts.at(id));
    }
    return moved[id];
  };
  add(batch_.seq, from.seq);
  add(batch_.t_send_us, from.t_send_us);
  add(batch_.t_recv_us, from.t_recv_us);
  for (Column& column : batch_.columns) {
    const Column* const other = from.find(column.field);
    assert(other != nullptr);
    const Kind kind = field_at(column.field).kind;
    add(column.state, other->state);
    if (kind == Kind::real) {
      add(column.real, other->real);
    } else if (is_text(kind)) {
      for (std::size_t i = begin; i < end; ++i) {
        column.integer.push_back(move_text(static_cast<std::uint32_t>(other->integer[i])));
      }
    } else {
      add(column.integer, other->integer);
    }
  }
  for (std::size_t row = begin; (alarms_ || points_) && row < end; ++row) {
    append_lists(from.alarms_of(row), alarms_ ? from.alarms_incomplete[row] : LevelSet(), from.points_of(row),
                 move_text);
  }
}

Batch BatchBuilder::take() {
  Batch full = std::exchange(batch_, Batch{});
  batch_.source = full.source;
  start(batch_);
  return full;
}

Batch BatchBuilder::blank(Batch&& used) const {
  Batch batch = std::exchange(used, Batch{});
  batch.source = batch_.source;
  if (batch.columns.empty()) {
    start(batch);
  } else {
    clear_lists(batch);
  }
  return batch;
}

void BatchBuilder::reuse(Batch&& batch) {
  assert(batch_.rows() == 0 && batch.columns.size() == batch_.columns.size());
  batch_ = std::move(batch);
  batch_.seq.clear();
  batch_.t_send_us.clear();
  batch_.t_recv_us.clear();
  for (Column& column : batch_.columns) {
    column.state.clear();
    column.real.clear();
    column.integer.clear();
  }
  clear_lists(batch_);
}

}  // namespace tacho
