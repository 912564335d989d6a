#pragma once
// Numbers as bytes inside a block: little-endian, varints of seven bits, low group first.

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
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
  explicit ByteReader(std::string_view bytes) : at_(bytes.data()), end_(bytes.data() + bytes.size()) {}

  std::string_view take(std::uint64_t count) {
    if (count > left()) {
      fail();
      return {};
    }
    const std::string_view head(at_, count);
    at_ += count;
    return head;
  }
  std::uint8_t byte() {
    if (at_ == end_) {
      fail();
      return 0;
    }
    return static_cast<std::uint8_t>(*at_++);
  }
  std::uint64_t varint() {
    if (at_ != end_ && static_cast<std::uint8_t>(*at_) < 0x80) {  // nearly all of a directory
      return static_cast<std::uint8_t>(*at_++);
    }
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
    if (head.empty()) {
      return 0;
    }
    if constexpr (std::endian::native == std::endian::little) {
      std::memcpy(&value, head.data(), sizeof value);
      return static_cast<Integer>(value);
    }
    for (std::size_t i = 0; i < sizeof value; ++i) {
      value = static_cast<std::make_unsigned_t<Integer>>(
          value | static_cast<std::make_unsigned_t<Integer>>(static_cast<unsigned char>(head[i])) << (8U * i));
    }
    return static_cast<Integer>(value);
  }

  [[nodiscard]] bool good() const { return good_; }
  [[nodiscard]] std::size_t left() const { return static_cast<std::size_t>(end_ - at_); }

 private:
  const char* at_;
  const char* end_;
  bool good_ = true;
  void fail() {
    good_ = false;
    at_ = end_;
  }
};

/// The bytes of a block, wherever they are; only what is asked for needs to be there.
class BlockBytes {
 public:
  virtual ~BlockBytes() = default;
  [[nodiscard]] virtual std::size_t size() const = 0;
  /// Bytes from `offset` on, fewer than `length` where the block ends before. They stay where they are.
  [[nodiscard]] virtual std::string_view at(std::size_t offset, std::size_t length) = 0;
};

/// A block that is in memory as a whole, and stays there.
class WholeBlock final : public BlockBytes {
 public:
  explicit WholeBlock(std::string_view bytes = {}) : bytes_(bytes) {}
  [[nodiscard]] std::size_t size() const override { return bytes_.size(); }
  [[nodiscard]] std::string_view at(std::size_t offset, std::size_t length) override {
    return bytes_.substr(std::min(offset, bytes_.size()), length);
  }

 private:
  std::string_view bytes_;
};

}  // namespace tacho::store
