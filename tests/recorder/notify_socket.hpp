#pragma once
// The service manager's end of NOTIFY_SOCKET.

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstddef>
#include <cstring>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/support/temp_dir.hpp"

namespace tacho::recorder::test {

class NotifySocket {
 public:
  /// `nameless`: in the abstract namespace, as in containers.
  explicit NotifySocket(bool nameless = false) : path_((dir_ / "notify").string()) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::memcpy(address.sun_path, path_.data(), path_.size());
    if (nameless) {
      address.sun_path[0] = '\0';
      path_[0] = '@';
    }
    fd_ = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + path_.size());
    if (bind(fd_, reinterpret_cast<const sockaddr*>(&address), size) != 0) {
      throw std::runtime_error("cannot bind a notify socket");
    }
  }
  ~NotifySocket() { close(fd_); }
  NotifySocket(const NotifySocket&) = delete;
  NotifySocket& operator=(const NotifySocket&) = delete;
  [[nodiscard]] const std::string& address() const { return path_; }

  /// What has come since the last call.
  std::vector<std::string> take() {
    std::vector<std::string> out;
    char buffer[4096];
    for (ssize_t n = recv(fd_, buffer, sizeof buffer, 0); n >= 0; n = recv(fd_, buffer, sizeof buffer, 0)) {
      out.emplace_back(buffer, static_cast<std::size_t>(n));
    }
    return out;
  }

 private:
  tacho::test::TempDir dir_;
  std::string path_;
  int fd_ = -1;
};

}  // namespace tacho::recorder::test
