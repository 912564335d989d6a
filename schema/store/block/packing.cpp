#include "schema/store/block/packing.hpp"

#include <zstd.h>

#include <new>

namespace tacho::store {

namespace {

// Little-endian ZSTD_MAGICNUMBER.
constexpr std::string_view kMagic("\x28\xB5\x2F\xFD", 4);

}  // namespace

Packer::Packer(int level) : texts_(ZSTD_createCCtx()), numbers_(ZSTD_createCCtx()) {
  for (ZSTD_CCtx* const context : {texts_.get(), numbers_.get()}) {
    if (context == nullptr) {
      throw std::bad_alloc();
    }
    ZSTD_CCtx_setParameter(context, ZSTD_c_contentSizeFlag, 0);
    ZSTD_CCtx_setParameter(context, ZSTD_c_checksumFlag, 0);
  }
  ZSTD_CCtx_setParameter(texts_.get(), ZSTD_c_compressionLevel, level);
  // Bytes of numbers that come back in threes and fours do so by chance: to say where costs more than it saves, and
  // more to read. Searching longer finds nothing else.
  ZSTD_CCtx_setParameter(numbers_.get(), ZSTD_c_compressionLevel, 1);
  ZSTD_CCtx_setParameter(numbers_.get(), ZSTD_c_minMatch, 7);
}

void Packer::append(ZSTD_CCtx_s& context, std::string& out, std::string_view bytes) {
  frame_.resize(ZSTD_compressBound(bytes.size()));
  const std::size_t size = ZSTD_compress2(&context, frame_.data(), frame_.size(), bytes.data(), bytes.size());
  if (ZSTD_isError(size) != 0 || size - kMagic.size() >= bytes.size()) {
    put_varint(out, bytes.size() * 2);
    out.append(bytes);
    return;
  }
  put_varint(out, (size - kMagic.size()) * 2 + 1);
  out.append(frame_, kMagic.size(), size - kMagic.size());
}

Unpacker::Unpacker() : context_(ZSTD_createDCtx()) {
  if (!context_) {
    throw std::bad_alloc();
  }
}

std::optional<std::string_view> Unpacker::take(ByteReader& in, std::size_t length, std::vector<char>& buffer) {
  const std::uint64_t header = in.varint();
  const std::string_view stored = in.take(header / 2);
  if (!in.good() || length > kMaxPieceBytes) {
    return std::nullopt;
  }
  if (header % 2 == 0) {
    return stored.size() == length ? std::optional(stored) : std::nullopt;
  }
  frame_.assign(kMagic);
  frame_.append(stored);
  if (buffer.size() < length) {
    buffer.resize(length);  // never shorter, or what is added again would be filled with zeros each time
  }
  const std::size_t size = ZSTD_decompressDCtx(context_.get(), buffer.data(), length, frame_.data(), frame_.size());
  if (ZSTD_isError(size) != 0 || size != length) {
    return std::nullopt;
  }
  return std::string_view(buffer.data(), length);
}

}  // namespace tacho::store
