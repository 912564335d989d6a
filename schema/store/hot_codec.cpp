#include "schema/store/hot_codec.hpp"

#include <zstd.h>

#include <algorithm>
#include <cassert>
#include <cstring>
#include <new>

#include "schema/store/block/bytes.hpp"

namespace tacho::store {

namespace {

constexpr char kPlain = 0;
constexpr char kZstd = 1;
constexpr char kImages = 2;
// Little-endian ZSTD_MAGICNUMBER; every frame starts with it, so it is not stored.
constexpr std::string_view kMagic("\x28\xB5\x2F\xFD", 4);
/// Longer bodies are no register images.
constexpr std::size_t kMostImageBytes = 1024;
/// Bytes of numbers that an answer has at least, but for the first.
constexpr std::size_t kLeastNumbers = 3;
/// Of a batch, from one filling to the next.
constexpr std::size_t kKeptBytes = std::size_t{256} << 10U;

/// Which numbers of an answer are stored.
enum Flag : unsigned {
  kRepeats = 1,  ///< none: the body is that of the answer before, of the base for the first
  kLength = 2,
  kHeader = 4,
  kPolls = 8,
  kOffBeat = 16,
};

/// Differences wrap: the numbers of a damaged row may be anything.
template <class Number>
std::int64_t difference(Number to, Number from) {
  return static_cast<std::int64_t>(static_cast<std::uint64_t>(to) - static_cast<std::uint64_t>(from));
}
template <class Number>
Number sum(Number from, std::int64_t difference) {
  return static_cast<Number>(static_cast<std::uint64_t>(from) + static_cast<std::uint64_t>(difference));
}

/// What the numbers of an answer are told relative to.
struct Before {
  std::int64_t distance_us = 0;
  Micros round_trip_us = 0;
  std::size_t length = 0;
};

void put_numbers(std::string& out, const HotMark& mark, const HotMark* before, bool repeats, Before& last) {
  const std::int64_t distance_us = before == nullptr ? 0 : difference(mark.t_send_us, before->t_send_us);
  const std::uint64_t polls = before == nullptr ? 0 : mark.seq - before->seq - 1;
  const Micros round_trip_us = difference(mark.t_recv_us, mark.t_send_us);
  const unsigned flags = (repeats ? kRepeats : 0U) | (mark.length != last.length ? kLength : 0U) |
                         (mark.header.empty() ? 0U : kHeader) | (polls > 0 ? kPolls : 0U) |
                         (distance_us != last.distance_us ? kOffBeat : 0U);
  out += static_cast<char>(flags);
  if (before != nullptr) {
    put_varint(out, static_cast<std::uint64_t>(mark.place - before->place - 1));
  }
  if ((flags & kPolls) != 0) {
    put_varint(out, polls);
  }
  if ((flags & kOffBeat) != 0) {
    put_varint(out, zigzag(difference(distance_us, last.distance_us)));
  }
  put_varint(out, zigzag(difference(round_trip_us, last.round_trip_us)));
  if ((flags & kLength) != 0) {
    put_varint(out, zigzag(difference(mark.length, last.length)));
  }
  if ((flags & kHeader) != 0) {
    put_varint(out, mark.header.size());
    out += mark.header;
  }
  last = {distance_us, round_trip_us, mark.length};
}

/// True when the body is that of the answer before.
bool take_numbers(ByteReader& in, HotMark& mark, const HotMark* before, Before& last) {
  const unsigned flags = in.byte();
  if (before != nullptr) {
    mark.place = sum(before->place, static_cast<std::int64_t>(in.varint() + 1));
    mark.seq = before->seq + 1;
  }
  mark.seq += (flags & kPolls) != 0 ? in.varint() : 0;
  last.distance_us = sum(last.distance_us, (flags & kOffBeat) != 0 ? in.signed_varint() : 0);
  if (before != nullptr) {
    mark.t_send_us = sum(before->t_send_us, last.distance_us);
  }
  last.round_trip_us = sum(last.round_trip_us, in.signed_varint());
  mark.t_recv_us = sum(mark.t_send_us, last.round_trip_us);
  last.length = sum(last.length, (flags & kLength) != 0 ? in.signed_varint() : 0);
  mark.length = last.length;
  mark.header = (flags & kHeader) != 0 ? in.take(in.varint()) : std::string_view();
  return (flags & kRepeats) != 0;
}

/// Bodies of `length` bytes each -> the first byte of all, the second of all, ..., as differences from the body before;
/// from nothing for the first when there is no base.
void turn(std::string_view bodies, std::size_t length, const std::string* base, std::string& out) {
  const std::size_t rows = bodies.size() / length;
  out.resize(bodies.size());
  for (std::size_t at = 0; at < length; ++at) {
    auto before = static_cast<unsigned char>(base == nullptr ? 0 : (*base)[at]);
    for (std::size_t row = 0; row < rows; ++row) {
      const auto byte = static_cast<unsigned char>(bodies[row * length + at]);
      out[at * rows + row] = static_cast<char>(byte - before);
      before = byte;
    }
  }
}

void turn_back(std::string_view turned, std::size_t length, const std::string* base, char* bodies) {
  const std::size_t rows = turned.size() / length;
  for (std::size_t at = 0; at < length; ++at) {
    auto byte = static_cast<unsigned char>(base == nullptr ? 0 : (*base)[at]);
    for (std::size_t row = 0; row < rows; ++row) {
      byte = static_cast<unsigned char>(byte + static_cast<unsigned char>(turned[at * rows + row]));
      bodies[row * length + at] = static_cast<char>(byte);
    }
  }
}

/// Of all answers; 0 where they differ.
std::size_t common_length(const std::vector<HotMark>& marks) {
  const std::size_t length = marks.front().length;
  const bool all = std::all_of(marks.begin(), marks.end(), [&](const HotMark& mark) { return mark.length == length; });
  return all ? length : 0;
}

}  // namespace

void FreeEncoder::operator()(ZSTD_CCtx_s* context) const noexcept { ZSTD_freeCCtx(context); }
void FreeDecoder::operator()(ZSTD_DCtx_s* context) const noexcept { ZSTD_freeDCtx(context); }

void HotBatch::add(std::int64_t place, const Answer& answer) {
  const bool repeats = !marks.empty() && answer.body == last_body();
  const std::size_t at = repeats ? marks.back().at : bodies.size();
  const AnswerMeta& meta = answer.meta;
  marks.push_back({place, meta.seq, meta.t_send_us, meta.t_recv_us, at, answer.body.size(), answer.header});
  if (!repeats) {
    bodies += answer.body;
  }
}

void HotBatch::clear() {
  marks.clear();
  bodies.clear();
  if (bodies.capacity() > kKeptBytes) {
    bodies.shrink_to_fit();
  }
}

void HotBatch::fill(const HotMark& mark, Answer& out) const {
  out.meta.seq = mark.seq;
  out.meta.t_send_us = mark.t_send_us;
  out.meta.t_recv_us = mark.t_recv_us;
  out.body = body(mark);
  out.header = mark.header;
}

HotEncoder::HotEncoder() : context_(ZSTD_createCCtx()) {
  if (!context_) {
    throw std::bad_alloc();
  }
  // Found by measurement: matches with the body before are long, so short ones are not worth looking for. Against level
  // 3, a status answer is 391 B and not 438, in the same time.
  const auto set = [this](ZSTD_cParameter parameter, int value) {
    ZSTD_CCtx_setParameter(context_.get(), parameter, value);
  };
  set(ZSTD_c_strategy, ZSTD_fast);
  set(ZSTD_c_minMatch, 7);
  set(ZSTD_c_hashLog, 14);
  set(ZSTD_c_contentSizeFlag, 0);
  set(ZSTD_c_checksumFlag, 0);
  set(ZSTD_c_dictIDFlag, 0);
}

HotEncoder::Stored HotEncoder::encode(const HotBatch& batch, const std::string* base) {
  assert(!batch.empty());
  out_.clear();
  const bool repeats_base = base != nullptr && batch.body(batch.marks.front()) == *base;
  Before last;
  const HotMark* before = nullptr;
  for (const HotMark& mark : batch.marks) {
    const bool repeats = before == nullptr ? repeats_base : mark.at == before->at && mark.length == before->length;
    put_numbers(out_, mark, before, repeats, last);
    before = &mark;
  }
  const std::string_view bodies = std::string_view(batch.bodies).substr(repeats_base ? batch.marks.front().length : 0);
  const bool based = !(repeats_base && bodies.empty()) && append_bodies(bodies, common_length(batch.marks), base);
  return {out_, based || repeats_base};
}

/// `length`: of each body, 0 where they differ. True when they cannot be read without the base.
bool HotEncoder::append_bodies(std::string_view bodies, std::size_t length, const std::string* base) {
  const bool images = length > 0 && length <= kMostImageBytes && (base == nullptr || base->size() == length);
  const bool based = base != nullptr && !base->empty();
  std::string_view content = bodies;
  if (images) {
    turn(bodies, length, base, turned_);
    content = turned_;
  } else if (based) {
    // Valid for the next frame only, as documented; the prefix is not copied.
    ZSTD_CCtx_refPrefix(context_.get(), base->data(), base->size());
  }
  frame_.resize(ZSTD_compressBound(content.size()));
  const std::size_t size = ZSTD_compress2(context_.get(), frame_.data(), frame_.size(), content.data(), content.size());
  if (ZSTD_isError(size) != 0 || size - kMagic.size() >= bodies.size()) {
    out_ += kPlain;
    out_ += bodies;
    return false;
  }
  assert(std::memcmp(frame_.data(), kMagic.data(), kMagic.size()) == 0);
  out_ += images ? kImages : kZstd;
  out_.append(frame_, kMagic.size(), size - kMagic.size());
  return based;
}

std::optional<PackedBodies> read_marks(const HotRow& row, std::vector<HotMark>& marks) {
  marks.clear();
  if (row.rows == 0 || row.rows - 1 > row.data.size() / kLeastNumbers) {
    return std::nullopt;
  }
  ByteReader in(row.data);
  PackedBodies packed;
  Before last;
  marks.resize(static_cast<std::size_t>(row.rows));
  HotMark* before = nullptr;
  for (HotMark& mark : marks) {
    if (before == nullptr) {
      mark.place = row.id;
      mark.seq = row.seq;
      mark.t_send_us = row.t_send_us;
    }
    const bool repeats = take_numbers(in, mark, before, last);
    const bool grows = before == nullptr || (mark.place > before->place && mark.seq > before->seq);
    const bool fits = !repeats || before == nullptr || mark.length == before->length;
    if (!in.good() || !grows || !fits || mark.length > kMaxBodyBytes - packed.total) {
      marks.clear();
      return std::nullopt;
    }
    mark.at = repeats && before != nullptr ? before->at : packed.total;
    packed.total += repeats && before != nullptr ? 0 : mark.length;
    if (repeats && before == nullptr) {
      packed.repeats_base = true;
      packed.from_base = mark.length;
    }
    before = &mark;
  }
  packed.length = common_length(marks);
  packed.bytes = in.take(in.left());
  return packed;
}

HotDecoder::HotDecoder() : context_(ZSTD_createDCtx()) {
  if (!context_) {
    throw std::bad_alloc();
  }
}

bool HotDecoder::unpack(const PackedBodies& packed, const std::string* base, std::string& bodies) {
  bodies.clear();
  if (packed.repeats_base) {
    if (base == nullptr || base->size() != packed.from_base) {
      return false;
    }
    bodies = *base;
  }
  const std::size_t rest = packed.total - packed.from_base;
  if (packed.bytes.empty()) {
    return rest == 0 && packed.repeats_base;
  }
  const char method = packed.bytes.front();
  const std::string_view bytes = packed.bytes.substr(1);
  if (method == kPlain) {
    bodies += bytes;
    return bytes.size() == rest;
  }
  bodies.resize(packed.total);
  char* to = bodies.data() + packed.from_base;
  if (method == kZstd) {
    return decompress(bytes, base, to, rest);
  }
  const bool images = method == kImages && packed.length > 0 && (base == nullptr || base->size() == packed.length);
  turned_.resize(rest);
  if (!images || !decompress(bytes, nullptr, turned_.data(), rest)) {
    return false;
  }
  turn_back(turned_, packed.length, base, to);
  return true;
}

bool HotDecoder::decompress(std::string_view bytes, const std::string* prefix, char* to, std::size_t size) {
  frame_.assign(kMagic);
  frame_ += bytes;
  if (prefix != nullptr && !prefix->empty()) {
    ZSTD_DCtx_refPrefix(context_.get(), prefix->data(), prefix->size());
  }
  const std::size_t got = ZSTD_decompressDCtx(context_.get(), to, size, frame_.data(), frame_.size());
  return ZSTD_isError(got) == 0 && got == size;
}

}  // namespace tacho::store
