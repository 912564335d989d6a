#pragma once
// CRC-32C (Castagnoli, reflected polynomial 0x82F63B78; RFC 3720 appendix B.4) over the values of a row.

#include <cstdint>
#include <string_view>

namespace tacho::store {

class Checksum {
 public:
  /// Eight bytes, little-endian.
  Checksum& add(std::int64_t value);
  /// The bytes as they are. Where two texts follow each other, add their lengths too.
  Checksum& add_bytes(std::string_view bytes);
  /// Length and bytes.
  Checksum& add(std::string_view text) { return add(static_cast<std::int64_t>(text.size())).add_bytes(text); }
  /// As stored: the signed reading of the 32 bits, which SQLite keeps in 4 bytes.
  [[nodiscard]] std::int64_t value() const { return static_cast<std::int32_t>(~state_); }

 private:
  std::uint32_t state_ = 0xFFFFFFFFU;
};

}  // namespace tacho::store
