#include "schema/store/hot_writer.hpp"

#include <algorithm>
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

void HotWriter::pack(SessionId session, std::map<StreamId, StreamState>& streams, HotLedger& hot) {
  for (auto& [id, state] : streams) {
    if (!state.pending.empty()) {
      packed_.push_back(packed({session, id.first, id.second}, state, hot));
    }
  }
  pending_bytes_ = 0;
}

HotWriter::Packed HotWriter::packed(const StreamKey& key, StreamState& state, HotLedger& hot) {
  const HotMark& first = state.pending.marks.front();
  const HotEncoder::Stored stored = encoder_.encode(state.pending, state.base(keyframe_every_));
  Packed out;
  out.row.id = first.place;
  out.row.robot = key.robot;
  out.row.source = static_cast<std::int64_t>(key.source);
  out.row.session = key.session;
  out.row.seq = first.seq;
  out.row.t_send_us = first.t_send_us;
  out.row.base = stored.needs_base ? state.previous_id : 0;
  out.row.rows = state.pending.marks.size();
  out.bytes = stored.data.size();
  hot.add(key, out.row.id, HotLedger::sums_of(state.pending.marks, out.bytes));
  data_ += stored.data;
  state.packed(out.row.id, out.row.base != 0);
  return out;
}

std::uint64_t HotWriter::insert(PartWriter& part) {
  std::size_t at = 0;
  for (Packed& packed : packed_) {
    packed.row.data = std::string_view(data_).substr(at, packed.bytes);
    at += packed.bytes;
  }
  std::sort(packed_.begin(), packed_.end(), [](const Packed& a, const Packed& b) { return a.row.id < b.row.id; });
  for (const Packed& packed : packed_) {
    part.put(packed.row);
  }
  packed_.clear();
  data_.clear();
  return at;
}

void HotWriter::rolled_back() {
  packed_.clear();
  data_.clear();
  pending_bytes_ = 0;
}

}  // namespace tacho::store
