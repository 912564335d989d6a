#pragma once
// How long moving rows into blocks may take after a commit: about a quarter of the time that the answers of the commit
// cover. The sooner all are packed, the fewer new rows have to be put back. By the time of the answers, so that a log
// that is made, not recorded, is packed in the same way.

#include <algorithm>
#include <chrono>
#include <utility>

#include "schema/store/repack.hpp"

namespace tacho::store {

class MovePace {
 public:
  void see(Micros t_us) { newest_us_ = t_us; }
  /// Once per commit.
  Deadline until() {
    constexpr Micros kShare = 4;
    constexpr Micros kLeastUs = 50'000;
    constexpr Micros kMostUs = 1'000'000;
    const Micros since_us = newest_us_ - std::exchange(committed_us_, newest_us_);
    return std::chrono::steady_clock::now() +
           std::chrono::microseconds(std::clamp(since_us / kShare, kLeastUs, kMostUs));
  }

 private:
  Micros newest_us_ = 0;  ///< time of the last answer
  Micros committed_us_ = 0;
};

}  // namespace tacho::store
