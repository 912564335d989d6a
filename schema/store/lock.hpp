#pragma once
// One writer per log. The lock is flock() on a file in the folder: the kernel drops it when the process dies, so a kill
// never leaves a stale lock. The file's text says who holds it, unless the disk was full.

#include <filesystem>
#include <string>

namespace tacho::store {

class FolderLock {
 public:
  /// Throws Error naming the holder when another writer has the folder, or when the file cannot be made.
  explicit FolderLock(const std::filesystem::path& folder);
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

  static constexpr const char* kFileName = "recorder.lock";

 private:
  int file_ = -1;
};

}  // namespace tacho::store
