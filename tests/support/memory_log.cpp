#include "tests/support/memory_log.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "schema/batch_builder.hpp"

namespace tacho::test {

namespace {

constexpr Micros kEpoch = 1'767'225'600'000'000;  // 2026-01-01T00:00:00Z

FieldIndex index_of(std::string_view name) {
  const FieldIndex f = find_field(name);
  assert(f != kNoField);
  return f;
}

Cell& present(Sample& sample, std::string_view name) {
  Cell& cell = sample.cells[index_of(name)];
  cell.state = State::present;
  return cell;
}

/// One slice under construction: a builder per source that was asked for.
struct Chunk {
  std::vector<BatchBuilder> builders;
  std::vector<Source> sources;
  std::size_t rows = 0;
  Micros last_us = 0;
};

Chunk make_chunk(const Selection& selection) {
  Chunk chunk;
  for (std::size_t s = 0; s < kSourceCount; ++s) {
    if (selection.rows[s]) {
      chunk.sources.push_back(static_cast<Source>(s));
      chunk.builders.emplace_back(static_cast<Source>(s), selection.fields[s]);
    }
  }
  return chunk;
}

}  // namespace

Micros MemoryLog::micros(double t_s) { return kEpoch + static_cast<Micros>(std::llround(t_s * 1e6)); }

RobotId MemoryLog::add_robot(const std::string& name) {
  Robot robot;
  robot.id = static_cast<RobotId>(robots_.size() + 1);
  robot.name = name;
  robots_.push_back(robot);
  return robot.id;
}

Sample& MemoryLog::row(RobotId robot, Source source, double t_s, double rtt_s) {
  Sample& sample = rows_.emplace_back();
  sample.meta.robot = robot;
  sample.meta.source = source;
  sample.meta.session = 1;
  sample.meta.seq = next_seq_[{robot, source}]++;
  sample.meta.t_send_us = micros(t_s);
  sample.meta.t_recv_us = micros(t_s + rtt_s);
  return sample;
}

void MemoryLog::set(Sample& sample, std::string_view field, double value) { present(sample, field).real = value; }

void MemoryLog::set_int(Sample& sample, std::string_view field, std::int64_t v) { present(sample, field).integer = v; }

void MemoryLog::set_text(Sample& sample, std::string_view field, std::string_view v) {
  present(sample, field).integer = sample.texts.intern(v);
}

void MemoryLog::set_state(Sample& sample, std::string_view field, State state) {
  sample.cells[index_of(field)].state = state;
}

void MemoryLog::no_alarms(Sample& sample) {
  for (const std::string_view level : {"fatals", "errors", "warnings", "notices"}) {
    present(sample, level).integer = 0;
  }
}

void MemoryLog::alarm(Sample& sample, AlarmLevel level, std::int64_t code, std::int64_t stamp_s, std::int64_t times) {
  constexpr std::array<std::string_view, 4> kArrays{"fatals", "errors", "warnings", "notices"};
  const std::string_view array = kArrays[static_cast<std::size_t>(level)];
  if (!sample.at(index_of(array)).has()) {
    no_alarms(sample);
  }
  sample.alarms.push_back({level, code, stamp_s, times, 0, 0});
  ++sample.cells[index_of(array)].integer;
}

void MemoryLog::gap(const Gap& gap) { gaps_.push_back(gap); }
void MemoryLog::event(const Event& event) { events_.push_back(event); }
void MemoryLog::period(RobotId robot, Source source, double period_s) {
  periods_[{robot, source}] = static_cast<Micros>(std::llround(period_s * 1e6));
}

std::vector<Robot> MemoryLog::robots() const { return robots_; }

std::vector<Session> MemoryLog::sessions() const {
  Session session;
  session.id = 1;
  session.clean = true;
  session.t_start_us = rows_.empty() ? kEpoch : rows_.front().meta.t_send_us;
  session.t_end_us = rows_.empty() ? kEpoch : rows_.back().meta.t_recv_us;
  return {session};
}

std::vector<Stream> MemoryLog::streams() const {
  std::vector<Stream> out;
  for (const Coverage& c : coverage()) {
    out.push_back({1, c.robot, c.source, c.period_us, WordOrder::cdab, {}, c.planned});
  }
  return out;
}

std::vector<Coverage> MemoryLog::coverage() const {
  std::map<std::pair<RobotId, Source>, Coverage> all;
  for (const Sample& row : rows_) {
    Coverage& c = all[{row.meta.robot, row.meta.source}];
    c.first_us = c.stored == 0 ? row.meta.t_send_us : c.first_us;
    c.last_us = row.meta.t_recv_us;
    c.seen |= row.seen();
    c.valued |= row.valued();
    ++c.stored;
  }
  for (const Gap& gap : gaps_) {
    Coverage& c = all[{gap.robot, gap.source}];
    (gap.partial ? c.partial : c.missed) += gap.seq_count;
    c.gaps.add(gap);
  }
  std::vector<Coverage> out;
  for (auto& [key, c] : all) {
    c.robot = key.first;
    c.source = key.second;
    c.planned = c.stored + c.missed;
    const auto period = periods_.find(key);
    c.period_us = period != periods_.end() ? period->second
                  : c.stored > 1           ? (c.last_us - c.first_us) / static_cast<Micros>(c.stored - 1)
                                           : 1'000'000;
    out.push_back(c);
  }
  return out;
}

void MemoryLog::read(RobotId robot, Window window, const Selection& selection,
                     const std::function<void(const Slice&)>& yield) {
  Chunk chunk = make_chunk(selection);
  Micros chunk_from = std::numeric_limits<Micros>::min();
  const auto flush = [&](Micros chunk_to) {
    Slice slice;
    slice.robot = robot;
    slice.session = 1;
    for (BatchBuilder& builder : chunk.builders) {
      if (builder.rows() > 0) {
        slice.batches.push_back(builder.take());
      }
    }
    const auto mine = [&](RobotId r, Micros t) {
      return r == robot && t >= chunk_from && t < chunk_to && window.contains(t);
    };
    std::copy_if(gaps_.begin(), gaps_.end(), std::back_inserter(slice.gaps),
                 [&](const Gap& g) { return mine(g.robot, g.t_from_us); });
    std::copy_if(events_.begin(), events_.end(), std::back_inserter(slice.events),
                 [&](const Event& e) { return mine(e.robot, e.t_us); });
    chunk.rows = 0;
    chunk_from = chunk_to;
    if (!slice.batches.empty() || !slice.gaps.empty() || !slice.events.empty()) {
      yield(slice);
    }
  };
  for (const Sample& row : rows_) {
    const auto at = std::find(chunk.sources.begin(), chunk.sources.end(), row.meta.source);
    if (row.meta.robot != robot || at == chunk.sources.end() || !window.contains(row.meta.t_send_us)) {
      continue;
    }
    if (slice_rows_ > 0 && chunk.rows == slice_rows_) {
      flush(row.meta.t_send_us);
    }
    chunk.builders[static_cast<std::size_t>(at - chunk.sources.begin())].append(row);
    ++chunk.rows;
  }
  flush(std::numeric_limits<Micros>::max());
}

}  // namespace tacho::test
