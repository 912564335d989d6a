#include "recorder/outlet.hpp"

#include <poll.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <string_view>
#include <thread>
#include <utility>

namespace tacho::recorder {

struct Outlet::State {
  const int fd;
  std::mutex mutex;
  std::condition_variable changed;
  std::deque<std::string> waiting;
  std::size_t bytes = 0;  // of waiting, and of what is being written
  bool ended = false;
  std::atomic<int> error{0};

  explicit State(int f) : fd(f) {}

  void run() {
    std::unique_lock lock(mutex);
    for (;;) {
      changed.wait(lock, [this] { return ended || !waiting.empty(); });
      if (waiting.empty()) {
        return;
      }
      const std::string text = std::move(waiting.front());
      waiting.pop_front();
      lock.unlock();
      write(text);
      lock.lock();
      bytes -= text.size();
      changed.notify_all();
    }
  }

  /// By the system call: a stream would hold its lock while it waits, and exit() would wait for that.
  void write(std::string_view text) {
    while (!text.empty()) {
      const ssize_t n = ::write(fd, text.data(), text.size());
      if (n < 0 && errno == EAGAIN) {  // somebody else has set it so
        pollfd room{fd, POLLOUT, 0};
        ::poll(&room, 1, -1);
      } else if (n < 0 && errno != EINTR) {
        error = error == 0 && errno != EPIPE ? errno : error.load();
        return;
      }
      text.remove_prefix(n < 0 ? 0 : static_cast<std::size_t>(n));
    }
  }
};

Outlet::Outlet(int fd) : state_(std::make_shared<State>(fd)) {
  std::thread([state = state_] { state->run(); }).detach();
}

Outlet::~Outlet() {
  flush(std::chrono::seconds(1));
  const std::lock_guard lock(state_->mutex);
  state_->ended = true;
  state_->changed.notify_all();
}

bool Outlet::put(std::string text) {
  const std::lock_guard lock(state_->mutex);
  if (state_->bytes + text.size() > kMostBytes) {
    return false;
  }
  state_->bytes += text.size();
  state_->waiting.push_back(std::move(text));
  state_->changed.notify_all();
  return true;
}

std::size_t Outlet::waiting() const {
  const std::lock_guard lock(state_->mutex);
  return state_->bytes;
}

int Outlet::error() const { return state_->error; }

void Outlet::flush(std::chrono::milliseconds most) {
  std::unique_lock lock(state_->mutex);
  state_->changed.wait_for(lock, most, [this] { return state_->bytes == 0; });
}

}  // namespace tacho::recorder
