#include "schema/store/repack.hpp"

#include <algorithm>
#include <cassert>
#include <limits>
#include <numeric>
#include <optional>
#include <utility>

#include "schema/store/hot_scan.hpp"
#include "schema/store/schema_sql.hpp"

namespace tacho::store {

namespace {

/// With defaults where the row is damaged.
Stream stream_of(Connection& connection, const StreamKey& key) {
  Statement row(connection, select_sql("stream") + " WHERE session = ?1 AND robot = ?2 AND source = ?3");
  row.query(key.session, key.robot, source_name(key.source));
  Stream stream;
  stream.session = key.session;
  stream.robot = key.robot;
  stream.source = key.source;
  const std::optional<StreamRow> found = row.step() ? read_stream(row) : std::nullopt;
  return found ? found->stream : stream;
}

/// One more of the answers that become one block.
void extend(BlockRow& block, const AnswerMeta& meta, std::int64_t place) {
  if (block.rows == 0) {
    block.robot = meta.robot;
    block.source = static_cast<std::int64_t>(meta.source);
    block.session = meta.session;
    block.seq_from = meta.seq;
    block.row_from = place;
    block.t_from_us = block.t_to_us = meta.t_send_us;
  }
  block.seq_to = meta.seq;
  block.row_to = place;
  block.t_from_us = std::min(block.t_from_us, meta.t_send_us);
  block.t_to_us = std::max(block.t_to_us, meta.t_send_us);
  ++block.rows;
}

/// Leaves the rows that are not in `gone` (sorted). The table is emptied and those are put back: SQLite then frees its
/// pages unseen, while DELETE with a condition writes each page it has emptied into the WAL.
void keep_others(Connection& connection, const std::vector<std::int64_t>& gone) {
  connection.exec("CREATE TEMP TABLE IF NOT EXISTS kept AS SELECT * FROM hot WHERE 0");
  {
    Statement ids(connection, "SELECT id FROM main.hot ORDER BY id");
    Statement keep(connection, "INSERT INTO temp.kept SELECT * FROM main.hot WHERE id = ?1");
    auto next = gone.begin();
    while (ids.step()) {
      const std::int64_t id = ids.integer(0);
      next = std::lower_bound(next, gone.end(), id);
      if (next == gone.end() || *next != id) {
        keep.run(id);
      }
    }
  }
  connection.exec("DELETE FROM main.hot; INSERT INTO main.hot SELECT * FROM temp.kept; DELETE FROM temp.kept");
}

void add(HotLedger::Sums& to, const HotLedger::Sums& sums) {
  to.first_us = to.answers == 0 ? sums.first_us : std::min(to.first_us, sums.first_us);
  to.last_us = sums.last_us;  // not the latest: the clock may have been set back
  to.answers += sums.answers;
  to.bytes += sums.bytes;
  to.stored += sums.stored;
}

/// Those that were summed up are the oldest.
void take(HotLedger::Sums& from, const HotLedger::Sums& sums) {
  from.first_us = std::min(sums.last_us, from.last_us);
  from.answers -= sums.answers;
  from.bytes -= sums.bytes;
  from.stored -= sums.stored;
}

}  // namespace

HotLedger::Sums HotLedger::sums_of(const std::vector<HotMark>& marks, std::uint64_t stored) {
  Sums sums;
  for (const HotMark& mark : marks) {
    store::add(sums, {1, mark.length, 0, mark.t_send_us, mark.t_send_us});
  }
  sums.stored = stored;
  return sums;
}

void HotLedger::add(const StreamKey& key, std::int64_t id, Sums row) {
  row.stored += kRowBytes;
  Stream& stream = streams_[key];
  stream.ids.push_back(id);
  store::add(stream.sums, row);
}

void HotLedger::commit() {
  for (auto& [key, stream] : streams_) {
    stream.committed = stream.sums;
    stream.committed_ids = stream.ids.size();
  }
}

void HotLedger::roll_back() {
  for (auto& [key, stream] : streams_) {
    stream.sums = stream.committed;
    stream.ids.resize(stream.committed_ids);
  }
  std::erase_if(streams_, [](const auto& entry) { return entry.second.ids.empty(); });
}

void HotLedger::load(Connection& connection, const Vocabulary& vocabulary) {
  for_each_hot_row(connection, vocabulary, 0,
                   [this](const HotRow& row, Source source, const std::vector<HotMark>& marks) {
                     add({row.session, row.robot, source}, row.id, sums_of(marks, row.data.size()));
                   });
  commit();
}

std::uint64_t HotLedger::stored() const {
  return std::accumulate(streams_.begin(), streams_.end(), std::uint64_t{0},
                         [](std::uint64_t sum, const auto& entry) { return sum + entry.second.sums.stored; });
}

std::vector<StreamKey> HotLedger::due() const {
  bool some = stored() >= kMostStored;
  std::vector<StreamKey> worthwhile;
  for (const auto& [key, stream] : streams_) {
    const Sums& sums = stream.sums;
    const bool full = sums.answers >= kMostAnswers || sums.bytes >= kMostBytes;
    const bool good = sums.answers >= kGoodAnswers && sums.last_us - sums.first_us >= kGoodSpanUs;
    some = some || full || good;
    if (full || sums.answers >= kWorthwhileAnswers) {
      worthwhile.push_back(key);
    }
  }
  return !some ? std::vector<StreamKey>() : worthwhile.empty() ? all() : worthwhile;
}

std::vector<StreamKey> HotLedger::all() const {
  std::vector<StreamKey> keys;
  for (const auto& [key, stream] : streams_) {
    keys.push_back(key);
  }
  return keys;
}

void HotLedger::forget(const StreamKey& key, const Rows& moved) {
  Stream& stream = streams_.at(key);
  assert(moved.ids.size() <= stream.committed_ids);
  if (moved.ids.size() == stream.ids.size()) {
    streams_.erase(key);
    return;
  }
  stream.ids.erase(stream.ids.begin(), stream.ids.begin() + static_cast<std::ptrdiff_t>(moved.ids.size()));
  stream.ids.shrink_to_fit();
  stream.committed_ids -= moved.ids.size();
  take(stream.sums, moved.sums);
  take(stream.committed, moved.sums);
}

void Repacker::begin(const HotLedger& hot, const std::vector<StreamKey>& streams) {
  drop();
  for (auto key = streams.rbegin(); key != streams.rend(); ++key) {
    waiting_.push_back({*key, hot.rows(*key)});
  }
}

void Repacker::drop() {
  waiting_.clear();
  packed_.clear();
  packed_bytes_ = 0;
}

bool Repacker::pack(Connection& connection, Deadline until) {
  const Transaction reading(connection);  // without it SQLite locks the part for each row anew
  while (!waiting_.empty() && packed_bytes_ < kMostPacked) {
    Waiting next = std::move(waiting_.back());
    waiting_.pop_back();
    packed_.push_back(pack(connection, std::move(next)));
    for (const Block& block : packed_.back().blocks) {
      packed_bytes_ += block.data.size();
    }
    if (std::chrono::steady_clock::now() >= until) {
      break;
    }
  }
  return waiting_.empty() || packed_bytes_ >= kMostPacked;
}

Repacker::Packed Repacker::pack(Connection& connection, Waiting from) const {
  const StreamKey& key = from.key;
  Statement fetch(connection, select_sql("hot") + " WHERE id = ?1");
  BodyChain chain(connection);
  const Stream stream = stream_of(connection, key);
  BlockEncoder encoder({HotLedger::kMostAnswers, level_, stream.word_order});
  std::optional<RollupMaker> rollups;
  if (const FieldSet fields = decode_ ? rollup_fields(connection, stream) : FieldSet(); fields.any()) {
    rollups.emplace(decode_, stream, fields);
  }
  Packed out;
  BlockRow place;
  std::uint64_t bytes = 0;
  const auto flush = [&] {
    std::string data = encoder.finish();
    if (place.rows > 0) {
      data.shrink_to_fit();  // it is kept for a while
      out.blocks.push_back({place, std::move(data)});
      place = BlockRow{};
      bytes = 0;
    }
  };
  const auto add = [&](const Answer& answer, std::int64_t at) {
    if (bytes >= HotLedger::kMostBytes || !encoder.add(answer, at)) {
      flush();
      [[maybe_unused]] const bool taken = encoder.add(answer, at);
      assert(taken && "the first answer of a block is always taken");
    }
    extend(place, answer.meta, at);
    bytes += answer.body.size();
    out.manifest[manifest_key(answer.meta)].add(row_hash(answer));
    if (rollups) {
      rollups->add(answer);
    }
  };
  HotBatch batch;
  Answer answer;
  answer.meta = {key.robot, key.source, key.session, 0, 0, 0};
  for (const std::int64_t id : from.rows.ids) {
    fetch.query(id);
    const HotRow row = fetch.step() ? read_hot(fetch) : HotRow{};
    if (row.id != id || !is_whole(row) || !chain.open(row, batch)) {
      continue;
    }
    out.ids.push_back(id);
    for (const HotMark& mark : batch.marks) {
      batch.fill(mark, answer);
      add(answer, mark.place);
    }
  }
  flush();
  if (rollups) {
    out.rollups = rollups->take();
  }
  out.from = std::move(from);
  return out;
}

void Repacker::store(PartWriter& part) const {
  std::vector<std::int64_t> ids;
  for (const Packed& packed : packed_) {
    ids.insert(ids.end(), packed.ids.begin(), packed.ids.end());
  }
  std::sort(ids.begin(), ids.end());
  keep_others(part.connection(), ids);
  Manifest manifest;
  for (const Packed& packed : packed_) {
    for (const Block& block : packed.blocks) {
      BlockRow row = block.row;
      row.data = block.data;
      part.put(row);
    }
    packed.rollups.write(part.connection());
    for (const auto& [key, sum] : packed.manifest) {
      manifest[key].add(sum);
    }
  }
  write_manifest(part.connection(), manifest);
}

void Repacker::stored(HotLedger& hot) {
  for (const Packed& packed : packed_) {
    hot.forget(packed.from.key, packed.from.rows);
  }
  packed_.clear();
  packed_bytes_ = 0;
}

}  // namespace tacho::store
