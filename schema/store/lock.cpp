#include "schema/store/lock.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>

#include "schema/error.hpp"

namespace tacho::store {

namespace {

std::string self() {
  std::array<char, 256> host{};
  if (gethostname(host.data(), host.size() - 1) != 0) {
    host[0] = '?';
  }
  return "process " + std::to_string(getpid()) + " on " + host.data();
}

std::string holder(int file) {
  std::array<char, 320> text{};
  const ssize_t size = pread(file, text.data(), text.size() - 1, 0);
  return size > 0 ? std::string(text.data(), static_cast<std::size_t>(size)) : std::string("another process");
}

}  // namespace

FolderLock::FolderLock(const std::filesystem::path& folder) {
  const std::string path = (folder / kFileName).string();
  file_ = open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (file_ < 0) {
    throw Error(path, std::strerror(errno), "choose a folder that this user may write to");
  }
  if (flock(file_, LOCK_EX | LOCK_NB) != 0) {
    const int error = errno;
    const std::string who = holder(file_);
    close(file_);
    if (error == EWOULDBLOCK) {
      throw Error(folder.string(), "this log is being recorded by " + who, "stop it first, or choose another folder");
    }
    throw Error(path, std::strerror(error), "choose a folder on a local disk");
  }
  const std::string who = self();
  if (ftruncate(file_, 0) != 0 || pwrite(file_, who.data(), who.size(), 0) != static_cast<ssize_t>(who.size())) {
    // On a full disk nobody reads who has the lock; it holds all the same.
  }
}

// The file stays: removing it would let two writers lock two files of the same name.
FolderLock::~FolderLock() { close(file_); }

}  // namespace tacho::store
