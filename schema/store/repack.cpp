#include "schema/store/repack.hpp"

#include <algorithm>
#include <cassert>
#include <utility>

#include "schema/store/hot_scan.hpp"
#include "schema/store/rollup.hpp"
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

/// Rows that become one block.
struct Group {
  BlockRow place;
  std::vector<std::int64_t> ids;
  std::uint64_t bytes = 0;

  void add(const HotRow& row) {
    if (ids.empty()) {
      place.seq_from = row.meta.seq;
      place.row_from = row.id;
      place.t_from_us = place.t_to_us = row.meta.t_send_us;
    }
    place.seq_to = row.meta.seq;
    place.row_to = row.id;
    place.t_from_us = std::min(place.t_from_us, row.meta.t_send_us);
    place.t_to_us = std::max(place.t_to_us, row.meta.t_send_us);
    ids.push_back(row.id);
    place.rows = ids.size();
    bytes += row.length;
  }
};

}  // namespace

void HotLedger::add(const StreamKey& key, std::int64_t id, Micros t_us, std::uint64_t bytes) {
  Rows& rows = streams_[key];
  rows.first_us = rows.ids.empty() ? t_us : std::min(rows.first_us, t_us);
  rows.last_us = rows.ids.empty() ? t_us : std::max(rows.last_us, t_us);
  rows.ids.push_back(id);
  rows.bytes += bytes;
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
  Statement row(connection, "SELECT id, session, robot, source, t_send_us, length FROM hot ORDER BY id");
  row.query();
  while (row.step()) {
    const std::int64_t source = row.integer(3);
    if (source >= 0 && source < 256 && vocabulary.source[static_cast<std::size_t>(source)]) {
      add({static_cast<SessionId>(row.integer(1)), static_cast<RobotId>(row.integer(2)),
           *vocabulary.source[static_cast<std::size_t>(source)]},
          row.integer(0), row.integer(4), static_cast<std::uint64_t>(row.integer(5)));
    }
  }
  commit();
}

std::optional<StreamKey> HotLedger::due() const {
  std::optional<StreamKey> best;
  std::size_t most = 0;
  for (const auto& [key, rows] : streams_) {
    const bool full = rows.ids.size() >= kMostRows || rows.bytes >= kMostBytes;
    const bool good = rows.ids.size() >= kGoodRows && rows.last_us - rows.first_us >= kGoodSpanUs;
    if ((full || good) && rows.ids.size() > most) {
      best = key;
      most = rows.ids.size();
    }
  }
  return best;
}

std::optional<StreamKey> HotLedger::any() const {
  return streams_.empty() ? std::nullopt : std::optional(streams_.begin()->first);
}

std::span<const std::int64_t> HotLedger::rows(const StreamKey& key) const {
  const auto found = streams_.find(key);
  return found == streams_.end() ? std::span<const std::int64_t>() : found->second.ids;
}

void Repacker::move(PartWriter& part, const StreamKey& key, std::span<const std::int64_t> ids) {
  Connection& connection = part.connection();
  const Vocabulary vocabulary = read_vocabulary(connection);
  const Stream stream = stream_of(connection, key);
  std::optional<RollupMaker> rollups;
  if (const FieldSet fields = decode_ ? rollup_fields(connection, stream) : FieldSet(); fields.any()) {
    rollups.emplace(decode_, stream, fields);
  }
  Statement fetch(connection, select_sql("hot") + " WHERE id = ?1");
  Statement erase(connection, "DELETE FROM hot WHERE id = ?1");
  BodyChain chain(connection, vocabulary);
  BlockEncoder encoder({HotLedger::kMostRows, level_, stream.word_order});
  Group group;
  const auto flush = [&] {
    const std::string data = encoder.finish();
    if (group.ids.empty()) {
      return;
    }
    group.place.robot = key.robot;
    group.place.source = static_cast<std::int64_t>(key.source);
    group.place.session = key.session;
    group.place.data = data;
    part.put(group.place);
    for (const std::int64_t id : group.ids) {
      erase.run(id);
    }
    group = Group{};
  };
  for (const std::int64_t id : ids) {
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
    if (group.bytes >= HotLedger::kMostBytes || !encoder.add(answer, id)) {
      flush();
      [[maybe_unused]] const bool taken = encoder.add(answer, id);
      assert(taken && "the first answer of a block is always taken");
    }
    group.add(row);
    if (rollups) {
      rollups->add(answer);
    }
  }
  fetch.reset();
  flush();
  if (rollups) {
    rollups->write(connection);
  }
}

bool move_all(PartWriter& part, HotLedger& ledger, Repacker& repacker, Deadline until) {
  while (const std::optional<StreamKey> key = ledger.any()) {
    part.begin();
    try {
      repacker.move(part, *key, ledger.rows(*key));
      part.commit();
    } catch (...) {
      part.rollback();
      throw;
    }
    ledger.forget(*key);
    if (std::chrono::steady_clock::now() >= until) {
      break;
    }
  }
  return ledger.empty();
}

}  // namespace tacho::store
