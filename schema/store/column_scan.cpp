#include "schema/store/column_scan.hpp"

#include <algorithm>
#include <limits>

#include "schema/store/block/wide_loops.hpp"

namespace tacho::store {

namespace {

constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();

/// Each more than the one before. Looks at all of them, which is quicker than stopping.
template <class T>
bool ascending(const std::vector<T>& values) {
  std::int64_t wrong = 0;
  run_loop([&]() __attribute__((always_inline)) {
    std::int64_t all = 0;
    for (std::size_t i = 1; i < values.size(); ++i) {
      all |= values[i - 1] < values[i] ? 0 : 1;
    }
    wrong = all;
  });
  return wrong == 0;
}

void find_span(Chunk& chunk) {
  const std::vector<Micros>& t = chunk.batch.t_send_us;
  run_loop([&]() __attribute__((always_inline)) {
    Micros min = t.empty() ? 0 : t.front();
    Micros max = min;
    for (const Micros each : t) {
      min = std::min(min, each);
      max = std::max(max, each);
    }
    chunk.t_min_us = min;
    chunk.t_max_us = max;
  });
}

}  // namespace

ColumnScan::ColumnScan(Connection& connection, const BlockList& list, const PartHead& head, ColumnQuery& query,
                       StreamCounts& met, const Report& report)
    : head_(&head),
      query_(&query),
      report_(&report),
      hot_(connection, head, query.answers, met, report),
      fetch_(connection, *query.blocks) {
  auto places = block_places(list, head, query.answers, met, report);
  for (std::size_t s = 0; s < kSourceCount; ++s) {
    lanes_.push_back({std::move(places[s]), {}, BatchBuilder(static_cast<Source>(s), query.wanted[s]), {}, 0});
  }
}

bool ColumnScan::next(Source source, std::int64_t before, Chunk& chunk) {
  Lane& rows = lane(source);
  for (;;) {
    const std::int64_t block = rows.blocks.empty() ? kNever : rows.blocks.front().row_from;
    const std::int64_t hot = rows.hot.empty() ? kNever : rows.hot.front().place.front();
    // Rows still to be pulled may belong to this source, or to another.
    const std::int64_t pending = hot_.row() == 0 ? kNever : hot_.row();
    if (std::min({block, hot, pending}) >= before) {
      return false;
    }
    if (block > pending && hot > pending) {
      pull_hot();
      continue;
    }
    if (hot < block) {
      chunk = std::move(rows.hot.front());
      rows.hot.pop_front();
    } else {
      const BlockRow place = rows.blocks.front();
      rows.blocks.pop_front();
      load(source, place, chunk);
    }
    find_span(chunk);
    keep_good_rows(source, chunk);
    if (!chunk.place.empty()) {
      return true;
    }
  }
}

void ColumnScan::load(Source source, const BlockRow& place, Chunk& chunk) {
  chunk.session = place.session;
  bool loaded = false;
  fetch_.with(place, source, *report_, [&](BlockDecoder& block) {
    std::string damage;
    if (query_->decoders->block && load_columns(block, place, source, chunk, damage)) {
      loaded = damage.empty();
      return damage;
    }
    damage = load_rows(block, source, chunk);
    loaded = true;
    return damage;
  });
  if (!loaded) {
    chunk.batch = Batch{};
    chunk.place.clear();
  }
}

/// False: the answers have to be decoded one by one.
bool ColumnScan::load_columns(BlockDecoder& block, const BlockRow& place, Source source, Chunk& chunk,
                              std::string& damage) {
  chunk.batch = lane(source).builder.blank(std::move(query_->spare[static_cast<std::size_t>(source)]));
  AnswerMeta meta;
  meta.robot = place.robot;
  meta.source = source;
  meta.session = place.session;
  const bool decoded = query_->decoders->block(block, query_->stream_of(meta), chunk.batch, damage);
  if (decoded && damage.empty()) {
    damage = block.times(chunk.batch.seq, chunk.batch.t_send_us, chunk.batch.t_recv_us);
  }
  if (decoded && damage.empty()) {
    damage = block.places(chunk.place);
  }
  return decoded;
}

std::string ColumnScan::load_rows(BlockDecoder& block, Source source, Chunk& chunk) {
  chunk.place.clear();
  std::vector<std::int64_t> places;
  std::string damage = block.places(places);
  if (damage.empty()) {
    damage = block.answers([&](std::size_t i, const Answer& answer) {
      decode(answer);
      chunk.place.push_back(places[i]);
    });
  }
  chunk.batch = lane(source).builder.take();
  return damage;
}

bool ColumnScan::in_order(const Chunk& chunk, std::int64_t last_place) const {
  return chunk.place.front() > last_place && chunk.place.back() <= head_->ends.row && ascending(chunk.place) &&
         ascending(chunk.batch.seq);
}

/// What nearly every block is.
bool ColumnScan::all_good(AnswerMeta meta, const Chunk& chunk) {
  const Window& window = query_->answers.window;
  std::int64_t& last_place = lane(meta.source).last_place;
  if (!window.contains(chunk.t_min_us) || !window.contains(chunk.t_max_us) || !in_order(chunk, last_place)) {
    return false;
  }
  meta.seq = chunk.batch.seq.front();
  if (!query_->order.accepts_run(meta, chunk.batch.seq.back())) {
    return false;
  }
  last_place = chunk.place.back();
  return true;
}

/// Leaves out rows outside the window, newer than the head, or out of order.
void ColumnScan::keep_good_rows(Source source, Chunk& chunk) {
  const Batch& batch = chunk.batch;
  const std::size_t rows = batch.rows();
  AnswerMeta meta;
  meta.source = source;
  meta.session = chunk.session;
  if (rows == 0 || all_good(meta, chunk)) {
    return;
  }
  std::vector<bool> good(rows);
  std::size_t kept = 0;
  bool disorder = false;
  std::int64_t& last_place = lane(source).last_place;
  for (std::size_t i = 0; i < rows; ++i) {
    if (!query_->answers.window.contains(batch.t_send_us[i]) || chunk.place[i] > head_->ends.row) {
      continue;
    }
    meta.seq = batch.seq[i];
    good[i] = chunk.place[i] > last_place && query_->order.accepts(meta);
    last_place = good[i] ? chunk.place[i] : last_place;
    disorder = disorder || !good[i];
    kept += good[i] ? 1U : 0U;
  }
  if (disorder) {
    (*report_)(kOutOfOrder);
  }
  if (kept == rows) {
    return;
  }
  BatchBuilder& builder = lane(source).builder;
  std::vector<std::int64_t> places;
  for (std::size_t begin = 0; begin < rows; ++begin) {
    std::size_t end = begin;
    while (end < rows && good[end]) {
      places.push_back(chunk.place[end++]);
    }
    if (end > begin) {
      builder.append(batch, begin, end);
      begin = end;
    }
  }
  chunk.batch = builder.take();
  chunk.place = std::move(places);
  find_span(chunk);
}

/// Appends the answer to the rows its lane collects.
void ColumnScan::decode(const Answer& answer) {
  Gates open;
  open.known.set();
  open.on.set();
  query_->decoders->row(answer, query_->stream_of(answer.meta),
                        query_->wanted[static_cast<std::size_t>(answer.meta.source)], open, sample_);
  sample_.meta = answer.meta;
  lane(answer.meta.source).builder.append(sample_);
}

void ColumnScan::pull_hot() {
  constexpr int kRows = 256;
  for (int i = 0; i < kRows && hot_.row() != 0; ++i) {
    const std::int64_t place = hot_.row();
    const Answer& answer = hot_.take();
    Lane& rows = lane(answer.meta.source);
    if (rows.session != answer.meta.session) {
      flush_hot(rows);
      rows.session = answer.meta.session;
    }
    decode(answer);
    rows.places.push_back(place);
  }
  for (Lane& rows : lanes_) {
    flush_hot(rows);
  }
}

void ColumnScan::flush_hot(Lane& rows) {
  if (!rows.places.empty()) {
    rows.hot.push_back({rows.session, std::move(rows.places), rows.builder.take()});
    rows.places.clear();
  }
}

}  // namespace tacho::store
