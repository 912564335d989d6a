#pragma once
// A thread for what pollers must not do themselves, such as replacing the pollers of a robot: one job after the other.

#include <chrono>
#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>

namespace tacho::recorder {

class Steward {
 public:
  /// False: try again a little later. `last`: there is no later. Must not throw.
  using Job = std::function<bool(bool last)>;

  Steward();
  ~Steward() { stop(); }
  Steward(const Steward&) = delete;
  Steward& operator=(const Steward&) = delete;

  /// From any thread. After stop() nothing happens.
  void add(Job job);
  /// Jobs that wait or run.
  [[nodiscard]] bool busy() const;
  /// Waits for the job in progress; those that wait are dropped.
  void stop();

 private:
  using Clock = std::chrono::steady_clock;
  struct Waiting {
    Job job;
    Clock::time_point next;
    int tries = 0;
  };
  void run();

  mutable std::mutex mutex_;  // all but the thread
  std::condition_variable changed_;
  std::deque<Waiting> waiting_;
  bool working_ = false;
  bool stopping_ = false;
  std::thread thread_;
};

}  // namespace tacho::recorder
