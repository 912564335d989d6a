#pragma once
// One byte of a file turned, and which bytes to turn.

#include <fcntl.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "tests/support/catch.hpp"

namespace tacho::test {

/// The file with one byte changed, for as long as this lives.
class Flip {
 public:
  Flip(const std::filesystem::path& path, std::uint64_t offset)
      : file_(open(path.c_str(), O_RDWR | O_CLOEXEC)), offset_(static_cast<off_t>(offset)) {
    REQUIRE(pread(file_, &byte_, 1, offset_) == 1);
    const auto changed = static_cast<unsigned char>(byte_ ^ mask(offset));
    REQUIRE(pwrite(file_, &changed, 1, offset_) == 1);
  }
  ~Flip() {
    static_cast<void>(!pwrite(file_, &byte_, 1, offset_));
    close(file_);
  }
  Flip(const Flip&) = delete;
  Flip& operator=(const Flip&) = delete;

  /// All bits of every third byte, one bit of the others.
  static unsigned mask(std::uint64_t offset) { return offset % 3 == 0 ? 0xFFU : 1U << (offset % 8); }

 private:
  int file_;
  off_t offset_;
  unsigned char byte_ = 0;
};

inline bool long_sweep() { return std::getenv("TACHO_LONG") != nullptr; }

/// A page begins at every multiple of it.
inline constexpr std::uint64_t kSpacing = 4096;

/// All with TACHO_LONG; else all of the file header, head and first cells of a page every 4096 bytes, and a sample of
/// the rest.
inline bool chosen(std::uint64_t offset) {
  return long_sweep() || offset < 100 || offset % kSpacing < 12 || offset % 151 == 0;
}

/// Of a whole SQLite file.
inline std::size_t page_bytes_of(const std::string& file) {
  return static_cast<std::size_t>(static_cast<unsigned char>(file[16])) << 8U | static_cast<unsigned char>(file[17]);
}

}  // namespace tacho::test
