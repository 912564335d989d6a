#include "schema/store/column_scan.hpp"

#include <algorithm>
#include <limits>

namespace tacho::store {

namespace {

constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();

}  // namespace

ColumnScan::ColumnScan(Connection& connection, const BlockList& list, const PartHead& head, ColumnQuery& query,
                       StreamCounts& met, const Report& report)
    : head_(&head),
      query_(&query),
      report_(&report),
      hot_(connection, head, query.answers, met, report),
      fetch_(connection) {
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
    keep_good_rows(source, chunk);
    if (!chunk.place.empty()) {
      return true;
    }
  }
}

void ColumnScan::load(Source source, const BlockRow& place, Chunk& chunk) {
  chunk = {};
  chunk.session = place.session;
  fetch_.with(place, source, *report_, [&](BlockDecoder& block) {
    std::string damage;
    if (query_->decoders->block && load_columns(block, place, source, chunk, damage)) {
      return damage;
    }
    return load_rows(block, source, chunk);
  });
}

/// False: the answers have to be decoded one by one.
bool ColumnScan::load_columns(BlockDecoder& block, const BlockRow& place, Source source, Chunk& chunk,
                              std::string& damage) {
  chunk.batch = lane(source).builder.take();
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
  if (!damage.empty()) {
    chunk.place.clear();
    chunk.batch = Batch{};
  }
  return decoded;
}

std::string ColumnScan::load_rows(BlockDecoder& block, Source source, Chunk& chunk) {
  std::vector<std::int64_t> places;
  std::string damage = block.places(places);
  if (!damage.empty()) {
    return damage;
  }
  Lane& rows = lane(source);
  damage = block.answers([&](std::size_t i, const Answer& answer) {
    decode(answer);
    chunk.place.push_back(places[i]);
  });
  chunk.batch = rows.builder.take();
  return damage;
}

/// What nearly every block is.
bool ColumnScan::all_good(AnswerMeta meta, const Chunk& chunk) {
  const Batch& batch = chunk.batch;
  const auto [first, last] = std::minmax_element(batch.t_send_us.begin(), batch.t_send_us.end());
  const Window& window = query_->answers.window;
  if (!window.contains(*first) || !window.contains(*last) || chunk.place.back() > head_->ends.row ||
      chunk.place.front() <= lane(meta.source).last_place ||
      std::adjacent_find(chunk.place.begin(), chunk.place.end(), std::greater_equal<>()) != chunk.place.end() ||
      std::adjacent_find(batch.seq.begin(), batch.seq.end(), std::greater_equal<>()) != batch.seq.end()) {
    return false;
  }
  meta.seq = batch.seq.front();
  if (!query_->order.accepts_run(meta, batch.seq.back())) {
    return false;
  }
  lane(meta.source).last_place = chunk.place.back();
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
