#pragma once
// A file descriptor behind a thread of its own: whoever prints never waits for a terminal that was stopped or a pipe
// that nobody reads.

#include <chrono>
#include <cstddef>
#include <memory>
#include <string>

namespace tacho::recorder {

/// Thread-safe.
class Outlet {
 public:
  static constexpr std::size_t kMostBytes = std::size_t{256} << 10;

  explicit Outlet(int fd);
  /// Waits a second at most for what was put; a reader that has stopped does not get the rest.
  ~Outlet();
  Outlet(const Outlet&) = delete;
  Outlet& operator=(const Outlet&) = delete;

  /// In order. False, and nothing is taken, when more than kMostBytes are waiting.
  bool put(std::string text);
  /// Bytes that are still to be written.
  [[nodiscard]] std::size_t waiting() const;
  /// The first error of writing, as errno; 0: none. That nobody reads any more is no error.
  [[nodiscard]] int error() const;
  /// Returns when all that was put is written, or after `most`.
  void flush(std::chrono::milliseconds most);

 private:
  struct State;
  std::shared_ptr<State> state_;  // the thread keeps it, for it may never get its last text out
};

}  // namespace tacho::recorder
