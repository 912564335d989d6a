#include "recorder/mark.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <system_error>
#include <utility>

#include "schema/text.hpp"

namespace tacho::recorder {

namespace {

constexpr const char* kFileName = "recorder.sock";
constexpr std::string_view kMagic = "mark\n";  // of a datagram, then the robot, a line feed, the text

std::string why(int error) { return std::generic_category().message(error); }

/// Owns a descriptor.
class Handle {
 public:
  explicit Handle(int fd) : fd_(fd) {}
  ~Handle() {
    if (fd_ >= 0) {
      ::close(fd_);
    }
  }
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;
  [[nodiscard]] int get() const { return fd_; }
  int release() { return std::exchange(fd_, -1); }

 private:
  int fd_;
};

/// The address of the socket in an open folder: paths of any length fit.
sockaddr_un address_in(const Handle& folder) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::string path = fmt::format("/proc/self/fd/{}/{}", folder.get(), kFileName);
  std::memcpy(address.sun_path, path.data(), std::min(path.size(), sizeof(address.sun_path) - 1));
  return address;
}

/// Length of the UTF-8 sequence that `text` begins with; 0 when it is none.
std::size_t sequence_length(std::string_view text) {
  const auto first = static_cast<unsigned char>(text[0]);
  const std::size_t length = first < 0x80                    ? 1
                             : first >= 0xC2 && first < 0xE0 ? 2
                             : first >= 0xE0 && first < 0xF0 ? 3
                             : first >= 0xF0 && first < 0xF5 ? 4
                                                             : 0;
  const auto follows = [](char c) { return (static_cast<unsigned char>(c) & 0xC0U) == 0x80; };
  const bool whole = length > 0 && length <= text.size() &&
                     std::all_of(text.begin() + 1, text.begin() + static_cast<std::ptrdiff_t>(length), follows);
  return whole ? length : 0;
}

bool is_utf8(std::string_view text) {
  while (!text.empty()) {
    const std::size_t length = sequence_length(text);
    if (length == 0) {
      return false;
    }
    text.remove_prefix(length);
  }
  return true;
}

}  // namespace

void check_mark_text(std::string_view text) {
  if (text.empty() || text.size() > kLongestMark || !is_utf8(text)) {
    throw Error("mark",
                text.empty()                 ? "the text is empty"
                : text.size() > kLongestMark ? "the text is too long"
                                             : "the text is no UTF-8",
                fmt::format("write 1 to {} bytes, as in tacho-recorder mark LOG \"pallet slipped\"", kLongestMark));
  }
}

MarkSocket::MarkSocket(const std::filesystem::path& log) : path_(log / kFileName) {
  const auto fail = [this] { return Error(path_.string(), why(errno), "marks cannot be taken"); };
  const Handle folder(::open(log.c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC));
  Handle socket(::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (folder.get() < 0 || socket.get() < 0) {
    throw fail();
  }
  (void)::unlinkat(folder.get(), kFileName, 0);
  const sockaddr_un address = address_in(folder);
  if (::bind(socket.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0 ||
      ::fchmodat(folder.get(), kFileName, S_IRUSR | S_IWUSR | S_IRGRP | S_IWGRP, 0) != 0) {
    throw fail();
  }
  socket_ = socket.release();
}

MarkSocket::~MarkSocket() {
  ::close(socket_);
  std::error_code ignored;
  std::filesystem::remove(path_, ignored);
}

std::optional<Mark> MarkSocket::next() {
  std::array<char, 2 * kLongestMark + 1024> buffer;  // uninitialised on purpose: written by recv
  for (;;) {
    const ssize_t n = ::recv(socket_, buffer.data(), buffer.size(), 0);
    if (n < 0) {
      return std::nullopt;
    }
    std::string_view bytes(buffer.data(), static_cast<std::size_t>(n));
    if (bytes.substr(0, kMagic.size()) != kMagic) {
      continue;
    }
    bytes.remove_prefix(kMagic.size());
    const std::size_t line = bytes.find('\n');
    const std::string_view text = line == std::string_view::npos ? std::string_view() : bytes.substr(line + 1);
    if (!text.empty() && text.size() <= kLongestMark && is_utf8(bytes)) {
      return Mark{printable(std::string(bytes.substr(0, line))), printable(std::string(text))};
    }
  }
}

void send_mark(const std::filesystem::path& log, const Mark& mark) {
  check_mark_text(mark.text);
  const Handle folder(::open(log.c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC));
  if (folder.get() < 0) {
    throw Error(log.string(), why(errno), "name the folder of a log");
  }
  const Handle socket(::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  const sockaddr_un address = address_in(folder);
  const std::string bytes = fmt::format("{}{}\n{}", kMagic, mark.robot, mark.text);
  if (socket.get() >= 0 && ::sendto(socket.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL,
                                    reinterpret_cast<const sockaddr*>(&address), sizeof(address)) >= 0) {
    return;
  }
  if (errno == ENOENT || errno == ECONNREFUSED) {
    throw Error(log.string(), "nobody records into this log", "marks are kept by a running tacho-recorder");
  }
  throw Error(log.string(), fmt::format("the recorder does not take the mark: {}", why(errno)),
              errno == EACCES ? "become the user or a member of the group that records" : "try again");
}

}  // namespace tacho::recorder
