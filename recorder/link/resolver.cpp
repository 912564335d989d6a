#include "recorder/link/resolver.hpp"

#include <netdb.h>

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <system_error>
#include <thread>
#include <utility>

#include "schema/time.hpp"

namespace tacho::recorder {

namespace {

constexpr const char* kRemedy = "; is the name right, or use the robot's address";

Resolver::Answer look_up(const std::string& host, std::uint16_t port, int flags) {
  addrinfo hints{};
  hints.ai_family = AF_UNSPEC;
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = flags;
  addrinfo* found = nullptr;
  const int error = ::getaddrinfo(host.c_str(), std::to_string(port).c_str(), &hints, &found);
  return error == 0 ? Resolver::Answer{0, {found, ::freeaddrinfo}} : Resolver::Answer{error, {}};
}

}  // namespace

/// Shared with the thread that looks up.
struct Resolver::Running {
  std::mutex mutex;
  std::condition_variable changed;
  bool busy = false;
  bool interrupted = false;
  std::optional<Answer> answer;  // not taken yet: it may have come after the deadline of whoever asked
};

Resolver::Resolver(std::string host, std::uint16_t port, Lookup lookup)
    : host_(std::move(host)), port_(port), lookup_(std::move(lookup)), running_(std::make_shared<Running>()) {
  if (!lookup_) {
    last_ = look_up(host_, port_, AI_NUMERICHOST | AI_NUMERICSERV).addresses;
    numeric_ = last_ != nullptr;
    lookup_ = [](const std::string& name, std::uint16_t at) { return look_up(name, at, AI_NUMERICSERV); };
  }
}

/// With the lock held. False: no thread can be had.
bool Resolver::start() {
  try {
    std::thread([running = running_, lookup = lookup_, host = host_, port = port_] {
      Answer answer = lookup(host, port);
      const std::lock_guard lock(running->mutex);
      running->answer = std::move(answer);
      running->busy = false;
      running->changed.notify_all();
    }).detach();
  } catch (const std::system_error&) {
    return false;
  }
  running_->busy = true;
  return true;
}

Resolver::Found Resolver::find(Micros deadline_us) {
  if (numeric_) {
    return {last_, ""};
  }
  const Micros left_us = deadline_us - mono_now_us();
  std::unique_lock lock(running_->mutex);
  if (!running_->busy && !running_->answer && !start()) {
    return {last_, last_ ? "" : "no thread can be had to look its name up; this host is at its limit"};
  }
  running_->changed.wait_for(lock, std::chrono::microseconds(last_ ? left_us / 2 : left_us),
                             [this] { return running_->answer || running_->interrupted; });
  const std::optional<Answer> answer = std::exchange(running_->answer, std::nullopt);
  if (answer && answer->addresses) {
    last_ = answer->addresses;
    return {last_, ""};
  }
  if (last_ && (!answer || answer->error == EAI_AGAIN)) {
    return {last_, ""};
  }
  return {
      {},
      answer ? std::string(gai_strerror(answer->error)) + kRemedy : "no name server answers" + std::string(kRemedy)};
}

void Resolver::interrupt() {
  const std::lock_guard lock(running_->mutex);
  running_->interrupted = true;
  running_->changed.notify_all();
}

}  // namespace tacho::recorder
