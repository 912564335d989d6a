#pragma once
// What writer and reader of integer columns agree on; the layout is described in int_stream.hpp.

#include <cstddef>
#include <cstdint>

namespace tacho::store {

/// Stored: append only, and no more fit the mask.
enum Prediction : std::uint8_t { kNone, kPrevious, kLine, kTrend };
inline constexpr std::uint8_t kSparse = 4;
inline constexpr std::uint8_t kOneByOne = 8;
inline constexpr std::uint8_t kPredictionMask = 3;
inline constexpr unsigned kTrendFraction = 16;
inline constexpr unsigned kPlanes = 8;
inline constexpr unsigned kMaxLowBits = 56;  // with any start inside a byte they fit 64 bits

/// Where the straight line of a trend is at a row, above its start. `product`: of the row's number and the slope.
constexpr std::int64_t trend_at(std::uint64_t product) { return static_cast<std::int64_t>(product) >> kTrendFraction; }

}  // namespace tacho::store
