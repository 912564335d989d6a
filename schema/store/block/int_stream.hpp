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

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "schema/store/block/packing.hpp"

namespace tacho::store {

/// Appends the values to `out`. How many there are is not stored.
void encode_ints(std::span<const std::int64_t> values, Packer& packer, std::string& out);

/// Reads integer columns; keeps its buffers from call to call. One thread per object.
class IntReader {
 public:
  /// Gets a run of values, the first of them number `begin`.
  using UseRun = std::function<void(std::size_t begin, std::span<const std::int64_t> values)>;
  /// No run is longer; all but the last have this length.
  static constexpr std::size_t kRun = 512;

  /// Takes `count` values, in order, and hands them on; memory is taken for what the bytes really hold. False: damaged,
  /// and what was handed on is worth nothing.
  [[nodiscard]] bool take(ByteReader& in, std::size_t count, const UseRun& use);
  [[nodiscard]] bool take(ByteReader& in, std::size_t count, std::vector<std::int64_t>& values);
  Unpacker& unpacker() { return unpacker_; }

 private:
  Unpacker unpacker_;
  std::vector<char> buffers_[8];
  std::vector<char> bitmap_;
  std::vector<std::uint64_t> others_;  ///< sparse: residuals that are not zero
  // Of the column that is being read:
  unsigned low_ = 0;
  unsigned plane_count_ = 0;
  std::array<const char*, 8> planes_{};
  std::string_view low_bits_;
  std::string_view bits_;  ///< sparse: which residuals are not zero

  bool take_planes(ByteReader& in, unsigned planes, bool one_by_one, std::size_t count);
  bool take_sparse(ByteReader& in, unsigned planes, bool one_by_one, std::size_t count);
  void residuals(std::size_t begin, std::span<std::uint64_t> out) const;
};

}  // namespace tacho::store
