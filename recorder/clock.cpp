#include "recorder/clock.hpp"

#include <algorithm>
#include <chrono>
#include <limits>

#include "schema/time.hpp"

namespace tacho::recorder {

HostClock::HostClock() : busy_since_us_(std::numeric_limits<Micros>::max()) {}

Micros HostClock::mono_us() const { return mono_now_us(); }
Micros HostClock::wall_us() const { return wall_now_us(); }

bool HostClock::sleep_until(Micros mono_us) {
  busy_since_us_ = std::max(mono_us, mono_now_us());
  std::unique_lock lock(mutex_);
  const auto ahead = std::chrono::microseconds(mono_us - mono_now_us());
  wake_.wait_until(lock, std::chrono::steady_clock::now() + ahead, [this] { return stopped_at_ || woken_; });
  woken_ = false;
  busy_since_us_ = mono_now_us();
  return !stopped_at_;
}

Micros HostClock::busy_us() const {
  const Micros since_us = busy_since_us_;
  return std::max<Micros>(0, mono_now_us() - std::min(since_us, mono_now_us()));
}

std::optional<Micros> HostClock::stopped_at() const {
  const std::lock_guard lock(mutex_);
  return stopped_at_;
}

void HostClock::stop() {
  {
    const std::lock_guard lock(mutex_);
    if (!stopped_at_) {
      stopped_at_ = mono_now_us();
    }
  }
  wake_.notify_all();
}

void HostClock::wake() {
  {
    const std::lock_guard lock(mutex_);
    woken_ = true;
  }
  wake_.notify_all();
}

}  // namespace tacho::recorder
