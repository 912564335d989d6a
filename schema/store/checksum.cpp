#include "schema/store/checksum.hpp"

#include <array>
#include <cstddef>
#include <cstring>

namespace tacho::store {

namespace {

constexpr std::uint32_t kPolynomial = 0x82F63B78U;
constexpr std::size_t kSlices = 8;
using Tables = std::array<std::array<std::uint32_t, 256>, kSlices>;

// Slicing by 8: table k advances a byte over k further zero bytes.
constexpr Tables make_tables() {
  Tables tables{};
  for (std::uint32_t byte = 0; byte < 256; ++byte) {
    std::uint32_t crc = byte;
    for (int bit = 0; bit < 8; ++bit) {
      crc = (crc >> 1U) ^ ((crc & 1U) != 0 ? kPolynomial : 0U);
    }
    tables[0][byte] = crc;
  }
  for (std::size_t k = 1; k < kSlices; ++k) {
    for (std::size_t byte = 0; byte < 256; ++byte) {
      tables[k][byte] = (tables[k - 1][byte] >> 8U) ^ tables[0][tables[k - 1][byte] & 0xFFU];
    }
  }
  return tables;
}

constexpr Tables kCrcTables = make_tables();

constexpr std::uint32_t byte_at(std::uint64_t word, unsigned index) {
  return static_cast<std::uint32_t>(word >> (8U * index)) & 0xFFU;
}

std::uint32_t advance(std::uint32_t crc, std::uint64_t word) {
  word ^= crc;
  std::uint32_t next = 0;
  for (unsigned i = 0; i < kSlices; ++i) {
    next ^= kCrcTables[kSlices - 1 - i][byte_at(word, i)];
  }
  return next;
}

#if defined(__x86_64__)
constexpr std::size_t kLaneBytes = 128;
using LaneTables = std::array<std::array<std::uint32_t, 256>, sizeof(std::uint32_t)>;

// Table k advances byte k of a sum over a lane of zero bytes.
constexpr LaneTables make_lane_tables() {
  LaneTables tables{};
  for (std::size_t k = 0; k < tables.size(); ++k) {
    for (std::uint32_t byte = 1; byte < 256; ++byte) {
      const std::uint32_t others = byte & (byte - 1);
      if (others != 0) {
        tables[k][byte] = tables[k][others] ^ tables[k][byte ^ others];
        continue;
      }
      std::uint32_t crc = byte << (8 * k);
      for (std::size_t i = 0; i < kLaneBytes; ++i) {
        crc = (crc >> 8U) ^ kCrcTables[0][crc & 0xFFU];
      }
      tables[k][byte] = crc;
    }
  }
  return tables;
}

constexpr LaneTables kLaneTables = make_lane_tables();

std::uint64_t advance_lane(std::uint64_t crc) {
  std::uint32_t next = 0;
  for (unsigned k = 0; k < kLaneTables.size(); ++k) {
    next ^= kLaneTables[k][byte_at(crc, k)];
  }
  return next;
}

std::uint64_t read_word(const char* bytes) {
  std::uint64_t word = 0;
  std::memcpy(&word, bytes, sizeof word);
  return word;
}

/// The same sum by the instruction made for it, eight times as fast. A sum waits for itself three times as long as the
/// instruction takes, so three lanes are added up at once.
__attribute__((target("sse4.2"))) std::uint32_t add_with_instruction(std::uint32_t crc, std::string_view& bytes) {
  std::uint64_t state = crc;
  for (; bytes.size() >= 3 * kLaneBytes; bytes.remove_prefix(3 * kLaneBytes)) {
    std::uint64_t second = 0;
    std::uint64_t third = 0;
    for (std::size_t i = 0; i < kLaneBytes; i += sizeof(std::uint64_t)) {
      const char* const at = bytes.data() + i;
      state = __builtin_ia32_crc32di(state, read_word(at));
      second = __builtin_ia32_crc32di(second, read_word(at + kLaneBytes));
      third = __builtin_ia32_crc32di(third, read_word(at + 2 * kLaneBytes));
    }
    state = advance_lane(advance_lane(state) ^ second) ^ third;
  }
  for (; bytes.size() >= sizeof(std::uint64_t); bytes.remove_prefix(sizeof(std::uint64_t))) {
    state = __builtin_ia32_crc32di(state, read_word(bytes.data()));
  }
  return static_cast<std::uint32_t>(state);
}
const bool kHasInstruction = __builtin_cpu_supports("sse4.2") != 0;
#else
std::uint32_t add_with_instruction(std::uint32_t crc, std::string_view&) { return crc; }
constexpr bool kHasInstruction = false;
#endif

}  // namespace

Checksum& Checksum::add(std::int64_t value) {
  std::string_view bytes(reinterpret_cast<const char*>(&value), sizeof value);
  state_ = kHasInstruction ? add_with_instruction(state_, bytes) : advance(state_, static_cast<std::uint64_t>(value));
  return *this;
}

Checksum& Checksum::add_bytes(std::string_view bytes) {
  if (kHasInstruction) {
    state_ = add_with_instruction(state_, bytes);
  }
  while (bytes.size() >= kSlices) {
    std::uint64_t word = 0;
    for (unsigned i = 0; i < kSlices; ++i) {
      word |= std::uint64_t{static_cast<unsigned char>(bytes[i])} << (8U * i);
    }
    state_ = advance(state_, word);
    bytes.remove_prefix(kSlices);
  }
  for (const char c : bytes) {
    state_ = (state_ >> 8U) ^ kCrcTables[0][(state_ ^ static_cast<unsigned char>(c)) & 0xFFU];
  }
  return *this;
}

}  // namespace tacho::store
