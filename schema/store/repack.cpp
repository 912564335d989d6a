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

/// One more row of the rows that become one block.
void extend(BlockRow& place, const StreamKey& key, const HotRow& row) {
  if (place.rows == 0) {
    place.robot = key.robot;
    place.source = static_cast<std::int64_t>(key.source);
    place.session = key.session;
    place.seq_from = row.meta.seq;
    place.row_from = row.id;
    place.t_from_us = place.t_to_us = row.meta.t_send_us;
  }
  place.seq_to = row.meta.seq;
  place.row_to = row.id;
  place.t_from_us = std::min(place.t_from_us, row.meta.t_send_us);
  place.t_to_us = std::max(place.t_to_us, row.meta.t_send_us);
  ++place.rows;
}

/// Leaves the rows that are not in `gone` (sorted). The table is emptied and those are put back: SQLite then frees its
/// pages unseen, while DELETE with a condition writes each page it has emptied into the WAL.
void keep_others(Connection& connection, const std::vector<std::int64_t>& gone) {
  connection.exec("CREATE TEMP TABLE IF NOT EXISTS kept AS SELECT * FROM hot WHERE 0");
  {
    Statement keep(connection, "INSERT INTO temp.kept SELECT * FROM main.hot WHERE id > ?1 AND id < ?2");
    std::int64_t after = 0;
    for (const std::int64_t id : gone) {
      if (id > after + 1) {
        keep.run(after, id);
      }
      after = id;
    }
    keep.run(after, std::numeric_limits<std::int64_t>::max());
  }
  connection.exec("DELETE FROM main.hot; INSERT INTO main.hot SELECT * FROM temp.kept; DELETE FROM temp.kept");
}

}  // namespace

void HotLedger::add(const StreamKey& key, std::int64_t id, Micros t_us, std::uint64_t bytes, std::uint64_t stored) {
  Rows& rows = streams_[key];
  rows.first_us = rows.ids.empty() ? t_us : std::min(rows.first_us, t_us);
  rows.last_us = rows.ids.empty() ? t_us : std::max(rows.last_us, t_us);
  rows.ids.push_back(id);
  rows.bytes += bytes;
  rows.stored += stored;
}

void HotLedger::commit() {
  for (auto& [key, rows] : streams_) {
    rows.committed = rows.ids.size();
  }
}

void HotLedger::roll_back() {
  // Times and bytes only say when a block is due; they may stay as they are.
  for (auto& [key, rows] : streams_) {
    rows.ids.resize(rows.committed);
  }
  std::erase_if(streams_, [](const auto& entry) { return entry.second.ids.empty(); });
}

void HotLedger::load(Connection& connection, const Vocabulary& vocabulary) {
  Statement row(connection, "SELECT id, session, robot, source, t_send_us, length, length(body) FROM hot ORDER BY id");
  row.query();
  while (row.step()) {
    const std::int64_t source = row.integer(3);
    if (source >= 0 && source < 256 && vocabulary.source[static_cast<std::size_t>(source)]) {
      add({static_cast<SessionId>(row.integer(1)), static_cast<RobotId>(row.integer(2)),
           *vocabulary.source[static_cast<std::size_t>(source)]},
          row.integer(0), row.integer(4), static_cast<std::uint64_t>(row.integer(5)),
          static_cast<std::uint64_t>(row.integer(6)));
    }
  }
  commit();
}

std::uint64_t HotLedger::stored() const {
  return std::accumulate(streams_.begin(), streams_.end(), std::uint64_t{0},
                         [](std::uint64_t sum, const auto& entry) { return sum + entry.second.stored; });
}

std::vector<StreamKey> HotLedger::due() const {
  bool some = stored() >= kMostStored;
  std::vector<StreamKey> worthwhile;
  for (const auto& [key, rows] : streams_) {
    const bool full = rows.ids.size() >= kMostRows || rows.bytes >= kMostBytes;
    const bool good = rows.ids.size() >= kGoodRows && rows.last_us - rows.first_us >= kGoodSpanUs;
    some = some || full || good;
    if (full || rows.ids.size() >= kWorthwhileRows) {
      worthwhile.push_back(key);
    }
  }
  return !some ? std::vector<StreamKey>() : worthwhile.empty() ? all() : worthwhile;
}

std::vector<StreamKey> HotLedger::all() const {
  std::vector<StreamKey> keys;
  for (const auto& [key, rows] : streams_) {
    keys.push_back(key);
  }
  return keys;
}

std::span<const std::int64_t> HotLedger::rows(const StreamKey& key) const {
  const auto found = streams_.find(key);
  return found == streams_.end() ? std::span<const std::int64_t>() : found->second.ids;
}

void HotLedger::forget(const StreamKey& key, std::size_t count) {
  Rows& rows = streams_.at(key);
  assert(count <= rows.committed);
  if (count == rows.ids.size()) {
    streams_.erase(key);
    return;
  }
  const double left = 1.0 - static_cast<double>(count) / static_cast<double>(rows.ids.size());
  rows.ids.erase(rows.ids.begin(), rows.ids.begin() + static_cast<std::ptrdiff_t>(count));
  rows.ids.shrink_to_fit();
  rows.committed -= count;
  rows.first_us = rows.last_us;  // rows came while these were packed: a few, of a moment ago
  rows.bytes = static_cast<std::uint64_t>(static_cast<double>(rows.bytes) * left);
  rows.stored = static_cast<std::uint64_t>(static_cast<double>(rows.stored) * left);
}

void Repacker::begin(const HotLedger& hot, const std::vector<StreamKey>& streams) {
  drop();
  for (auto key = streams.rbegin(); key != streams.rend(); ++key) {
    const std::span<const std::int64_t> ids = hot.rows(*key);
    waiting_.push_back({*key, {ids.begin(), ids.end()}});
  }
}

void Repacker::drop() {
  waiting_.clear();
  packed_.clear();
  packed_bytes_ = 0;
}

bool Repacker::pack(Connection& connection, Deadline until) {
  const Vocabulary vocabulary = read_vocabulary(connection);
  while (!waiting_.empty() && packed_bytes_ < kMostPacked) {
    packed_.push_back(pack(connection, vocabulary, waiting_.back()));
    waiting_.pop_back();
    for (const Block& block : packed_.back().blocks) {
      packed_bytes_ += block.data.size();
    }
    if (std::chrono::steady_clock::now() >= until) {
      break;
    }
  }
  return waiting_.empty() || packed_bytes_ >= kMostPacked;
}

Repacker::Packed Repacker::pack(Connection& connection, const Vocabulary& vocabulary, const Waiting& rows) const {
  const StreamKey& key = rows.key;
  Statement fetch(connection, select_sql("hot") + " WHERE id = ?1");
  BodyChain chain(connection, vocabulary);
  const Stream stream = stream_of(connection, key);
  BlockEncoder encoder({HotLedger::kMostRows, level_, stream.word_order});
  std::optional<RollupMaker> rollups;
  if (const FieldSet fields = decode_ ? rollup_fields(connection, stream) : FieldSet(); fields.any()) {
    rollups.emplace(decode_, stream, fields);
  }
  Packed out;
  out.key = key;
  out.rows = rows.ids.size();
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
  for (const std::int64_t id : rows.ids) {
    fetch.query(id);
    if (!fetch.step()) {
      continue;
    }
    const HotRow row = read_hot(fetch, vocabulary);
    const std::string* body = checksum(row) == row.crc ? chain.body(row) : nullptr;
    if (body == nullptr) {
      continue;
    }
    const Answer answer{row.meta, *body, std::string(row.header)};
    if (bytes >= HotLedger::kMostBytes || !encoder.add(answer, id)) {
      flush();
      [[maybe_unused]] const bool taken = encoder.add(answer, id);
      assert(taken && "the first answer of a block is always taken");
    }
    extend(place, key, row);
    out.ids.push_back(id);
    bytes += row.length;
    if (rollups) {
      rollups->add(answer);
    }
  }
  flush();
  if (rollups) {
    out.rollups = rollups->take();
  }
  return out;
}

void Repacker::store(PartWriter& part) const {
  std::vector<std::int64_t> ids;
  for (const Packed& packed : packed_) {
    ids.insert(ids.end(), packed.ids.begin(), packed.ids.end());
  }
  std::sort(ids.begin(), ids.end());
  keep_others(part.connection(), ids);
  for (const Packed& packed : packed_) {
    for (const Block& block : packed.blocks) {
      BlockRow row = block.row;
      row.data = block.data;
      part.put(row);
    }
    packed.rollups.write(part.connection());
  }
}

void Repacker::stored(HotLedger& hot) {
  for (const Packed& packed : packed_) {
    hot.forget(packed.key, packed.rows);
  }
  packed_.clear();
  packed_bytes_ = 0;
}

}  // namespace tacho::store
