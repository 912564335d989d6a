#pragma once
// Numbers as bytes inside a block: little-endian, varints of seven bits, low group first.

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <type_traits>

namespace tacho::store {

inline std::uint64_t zigzag(std::int64_t value) {
  return (static_cast<std::uint64_t>(value) << 1U) ^ static_cast<std::uint64_t>(value >> 63);
}
inline std::int64_t unzigzag(std::uint64_t value) {
  return static_cast<std::int64_t>((value >> 1U) ^ (0 - (value & 1U)));
}

inline void put_varint(std::string& out, std::uint64_t value) {
  for (; value >= 0x80; value >>= 7U) {
    out.push_back(static_cast<char>(value | 0x80U));
  }
  out.push_back(static_cast<char>(value));
}

template <class Integer>
void put_fixed(std::string& out, Integer value) {
  for (unsigned i = 0; i < sizeof value; ++i) {
    out.push_back(static_cast<char>(static_cast<std::make_unsigned_t<Integer>>(value) >> (8U * i)));
  }
}

/// Takes numbers from the front of untrusted bytes. What is not there reads as zero or empty and makes `good()` false
/// for ever. Views point into the bytes given.
class ByteReader {
 public:
  explicit ByteReader(std::string_view bytes) : bytes_(bytes) {}

  std::string_view take(std::uint64_t count) {
    if (count > bytes_.size()) {
      fail();
      return {};
    }
    const std::string_view head = bytes_.substr(0, count);
    bytes_.remove_prefix(count);
    return head;
  }
  std::uint8_t byte() {
    if (bytes_.empty()) {
      fail();
      return 0;
    }
    const auto value = static_cast<std::uint8_t>(bytes_.front());
    bytes_.remove_prefix(1);
    return value;
  }
  std::uint64_t varint() {
    std::uint64_t value = 0;
    for (unsigned shift = 0; shift < 64; shift += 7) {
      const std::uint8_t b = byte();
      value |= std::uint64_t{b & 0x7FU} << shift;
      if (b < 0x80) {
        return value;
      }
    }
    fail();
    return 0;
  }
  std::int64_t signed_varint() { return unzigzag(varint()); }
  template <class Integer>
  Integer fixed() {
    std::make_unsigned_t<Integer> value = 0;
    const std::string_view head = take(sizeof value);
    for (std::size_t i = 0; i < head.size(); ++i) {
      value = static_cast<std::make_unsigned_t<Integer>>(
          value | static_cast<std::make_unsigned_t<Integer>>(static_cast<unsigned char>(head[i])) << (8U * i));
    }
    return static_cast<Integer>(value);
  }

  [[nodiscard]] bool good() const { return good_; }
  [[nodiscard]] std::size_t left() const { return bytes_.size(); }

 private:
  std::string_view bytes_;
  bool good_ = true;
  void fail() {
    good_ = false;
    bytes_ = {};
  }
};

}  // namespace tacho::store
