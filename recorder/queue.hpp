#pragma once
// The only meeting place of pollers and writer. Answers are bounded by count and by bytes; when the disk stalls they
// are refused and counted, and the poller turns them into a gap. Everything else (gaps, events) is small, comes at a
// bounded rate and is always taken, because it is the record of what was lost.
//
// The reader is woken by the first item and takes what has come a moment later: waking it for each of a thousand
// answers a second costs more than writing them.

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <utility>
#include <vector>

namespace tacho::recorder {

template <class Item>
class Queue {
 public:
  Queue(std::size_t max_items, std::size_t max_bytes) : max_items_(max_items), max_bytes_(max_bytes) {}

  /// False when full: the item is dropped and counted.
  [[nodiscard]] bool try_push(Item item, std::size_t bytes) {
    bool first = false;
    {
      const std::lock_guard lock(mutex_);
      if (items_.size() >= max_items_ || (bytes_ + bytes > max_bytes_ && !items_.empty())) {
        ++dropped_;
        return false;
      }
      bytes_ += bytes;
      first = items_.empty();
      items_.push_back(std::move(item));
    }
    tell(first);
    return true;
  }
  void push(Item item) {
    bool first = false;
    {
      const std::lock_guard lock(mutex_);
      first = items_.empty();
      items_.push_back(std::move(item));
    }
    tell(first);
  }
  /// No more items will come: wakes the reader for good.
  void close() {
    {
      const std::lock_guard lock(mutex_);
      closed_ = true;
    }
    filled_.notify_all();
  }
  /// Moves everything queued into `out`, waiting until `deadline` for the first item and `gather` for more of them.
  /// False when closed and empty.
  bool pop_all(std::vector<Item>& out, std::chrono::steady_clock::time_point deadline,
               std::chrono::microseconds gather = {}) {
    out.clear();
    std::unique_lock lock(mutex_);
    filled_.wait_until(lock, deadline, [this] { return closed_ || !items_.empty(); });
    if (!items_.empty() && gather.count() > 0) {
      filled_.wait_until(lock, std::min(deadline, std::chrono::steady_clock::now() + gather),
                         [this] { return closed_; });
    }
    std::swap(out, items_);
    bytes_ = 0;
    return !(closed_ && out.empty());
  }

  [[nodiscard]] std::size_t size() const {
    const std::lock_guard lock(mutex_);
    return items_.size();
  }
  /// Of the answers in it.
  [[nodiscard]] std::size_t bytes() const {
    const std::lock_guard lock(mutex_);
    return bytes_;
  }
  [[nodiscard]] std::uint64_t dropped() const {
    const std::lock_guard lock(mutex_);
    return dropped_;
  }

 private:
  void tell(bool first) {
    if (first) {
      filled_.notify_one();
    }
  }

  const std::size_t max_items_;
  const std::size_t max_bytes_;
  mutable std::mutex mutex_;
  std::condition_variable filled_;
  std::vector<Item> items_;
  std::size_t bytes_ = 0;
  std::uint64_t dropped_ = 0;
  bool closed_ = false;
};

}  // namespace tacho::recorder
