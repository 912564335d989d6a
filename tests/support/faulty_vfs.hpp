#pragma once
// A disk that loses power and fails, under one folder.
//
// While a FaultyDisk lives, it is SQLite's default VFS. Files stay ordinary files, so everything reads what was
// written; beside them the disk keeps what a power cut would leave: contents as of the last sync of each file, names as
// of the last sync of the folder, and the changes since. The calls that the store makes without SQLite (fsync of a
// folder, rename, mkdir, removing a file) are caught by this program's own fsync(), fdatasync(), rename(), mkdir() and
// remove(), which is why
// tests that use a FaultyDisk are binaries of their own. No real sync happens, so that thousands of commits take
// seconds.
//
// Thread rule: one FaultyDisk at a time, used by one thread.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <string>

namespace tacho::test {

enum class Call : std::uint8_t { open, write, sync, truncate, remove, rename, folder_sync, make_folder, shared_memory };

enum class FaultKind : std::uint8_t {
  no_space,     ///< ENOSPC
  io_error,     ///< EIO
  short_write,  ///< ENOSPC after half of the bytes; of other calls the same as no_space
};

struct Fault {
  FaultKind kind = FaultKind::io_error;
  std::uint64_t at = 0;   ///< fails the call with this number; calls() counts from 0
  bool for_good = false;  ///< ... and all after it, until heal()
};

class FaultyDisk {
 public:
  /// What is left in a folder: file name -> content. `exists`: false when the folder itself was lost.
  struct Image {
    bool exists = true;
    std::map<std::string, std::string> files;
  };

  /// Files that are there already are on disk.
  explicit FaultyDisk(const std::filesystem::path& folder);
  ~FaultyDisk();
  FaultyDisk(const FaultyDisk&) = delete;
  FaultyDisk& operator=(const FaultyDisk&) = delete;

  /// Calls so far that change something.
  [[nodiscard]] std::uint64_t calls() const;
  /// Called before each of them.
  void before_each_call(std::function<void(Call)> hook);

  /// What a power cut now would leave. Of the changes since the last sync of a file each is dropped, kept, or torn at a
  /// multiple of 512 bytes; of the changes of names since the last sync of the folder the first few are kept, as on
  /// file systems with a journal.
  [[nodiscard]] Image after_power_cut(std::mt19937& random) const;

  /// Writes that would make the files of the folder take more than this, together, fail with ENOSPC.
  void set_capacity(std::optional<std::uint64_t> bytes);
  /// What they take now; the shared memory beside a WAL does not count.
  [[nodiscard]] std::uint64_t used() const;

  void inject(const Fault& fault);
  void heal();
  /// True when the injected fault has happened.
  [[nodiscard]] bool struck() const;

  struct Impl;

 private:
  std::unique_ptr<Impl> impl_;
};

/// Makes `folder` hold what is in the image, and nothing else.
void write_image(const FaultyDisk::Image& image, const std::filesystem::path& folder);

}  // namespace tacho::test
