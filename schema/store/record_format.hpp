#pragma once
// How SQLite lays out records in pages: https://www.sqlite.org/fileformat2.html. For those who read a file past SQLite.

#include <cstddef>
#include <cstdint>
#include <string_view>

namespace tacho::store {

inline constexpr std::size_t kFileHeader = 100;
inline constexpr unsigned char kTableLeaf = 0x0D;
inline constexpr std::size_t kLeafHeader = 8;
inline constexpr std::size_t kLinkBytes = 4;  ///< number of the next overflow page

inline unsigned byte_at(std::string_view bytes, std::size_t at) { return static_cast<unsigned char>(bytes[at]); }

inline std::uint64_t big_endian(std::string_view bytes, std::size_t at, std::size_t count) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < count; ++i) {
    value = value << 8U | byte_at(bytes, at + i);
  }
  return value;
}

/// SQLite's variable-length integer, at most nine bytes. False at the end of the bytes.
inline bool take_varint(std::string_view bytes, std::size_t& at, std::uint64_t& value) {
  value = 0;
  for (int i = 0; i < 8; ++i) {
    if (at >= bytes.size()) {
      return false;
    }
    const unsigned byte = byte_at(bytes, at++);
    value = value << 7U | (byte & 0x7FU);
    if (byte < 0x80U) {
      return true;
    }
  }
  if (at >= bytes.size()) {
    return false;
  }
  value = value << 8U | byte_at(bytes, at++);
  return true;
}

/// Bytes of a payload that stand in the page itself.
inline std::size_t local_bytes(std::uint64_t total, std::size_t usable, bool table) {
  const std::size_t most = table ? usable - 35 : (usable - 12) * 64 / 255 - 23;
  if (total <= most) {
    return static_cast<std::size_t>(total);
  }
  const std::size_t least = (usable - 12) * 32 / 255 - 23;
  const std::size_t fitting = least + static_cast<std::size_t>((total - least) % (usable - kLinkBytes));
  return fitting <= most ? fitting : least;
}

}  // namespace tacho::store
