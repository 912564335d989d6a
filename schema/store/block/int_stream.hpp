#pragma once
// A column of 64-bit patterns as few bytes. The writer tries every combination that promises something and keeps the
// smallest:
//   1. prediction: none (less the smallest), the value before, the line through the two before (those differences are
//      zigzagged), or one straight line through all (stamps of a schedule). All arithmetic wraps, so the bit patterns
//      of floating point numbers go the same way.
//   2. where many differences are zero: a bitmap of the others, and only those
//   3. low bits that are noise are packed as they are, so that they neither spoil the statistics of the bits above nor
//      cost time to unpack; the bits above them are cut into byte planes (all lowest bytes, then all second ones, ...)
//      that go through zstd, together or one by one.
//
// Layout: flags (prediction, bit 2 sparse, bit 3 one by one, planes << 4), low bits per value, one or two signed
// varints (base; first value; first value and first difference; base and slope in 2^-16), [bitmap piece], low bits,
// pieces of the planes.

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "schema/store/block/packing.hpp"

namespace tacho::store {

/// Appends the values to `out`. How many there are is not stored.
void encode_ints(std::span<const std::int64_t> values, Packer& packer, std::string& out);

/// Reads integer columns; keeps its buffers from call to call. One thread per object.
class IntReader {
 public:
  /// Takes `count` values; memory is taken for what the bytes really hold. False: damaged.
  [[nodiscard]] bool take(ByteReader& in, std::size_t count, std::vector<std::int64_t>& values);
  Unpacker& unpacker() { return unpacker_; }

 private:
  struct Header {
    std::uint8_t flags = 0;
    unsigned planes = 0;
    unsigned low = 0;
  };
  Unpacker unpacker_;
  std::vector<char> bitmap_;
  std::vector<char> planes_[8];
  std::vector<std::uint64_t> dense_;
  bool take_planes(ByteReader& in, const Header& header, std::size_t count, std::uint64_t* out);
  bool take_residuals(ByteReader& in, const Header& header, std::vector<std::int64_t>& values);
};

}  // namespace tacho::store
