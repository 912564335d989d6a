#include "recorder/log_holder.hpp"

#include <fmt/format.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>

#include <fstream>
#include <sstream>

#include "schema/store/lock.hpp"

namespace tacho::recorder {

namespace {

struct HeldLock {
  std::string kind;  // FLOCK
  std::string process;
  std::string device;  // "fd:01", hexadecimal
  std::string inode;
};

/// "1: FLOCK  ADVISORY  WRITE 812 fd:01:1837 0 EOF"; a waiter has "->" in place of the kind.
HeldLock parse(const std::string& line) {
  HeldLock lock;
  std::istringstream words(line);
  std::string number;
  std::string advisory;
  std::string access;
  std::string file;
  words >> number >> lock.kind >> advisory >> access >> lock.process >> file;
  const std::size_t colon = file.rfind(':');
  if (colon != std::string::npos) {
    lock.device = file.substr(0, colon);
    lock.inode = file.substr(colon + 1);
  }
  return lock;
}

}  // namespace

std::string log_holder(const std::filesystem::path& log) {
  const std::filesystem::path path = log / store::FolderLock::kFileName;
  struct stat file {};
  if (stat(path.c_str(), &file) != 0) {
    return "";
  }
  std::string text;
  std::getline(std::ifstream(path), text);
  const std::string device = fmt::format("{:02x}:{:02x}", major(file.st_dev), minor(file.st_dev));
  std::ifstream locks("/proc/locks");
  for (std::string line; std::getline(locks, line);) {
    const HeldLock lock = parse(line);
    // On some file systems stat() names another device than the kernel: there the process has to be the same.
    const bool same = lock.device == device || text.rfind("process " + lock.process + " ", 0) == 0;
    if (lock.kind == "FLOCK" && lock.inode == fmt::format("{}", file.st_ino) && same) {
      return text.empty() ? "process " + lock.process : text;
    }
  }
  return "";
}

}  // namespace tacho::recorder
