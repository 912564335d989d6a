#pragma once
// Register images: the raw form of a `registers` or `inputs` answer, and its decoding.
//
// Image bytes, repeated per range read: first address as documented (u16 BE, from 1), count (u16 BE), then the payload
// exactly as in the Modbus answer: 2 x count bytes for [3x], ceil(count / 8) bytes for [1x], lowest bit first.

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "schema/records.hpp"
#include "schema/sample.hpp"

namespace tacho::wire {

/// Documented addresses first .. first + count - 1.
struct Range {
  std::uint16_t first = 1;
  std::uint16_t count = 0;
  friend bool operator==(const Range&, const Range&) = default;
};

/// "1-100,120-140"
std::string to_text(std::span<const Range> ranges);

/// Appends one range of words ([3x]) to an image.
void append_words(std::string& image, Range range, std::span<const std::uint16_t> words);
/// Appends one range of bits ([1x]), one byte 0/1 per bit as libmodbus gives them.
void append_bits(std::string& image, Range range, std::span<const std::uint8_t> bits);

/// Appends one range as its answer carried it: the payload behind the byte count.
void append_range(std::string& image, Range range, std::string_view payload);

/// Fills the fields in `wanted` that have a [3x] register. Fields in ranges that were not read stay absent. `gates`
/// says whether conditions hold; an unknown condition makes a field not_meaningful. A malformed image: decodable =
/// false.
void decode_registers(std::string_view image, WordOrder order, const Gates& gates, const FieldSet& wanted, Sample& out);

/// Fills the fields in `wanted` that have a [1x] input, and updates `gates` from the flags that conditions name.
void decode_inputs(std::string_view image, const FieldSet& wanted, Gates& gates, Sample& out);

/// Two words in the given order -> the 32-bit pattern.
std::uint32_t join_words(std::uint16_t first, std::uint16_t second, WordOrder order);
/// The inverse: what a robot with that order puts into the two registers.
void split_words(std::uint32_t bits, WordOrder order, std::uint16_t& first, std::uint16_t& second);

/// Plans requests for every [3x] field (or [1x] when `discrete`): ranges of at most `max_count`, merged over gaps of at
/// most `max_gap` unused registers (16 inputs count as one), no value split, ends rounded up to the next ten where the
/// gap rule allows it. With the defaults these are the vendor tool's requests: [3x] 1-100 and 120-140; [1x] 1-80.
std::vector<Range> plan_ranges(bool discrete, std::uint16_t max_count = 100, std::uint16_t max_gap = 20);
/// The runs exactly as documented, without gaps in between: the fallback when a gap-spanning request is refused.
std::vector<Range> documented_runs(bool discrete);

/// How plausible an image is under a word order, 0..1: share of present temperatures, voltages, currents and hours
/// inside physical bounds (FIELD-FACTS section 3).
double plausibility(std::string_view image, WordOrder order);

}  // namespace tacho::wire
