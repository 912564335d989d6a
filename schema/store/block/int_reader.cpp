// Reading integer columns: run by run, so that what a run goes through stays in the nearest cache.

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "schema/store/block/int_layout.hpp"
#include "schema/store/block/int_stream.hpp"
#include "schema/store/block/wide_loops.hpp"

namespace tacho::store {

namespace {

/// A run of values; where there are fewer, the rest is anything.
using Run = std::array<std::uint64_t, IntReader::kRun>;

template <unsigned Count>
void merge(const std::array<const char*, kPlanes>& planes, std::size_t begin, std::span<std::uint64_t> out) {
  run_loop([&]() __attribute__((always_inline)) {
    std::array<const char*, Count> from{};
    std::copy_n(planes.begin(), Count, from.begin());
    const std::span to = out;
    const std::size_t first = begin;
    for (std::size_t i = 0; i < to.size(); ++i) {
      std::uint64_t value = 0;
      for (unsigned p = 0; p < Count; ++p) {
        value |= std::uint64_t{static_cast<unsigned char>(from[p][first + i])} << (8U * p);
      }
      to[i] = value;
    }
  });
}

using Merge = void (*)(const std::array<const char*, kPlanes>&, std::size_t, std::span<std::uint64_t>);
constexpr std::array<Merge, kPlanes + 1> kMerge{merge<0>, merge<1>, merge<2>, merge<3>, merge<4>,
                                                merge<5>, merge<6>, merge<7>, merge<8>};

/// The eight bytes from `at` on; zeros behind the end.
std::uint64_t word_at(std::string_view bytes, std::size_t at) {
  std::uint64_t word = 0;
  if (std::endian::native == std::endian::little && at + sizeof word <= bytes.size()) {
    std::memcpy(&word, bytes.data() + at, sizeof word);
    return word;
  }
  for (std::size_t k = 0; k < sizeof word && at + k < bytes.size(); ++k) {
    word |= std::uint64_t{static_cast<unsigned char>(bytes[at + k])} << (8 * k);
  }
  return word;
}

/// Four numbers, added and shifted together.
using Four [[gnu::vector_size(32)]] = std::uint64_t;

/// Adds low bits below what the planes gave. `begin`: of the values, a multiple of 8.
void add_low_bits(std::string_view bits, unsigned low, std::size_t begin, std::span<std::uint64_t> out) {
  run_loop([&]() __attribute__((always_inline)) {
    const std::span to = out;
    const std::string_view from = bits;
    const std::uint64_t each = low;
    const std::uint64_t mask = (std::uint64_t{1} << each) - 1;
    std::size_t i = 0;
    // Eight values take whole bytes, so the next eight lie in theirs alike.
    std::array<std::size_t, 8> bytes{};
    std::array<Four, 2> shifts{};
    for (std::size_t k = 0; k < bytes.size(); ++k) {
      bytes[k] = k * each / 8;
      shifts[k / 4][k % 4] = k * each % 8;
    }
    std::size_t at = begin * each / 8;
    for (; i + 8 <= to.size() && at + bytes[7] + sizeof mask <= from.size(); i += 8, at += each) {
      for (std::size_t half = 0; half < 2; ++half) {
        Four words{};
        for (std::size_t k = 0; k < 4; ++k) {
          std::uint64_t word = 0;
          std::memcpy(&word, from.data() + at + bytes[4 * half + k], sizeof word);
          words[k] = word;
        }
        Four x;
        std::memcpy(&x, &to[i + 4 * half], sizeof x);
        x = x << each | (words >> shifts[half] & mask);
        std::memcpy(&to[i + 4 * half], &x, sizeof x);
      }
    }
    for (; i < to.size(); ++i) {
      const std::uint64_t bit = (begin + i) * each;
      to[i] = to[i] << each | (word_at(from, bit / 8) >> bit % 8 & mask);
    }
  });
}

/// Spreads `others`, from number `next` on, over the set bits. `begin`: of the values, a multiple of 8.
void spread(std::string_view bitmap, const std::vector<std::uint64_t>& others, std::size_t& next, std::size_t begin,
            std::span<std::uint64_t> out) {
  constexpr std::size_t kWord = 64;
  std::fill(out.begin(), out.end(), 0);
  for (std::size_t from = 0; from < out.size(); from += kWord) {
    const std::size_t count = std::min(kWord, out.size() - from);
    std::uint64_t bits = word_at(bitmap, (begin + from) / 8);
    for (; bits != 0; bits &= bits - 1) {
      const auto i = static_cast<std::size_t>(std::countr_zero(bits));
      if (i < count) {  // else damage: the bitmap has bits behind the last value
        out[from + i] = others[next++];
      }
    }
  }
}

/// Each becomes the sum of itself and those before it.
[[gnu::always_inline]] inline void sum_up(Four& x) {
  const Four none{};
  x += __builtin_shufflevector(none, x, 0, 4, 2, 6);
  const Four pairs =
      __builtin_shufflevector(x, x, 1, 1, 3, 3);  // moving inside a half first is faster than both at once
  x += __builtin_shufflevector(none, pairs, 0, 1, 4, 5);
}

[[gnu::always_inline]] inline void undo_zigzag(Four& x) { x = (x >> 1U) ^ (Four{} - (x & 1U)); }

/// Residuals of a column, in order, back to values.
class Undo {
 public:
  Undo(Prediction prediction, std::uint64_t seed, std::uint64_t slope)
      : prediction_(prediction), seed_(seed), slope_(slope) {}

  /// The first `count` values of a run that begins with number `begin`.
  void run(std::size_t begin, std::size_t count, Run& values) {
    run_loop([&]() __attribute__((always_inline)) {
      switch (prediction_) {
        case kNone:
          add_base(count, values);
          return;
        case kPrevious:
          add_previous(count, values);
          return;
        case kLine:
          add_line(count, values);
          return;
        case kTrend:
          add_trend(begin, count, values);
          return;
      }
    });
  }

  /// The first `count` values of a run of a line without residuals, which is how the numbers of answers go.
  void straight(std::size_t count, Run& values) {
    run_loop([&]() __attribute__((always_inline)) { add_slope(count, values); });
  }

 private:
  Prediction prediction_;
  std::uint64_t seed_;
  std::uint64_t slope_;

  [[gnu::always_inline]] void add_base(std::size_t count, Run& values) const {
    for (std::size_t i = 0; i < count; ++i) {
      values[i] += seed_;
    }
  }
  [[gnu::always_inline]] void add_trend(std::size_t begin, std::size_t count, Run& values) const {
    const std::uint64_t seed = seed_;
    const std::uint64_t slope = slope_;
    std::uint64_t above = begin * slope;  // adding is faster than multiplying
    for (std::size_t i = 0; i < count; ++i, above += slope) {
      values[i] += seed + static_cast<std::uint64_t>(trend_at(above));
    }
  }
  [[gnu::always_inline]] void add_slope(std::size_t count, Run& values) {
    std::uint64_t value = seed_;
    const std::uint64_t slope = slope_;
    for (std::size_t i = 0; i < count; ++i) {
      value += slope;
      values[i] = value;
    }
    seed_ = value;
  }
  [[gnu::always_inline]] void add_previous(std::size_t count, Run& values) {
    Four last = Four{} + seed_;
    for (std::size_t i = 0; i < count; i += 4) {
      Four x;
      std::memcpy(&x, &values[i], sizeof x);
      undo_zigzag(x);
      sum_up(x);
      const Four out = x + last;
      std::memcpy(&values[i], &out, sizeof out);
      last += __builtin_shufflevector(x, x, 3, 3, 3, 3);
    }
    seed_ = last[3];
  }
  [[gnu::always_inline]] void add_line(std::size_t count, Run& values) {
    Four slope = Four{} + slope_;
    Four last = Four{} + seed_;
    for (std::size_t i = 0; i < count; i += 4) {
      Four x;
      std::memcpy(&x, &values[i], sizeof x);
      undo_zigzag(x);
      sum_up(x);
      x += slope;
      slope = __builtin_shufflevector(x, x, 3, 3, 3, 3);
      sum_up(x);
      const Four out = x + last;
      std::memcpy(&values[i], &out, sizeof out);
      last += __builtin_shufflevector(x, x, 3, 3, 3, 3);
    }
    slope_ = slope[3];
    seed_ = last[3];
  }
};

}  // namespace

bool IntReader::take_planes(ByteReader& in, unsigned planes, bool one_by_one, std::size_t count) {
  low_bits_ = in.take((count * low_ + 7) / 8);
  plane_count_ = planes;
  const unsigned step = one_by_one ? 1 : planes;
  for (unsigned p = 0; p < planes; p += step) {
    const std::optional<std::string_view> piece = unpacker_.take(in, step * count, buffers_[p]);
    if (!piece) {
      return false;
    }
    for (unsigned k = 0; k < step; ++k) {
      planes_[p + k] = piece->data() + k * count;
    }
  }
  return in.good();
}

void IntReader::residuals(std::size_t begin, std::span<std::uint64_t> out) const {
  kMerge[plane_count_](planes_, begin, out);
  if (low_ > 0) {
    add_low_bits(low_bits_, low_, begin, out);
  }
}

/// The residuals that are not zero, all at once: they are few.
bool IntReader::take_sparse(ByteReader& in, unsigned planes, bool one_by_one, std::size_t count) {
  const std::optional<std::string_view> bitmap = unpacker_.take(in, (count + 7) / 8, bitmap_);
  if (!bitmap) {
    return false;
  }
  std::size_t others = 0;
  for (std::size_t at = 0; at < bitmap->size(); at += sizeof(std::uint64_t)) {
    others += static_cast<std::size_t>(std::popcount(word_at(*bitmap, at)));
  }
  if (others > count || !take_planes(in, planes, one_by_one, others)) {
    return false;
  }
  others_.resize(others);
  for (std::size_t begin = 0; begin < others; begin += kRun) {
    residuals(begin, {others_.data() + begin, std::min(kRun, others - begin)});
  }
  bits_ = *bitmap;
  return true;
}

bool IntReader::take(ByteReader& in, std::size_t count, const UseRun& use) {
  if (count == 0) {
    return true;
  }
  const std::uint8_t flags = in.byte();
  const unsigned planes = flags >> 4U;
  low_ = in.byte();
  const auto prediction = static_cast<Prediction>(flags & kPredictionMask);
  const auto seed = static_cast<std::uint64_t>(in.signed_varint());
  const auto slope = static_cast<std::uint64_t>(prediction >= kLine ? in.signed_varint() : 0);
  const bool sparse = (flags & kSparse) != 0;
  const bool one_by_one = (flags & kOneByOne) != 0;
  if (!in.good() || planes > kPlanes || low_ > kMaxLowBits ||
      !(sparse ? take_sparse(in, planes, one_by_one, count) : take_planes(in, planes, one_by_one, count))) {
    return false;
  }
  // On a line the first step leads to the first value.
  Undo undo(prediction, prediction == kLine ? seed - slope : seed, slope);
  const bool straight = prediction == kLine && planes == 0 && low_ == 0 && !sparse;
  Run run{};  // what lies behind the last value is added up with it
  std::size_t next = 0;
  for (std::size_t begin = 0; begin < count; begin += kRun) {
    const std::span<std::uint64_t> values(run.data(), std::min(kRun, count - begin));
    if (straight) {
      undo.straight(values.size(), run);
    } else {
      if (sparse) {
        spread(bits_, others_, next, begin, values);
      } else {
        residuals(begin, values);
      }
      undo.run(begin, values.size(), run);
    }
    // A number with and without sign may be looked at as each other.
    use(begin, {reinterpret_cast<const std::int64_t*>(run.data()), values.size()});
  }
  return true;
}

bool IntReader::take(ByteReader& in, std::size_t count, std::vector<std::int64_t>& values) {
  values.resize(count);
  return take(in, count, [&](std::size_t begin, std::span<const std::int64_t> run) {
    std::memcpy(values.data() + begin, run.data(), run.size_bytes());
  });
}

}  // namespace tacho::store
