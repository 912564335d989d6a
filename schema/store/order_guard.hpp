#pragma once
// Keeps rows in order and unique, whatever a damaged or doctored file holds.

#include <array>
#include <cstdint>
#include <utility>

#include "schema/sample.hpp"

namespace tacho::store {

inline constexpr const char* kOutOfOrder = "answers that repeat or go back in order are left out";

class OrderGuard {
 public:
  bool accepts(const AnswerMeta& meta) {
    auto& last = last_[static_cast<std::size_t>(meta.source)];
    const std::pair<SessionId, std::uint64_t> place{meta.session, meta.seq + 1};
    if (place <= last) {
      return false;
    }
    last = place;
    return true;
  }
  /// Rows of one stream with ascending numbers, the first being `meta`: all, or (false) none of them.
  bool accepts_run(const AnswerMeta& meta, std::uint64_t last_seq) {
    if (!accepts(meta)) {
      return false;
    }
    last_[static_cast<std::size_t>(meta.source)].second = last_seq + 1;
    return true;
  }

 private:
  std::array<std::pair<SessionId, std::uint64_t>, kSourceCount> last_{};  ///< session, number after the last
};

}  // namespace tacho::store
