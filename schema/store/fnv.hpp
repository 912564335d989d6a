#pragma once
// FNV-1a, 64 bit (http://www.isthe.com/chongo/tech/comp/fnv/).

#include <cstdint>
#include <string_view>

namespace tacho::store {

class Fnv {
 public:
  Fnv& add(std::string_view bytes) {
    for (const char byte : bytes) {
      value_ = (value_ ^ static_cast<unsigned char>(byte)) * 0x100000001b3U;
    }
    return *this;
  }
  /// The low `bytes` bytes, the lowest first.
  Fnv& add(std::uint64_t number, int bytes) {
    for (int i = 0; i < bytes; ++i) {
      value_ = (value_ ^ ((number >> (8 * i)) & 0xffU)) * 0x100000001b3U;
    }
    return *this;
  }
  [[nodiscard]] std::uint64_t value() const { return value_; }

 private:
  std::uint64_t value_ = 0xcbf29ce484222325U;
};

}  // namespace tacho::store
