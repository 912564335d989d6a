#pragma once
// Answers on their way into hot rows: they wait in memory until a commit, then those of each stream become one row.

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "schema/store/hot_codec.hpp"
#include "schema/store/part_writer.hpp"
#include "schema/store/repack.hpp"
#include "schema/store/stream_state.hpp"

namespace tacho::store {

class HotWriter {
 public:
  explicit HotWriter(int keyframe_every) : keyframe_every_(static_cast<std::uint64_t>(keyframe_every)) {}

  /// Of the next answer in a part.
  void set_next_place(std::int64_t place) { next_place_ = place; }
  [[nodiscard]] std::int64_t last_place() const { return next_place_ - 1; }

  /// Keeps the answer in its stream's `pending`. True when so many wait that pack() and insert() must follow: a row of
  /// more answers would cost more than a part of a block when it is damaged, and memory is not for a log that is made,
  /// not recorded.
  [[nodiscard]] bool keep(StreamState& state, const Answer& answer);
  /// Makes one row of what waits in each stream, in memory, and enters it in `hot`: that takes longer than inserting
  /// them, and needs no disk.
  void pack(SessionId session, std::map<StreamId, StreamState>& streams, HotLedger& hot);
  /// Inserts the packed rows inside the open transaction, in order of the first answer of each. All at once, so that
  /// the b-tree grows at its end. Returns bytes of their data. Throws SqliteError.
  std::uint64_t insert(PartWriter& part);
  /// What waited is gone.
  void rolled_back();

 private:
  static constexpr std::size_t kMostRowAnswers = 128;
  static constexpr std::size_t kMostRowBytes = std::size_t{128} << 10U;
  static constexpr std::size_t kMostPending = std::size_t{4} << 20U;

  struct Packed {
    HotRow row;  ///< without data
    std::size_t bytes = 0;
  };

  HotEncoder encoder_;
  std::uint64_t keyframe_every_;
  std::int64_t next_place_ = 1;
  std::size_t pending_bytes_ = 0;
  std::vector<Packed> packed_;
  std::string data_;  // of the packed rows, one after the other

  Packed packed(const StreamKey& key, StreamState& state, HotLedger& hot);
};

}  // namespace tacho::store
