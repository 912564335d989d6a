#include "schema/store/hot_codec.hpp"

#include <zstd.h>

#include <cassert>
#include <cstring>
#include <new>

#include "schema/store/block/bytes.hpp"

namespace tacho::store {

namespace {

constexpr char kPlain = 0;
constexpr char kZstd = 1;
// Little-endian ZSTD_MAGICNUMBER; every frame starts with it, so it is not stored.
constexpr std::string_view kMagic("\x28\xB5\x2F\xFD", 4);
constexpr std::uint64_t kHasHeader = 1;
constexpr std::uint64_t kRepeats = 2;
constexpr unsigned kLengthShift = 2;
/// Bytes of numbers that an answer has at least, but for the first.
constexpr std::size_t kLeastNumbers = 5;
/// Of a batch, from one filling to the next.
constexpr std::size_t kKeptBytes = std::size_t{256} << 10U;

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
  if (before != nullptr) {
    put_varint(out, static_cast<std::uint64_t>(mark.place - before->place - 1));
    put_varint(out, mark.seq - before->seq - 1);
    const std::int64_t distance_us = difference(mark.t_send_us, before->t_send_us);
    put_varint(out, zigzag(difference(distance_us, last.distance_us)));
    last.distance_us = distance_us;
  }
  const Micros round_trip_us = difference(mark.t_recv_us, mark.t_send_us);
  put_varint(out, zigzag(difference(round_trip_us, last.round_trip_us)));
  last.round_trip_us = round_trip_us;
  const std::uint64_t flags = (repeats ? kRepeats : 0) | (mark.header.empty() ? 0 : kHasHeader);
  put_varint(out, zigzag(difference(mark.length, last.length)) << kLengthShift | flags);
  last.length = mark.length;
  if (!mark.header.empty()) {
    put_varint(out, mark.header.size());
    out += mark.header;
  }
}

/// True when the body is that of the answer before.
bool take_numbers(ByteReader& in, HotMark& mark, const HotMark* before, Before& last) {
  if (before != nullptr) {
    mark.place = sum(before->place, static_cast<std::int64_t>(in.varint() + 1));
    mark.seq = before->seq + in.varint() + 1;
    last.distance_us = sum(last.distance_us, in.signed_varint());
    mark.t_send_us = sum(before->t_send_us, last.distance_us);
  }
  last.round_trip_us = sum(last.round_trip_us, in.signed_varint());
  mark.t_recv_us = sum(mark.t_send_us, last.round_trip_us);
  const std::uint64_t length = in.varint();
  last.length = sum(last.length, unzigzag(length >> kLengthShift));
  mark.length = last.length;
  mark.header = (length & kHasHeader) != 0 ? in.take(in.varint()) : std::string_view();
  return (length & kRepeats) != 0;
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

HotEncoder::HotEncoder(int level) : context_(ZSTD_createCCtx()) {
  if (!context_) {
    throw std::bad_alloc();
  }
  ZSTD_CCtx_setParameter(context_.get(), ZSTD_c_compressionLevel, level);
  ZSTD_CCtx_setParameter(context_.get(), ZSTD_c_contentSizeFlag, 0);
  ZSTD_CCtx_setParameter(context_.get(), ZSTD_c_checksumFlag, 0);
  ZSTD_CCtx_setParameter(context_.get(), ZSTD_c_dictIDFlag, 0);
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
  const bool based = !(repeats_base && bodies.empty()) && append_bodies(bodies, base);
  return {out_, based || repeats_base};
}

/// True when they cannot be read without the prefix.
bool HotEncoder::append_bodies(std::string_view bodies, const std::string* prefix) {
  const bool based = prefix != nullptr && !prefix->empty();
  frame_.resize(ZSTD_compressBound(bodies.size()));
  if (based) {
    // Valid for the next frame only, as documented; the prefix is not copied.
    ZSTD_CCtx_refPrefix(context_.get(), prefix->data(), prefix->size());
  }
  const std::size_t size = ZSTD_compress2(context_.get(), frame_.data(), frame_.size(), bodies.data(), bodies.size());
  if (ZSTD_isError(size) != 0 || size - kMagic.size() >= bodies.size()) {
    out_ += kPlain;
    out_ += bodies;
    return false;
  }
  assert(std::memcmp(frame_.data(), kMagic.data(), kMagic.size()) == 0);
  out_ += kZstd;
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
  if (method != kZstd) {
    return false;
  }
  frame_.assign(kMagic);
  frame_ += bytes;
  bodies.resize(packed.total);
  if (base != nullptr && !base->empty()) {
    ZSTD_DCtx_refPrefix(context_.get(), base->data(), base->size());
  }
  const std::size_t size =
      ZSTD_decompressDCtx(context_.get(), bodies.data() + packed.from_base, rest, frame_.data(), frame_.size());
  return ZSTD_isError(size) == 0 && size == rest;
}

}  // namespace tacho::store
