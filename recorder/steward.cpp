#include "recorder/steward.hpp"

#include <algorithm>
#include <utility>

namespace tacho::recorder {

namespace {

constexpr std::chrono::milliseconds kPause{200};
constexpr int kTries = 25;  // 5 s: longer than two robots that changed places take to show themselves both

}  // namespace

Steward::Steward() : thread_([this] { run(); }) {}

void Steward::add(Job job) {
  {
    const std::lock_guard lock(mutex_);
    if (stopping_) {
      return;
    }
    waiting_.push_back({std::move(job), Clock::now(), 0});
  }
  changed_.notify_all();
}

bool Steward::busy() const {
  const std::lock_guard lock(mutex_);
  return working_ || !waiting_.empty();
}

void Steward::stop() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    waiting_.clear();
  }
  changed_.notify_all();
  if (thread_.joinable()) {
    thread_.join();
  }
}

void Steward::run() {
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    const auto first = std::min_element(waiting_.begin(), waiting_.end(),
                                        [](const Waiting& a, const Waiting& b) { return a.next < b.next; });
    if (first == waiting_.end()) {
      changed_.wait(lock);
      continue;
    }
    if (first->next > Clock::now()) {
      changed_.wait_until(lock, first->next);
      continue;
    }
    Waiting item = std::move(*first);
    waiting_.erase(first);
    working_ = true;
    lock.unlock();
    const bool done = item.job(++item.tries >= kTries);
    lock.lock();
    working_ = false;
    if (!done && !stopping_) {
      item.next = Clock::now() + kPause;
      waiting_.push_back(std::move(item));
    }
  }
}

}  // namespace tacho::recorder
