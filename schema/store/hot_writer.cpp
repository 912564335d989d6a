#include "schema/store/hot_writer.hpp"

#include <algorithm>
#include <utility>
#include <vector>

namespace tacho::store {

bool HotWriter::keep(StreamState& state, const Answer& answer) {
  HotBatch& batch = state.pending;
  const std::size_t before = batch.bodies.size();
  batch.add(next_place_++, answer);
  pending_bytes_ += batch.bodies.size() - before + sizeof(HotMark);
  return batch.marks.size() >= kMostRowAnswers || batch.bodies.size() >= kMostRowBytes ||
         pending_bytes_ >= kMostPending;
}

std::uint64_t HotWriter::insert(SessionId session, std::map<StreamId, StreamState>& streams, PartWriter& part,
                                HotLedger& hot) {
  std::vector<std::pair<const StreamId, StreamState>*> waiting;
  for (auto& entry : streams) {
    if (!entry.second.pending.empty()) {
      waiting.push_back(&entry);
    }
  }
  std::sort(waiting.begin(), waiting.end(), [](const auto* a, const auto* b) {
    return a->second.pending.marks.front().place < b->second.pending.marks.front().place;
  });
  std::uint64_t stored = 0;
  for (auto* entry : waiting) {
    auto& [id, state] = *entry;
    HotRow row = row_of(state);
    row.robot = id.first;
    row.source = static_cast<std::int64_t>(id.second);
    row.session = session;
    part.put(row);
    hot.add({session, id.first, id.second}, row.id, HotLedger::sums_of(state.pending.marks, row.data.size()));
    stored += row.data.size();
    state.inserted(row.id, row.base != 0);
  }
  pending_bytes_ = 0;
  return stored;
}

/// All but whose it is.
HotRow HotWriter::row_of(StreamState& state) {
  const HotMark& first = state.pending.marks.front();
  const HotEncoder::Stored stored = encoder_.encode(state.pending, state.base(keyframe_every_));
  HotRow row;
  row.id = first.place;
  row.seq = first.seq;
  row.t_send_us = first.t_send_us;
  row.base = stored.needs_base ? state.previous_id : 0;
  row.rows = state.pending.marks.size();
  row.data = stored.data;
  return row;
}

}  // namespace tacho::store
