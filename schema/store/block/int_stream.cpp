#include "schema/store/block/int_stream.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <utility>

#include "schema/store/block/int_layout.hpp"

namespace tacho::store {

namespace {

constexpr auto kPredictions = std::to_array<Prediction>({kNone, kPrevious, kLine, kTrend});

std::int64_t subtract(std::int64_t a, std::int64_t b) {
  return static_cast<std::int64_t>(static_cast<std::uint64_t>(a) - static_cast<std::uint64_t>(b));
}

/// What is left of the values after prediction, and the varints that start it.
struct Residuals {
  std::vector<std::uint64_t> values;
  std::string seeds;
};

/// The smallest value with its low bits cleared where that costs no plane: then the low bits stay as they are, and what
/// they were (say, the mantissa of a double) does not borrow from the bits above.
std::int64_t base_of(std::span<const std::int64_t> values) {
  const auto [min, max] = std::minmax_element(values.begin(), values.end());
  const auto range = static_cast<std::uint64_t>(subtract(*max, *min));
  constexpr int kTopBits = 4;
  const int clear = std::max(static_cast<int>(std::bit_width(range)) - kTopBits, 0);
  const auto base = static_cast<std::int64_t>(static_cast<std::uint64_t>(*min) >> clear << clear);
  const auto planes = [](std::uint64_t value) { return (std::bit_width(value) + 7) / 8; };
  return planes(static_cast<std::uint64_t>(subtract(*max, base))) > planes(range) ? *min : base;
}

Residuals less_base(std::span<const std::int64_t> values) {
  Residuals left;
  const std::int64_t base = base_of(values);
  put_varint(left.seeds, zigzag(base));
  for (const std::int64_t value : values) {
    left.values.push_back(static_cast<std::uint64_t>(subtract(value, base)));
  }
  return left;
}

/// Steps between first and last value, in 2^-kTrendFraction; 0 when there is no sensible line.
std::uint64_t trend_of(std::span<const std::int64_t> values) {
  const std::int64_t rise = subtract(values.back(), values.front());
  constexpr std::int64_t kSteep = std::int64_t{1} << 46U;  // of a block; more would wrap
  if (values.size() < 3 || rise > kSteep || rise < -kSteep) {
    return 0;
  }
  return static_cast<std::uint64_t>((rise << kTrendFraction) / static_cast<std::int64_t>(values.size() - 1));
}

Residuals less_trend(std::span<const std::int64_t> values) {
  const std::uint64_t slope = trend_of(values);
  std::vector<std::int64_t> level(values.begin(), values.end());
  for (std::size_t i = 0; i < level.size(); ++i) {
    level[i] = subtract(level[i], trend_at(i * slope));
  }
  Residuals left = less_base(level);
  put_varint(left.seeds, zigzag(static_cast<std::int64_t>(slope)));
  return left;
}

Residuals predict(std::span<const std::int64_t> values, Prediction prediction) {
  if (prediction == kNone) {
    return less_base(values);
  }
  if (prediction == kTrend) {
    return less_trend(values);
  }
  Residuals left;
  left.values.resize(values.size());
  put_varint(left.seeds, zigzag(values[0]));
  std::int64_t slope = 0;
  if (prediction == kLine) {
    slope = values.size() > 1 ? subtract(values[1], values[0]) : 0;
    put_varint(left.seeds, zigzag(slope));
  }
  for (std::size_t i = 1; i < values.size(); ++i) {
    const std::int64_t difference = subtract(values[i], values[i - 1]);
    left.values[i] = zigzag(prediction == kLine ? subtract(difference, slope) : difference);
    slope = difference;
  }
  return left;
}

/// Bytes an ideal order-0 coder would need for a plane; more than the plane itself when it is noise.
double ideal_bytes(std::string_view plane) {
  std::array<std::uint32_t, 256> counts{};
  for (const char c : plane) {
    ++counts[static_cast<unsigned char>(c)];
  }
  double bits = 0;
  std::size_t symbols = 0;
  for (const std::uint32_t count : counts) {
    if (count > 0) {
      bits -= count * std::log2(static_cast<double>(count) / static_cast<double>(plane.size()));
      ++symbols;
    }
  }
  // A table costs about four bits per symbol.
  return bits / 8 + static_cast<double>(symbols) / 2;
}

/// What coding the lengths of the values would take, and their bits as they are.
double likely_bits(std::span<const std::uint64_t> values) {
  std::array<std::uint32_t, 65> lengths{};
  for (const std::uint64_t value : values) {
    ++lengths[static_cast<std::size_t>(std::bit_width(value))];
  }
  double bits = 0;
  for (std::size_t length = 0; length < lengths.size(); ++length) {
    if (lengths[length] > 0) {
      const double count = lengths[length];
      bits += count * (static_cast<double>(length > 0 ? length - 1 : 0) -
                       std::log2(count / static_cast<double>(values.size())));
    }
  }
  return bits;
}

/// Low bits that look like noise: about as often set as not.
unsigned noise_bits(std::span<const std::uint64_t> values) {
  const auto rows = static_cast<double>(values.size());
  const double tolerance = 0.05 + 1 / std::sqrt(rows);
  unsigned bits = 0;
  for (; bits < kMaxLowBits; ++bits) {
    std::uint64_t ones = 0;
    for (const std::uint64_t value : values) {
      ones += value >> bits & 1U;
    }
    if (std::abs(static_cast<double>(ones) / rows - 0.5) > tolerance) {
      break;
    }
  }
  return bits;
}

/// Residuals cut into low bits and, above them, planes, low plane first.
struct Planes {
  unsigned low = 0;
  std::string low_bits;
  std::string bytes;
  unsigned count = 0;  ///< planes that are not all zero
  std::size_t rows = 0;
  [[nodiscard]] std::string_view at(unsigned plane) const { return std::string_view(bytes).substr(plane * rows, rows); }
};

Planes cut(std::span<const std::uint64_t> values, unsigned low) {
  Planes planes;
  planes.low = low;
  planes.rows = values.size();
  std::uint64_t all = 0;
  for (const std::uint64_t value : values) {
    all |= value;
  }
  planes.count = static_cast<unsigned>((std::bit_width(all >> low) + 7) / 8);
  planes.bytes.resize(planes.count * planes.rows);
  for (unsigned p = 0; p < planes.count; ++p) {
    char* const plane = planes.bytes.data() + p * planes.rows;
    for (std::size_t i = 0; i < planes.rows; ++i) {
      plane[i] = static_cast<char>(values[i] >> low >> (8U * p));
    }
  }
  return planes;
}

void pack_low_bits(std::span<const std::uint64_t> values, Planes& planes) {
  planes.low_bits.resize((values.size() * planes.low + 7) / 8);
  const std::uint64_t mask = (std::uint64_t{1} << planes.low) - 1;
  std::uint64_t waiting = 0;
  unsigned bits = 0;
  std::size_t at = 0;
  for (const std::uint64_t value : values) {
    waiting |= (value & mask) << bits;
    for (bits += planes.low; bits >= 8; bits -= 8) {
      planes.low_bits[at++] = static_cast<char>(waiting);
      waiting >>= 8U;
    }
  }
  if (bits > 0) {
    planes.low_bits[at] = static_cast<char>(waiting);
  }
}

/// The cut that promises to be smallest: near where the noise ends. Some bits below, the statistics of a plane may
/// still help; some above, a plane of fewer symbols needs a smaller table.
Planes best_cut(std::span<const std::uint64_t> values) {
  constexpr unsigned kNear = 3;
  const unsigned noise = noise_bits(values);
  Planes best;
  double least = 0;
  const unsigned last = noise == 0 ? 0 : std::min(noise + kNear, kMaxLowBits);
  for (unsigned low = noise > kNear ? noise - kNear : 0; low <= last; ++low) {
    Planes planes = cut(values, low);
    const auto rows = static_cast<double>(planes.rows);
    double bytes = rows * low / 8;
    for (unsigned p = 0; p < planes.count; ++p) {
      bytes += std::min(ideal_bytes(planes.at(p)), rows);
    }
    if (best.rows == 0 || bytes < least) {
      least = bytes;
      best = std::move(planes);
    }
  }
  pack_low_bits(values, best);
  return best;
}

/// Keeps the smallest of several encodings. A later one must be smaller by `kBias` bytes, because earlier ones are
/// simpler and faster to read.
class Smallest {
 public:
  void offer(std::string&& candidate) {
    constexpr std::size_t kBias = 4;
    if (best_.empty() || candidate.size() + kBias < best_.size()) {
      best_ = std::move(candidate);
    }
  }
  [[nodiscard]] const std::string& best() const { return best_; }

 private:
  std::string best_;
};

void offer_planes(std::uint8_t header, const Planes& planes, const std::string& prefix, Packer& packer,
                  Smallest& smallest) {
  const auto start = [&](std::uint8_t flags) {
    std::string out(1, static_cast<char>(header | flags | planes.count << 4U));
    out.push_back(static_cast<char>(planes.low));
    out += prefix;
    out += planes.low_bits;
    return out;
  };
  std::string together = start(0);
  if (planes.count > 0) {
    packer.append_numbers(together, planes.bytes);
  }
  smallest.offer(std::move(together));
  if (planes.count > 1) {
    std::string one_by_one = start(kOneByOne);
    for (unsigned p = 0; p < planes.count; ++p) {
      packer.append_numbers(one_by_one, planes.at(p));
    }
    smallest.offer(std::move(one_by_one));
  }
}

void offer_sparse(Prediction prediction, const Residuals& left, Packer& packer, Smallest& smallest) {
  std::string bitmap((left.values.size() + 7) / 8, '\0');
  std::vector<std::uint64_t> others;
  for (std::size_t i = 0; i < left.values.size(); ++i) {
    if (left.values[i] != 0) {
      bitmap[i / 8] = static_cast<char>(bitmap[i / 8] | 1 << (i % 8));
      others.push_back(left.values[i]);
    }
  }
  constexpr std::size_t kWorthIt = 4;  // a bitmap costs an eighth of a plane
  if (others.empty() || others.size() > left.values.size() - left.values.size() / kWorthIt) {
    return;
  }
  std::string prefix = left.seeds;
  packer.append_numbers(prefix, bitmap);
  offer_planes(static_cast<std::uint8_t>(prediction | kSparse), best_cut(others), prefix, packer, smallest);
}

}  // namespace

void encode_ints(std::span<const std::int64_t> values, Packer& packer, std::string& out) {
  if (values.empty()) {
    return;
  }
  std::array<Residuals, kPredictions.size()> residuals;
  std::array<double, kPredictions.size()> bits{};
  for (const Prediction prediction : kPredictions) {
    residuals[prediction] = predict(values, prediction);
    bits[prediction] = likely_bits(residuals[prediction].values);
  }
  const double least = *std::min_element(bits.begin(), bits.end());
  Smallest smallest;
  for (const Prediction prediction : kPredictions) {
    // Compressing is what costs time.
    constexpr double kHopeless = 1.3;
    constexpr double kFewBits = 256;
    if (bits[prediction] > least * kHopeless + kFewBits) {
      continue;
    }
    const Residuals& left = residuals[prediction];
    const Planes whole = cut(left.values, 0);
    offer_planes(prediction, whole, left.seeds, packer, smallest);
    if (whole.count == 0) {
      break;  // nothing is smaller
    }
    const Planes planes = best_cut(left.values);
    if (planes.low > 0) {
      offer_planes(prediction, planes, left.seeds, packer, smallest);
    }
    offer_sparse(prediction, left, packer, smallest);
  }
  out += smallest.best();
}

}  // namespace tacho::store
