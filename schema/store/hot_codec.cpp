#include "schema/store/hot_codec.hpp"

#include <zstd.h>

#include <cassert>
#include <cstring>
#include <new>

namespace tacho::store {

namespace {

constexpr char kPlain = 0;
constexpr char kZstd = 1;
constexpr char kSame = 2;
// Little-endian ZSTD_MAGICNUMBER; every frame starts with it, so it is not stored.
constexpr std::string_view kMagic("\x28\xB5\x2F\xFD", 4);

}  // namespace

void FreeEncoder::operator()(ZSTD_CCtx_s* context) const noexcept { ZSTD_freeCCtx(context); }
void FreeDecoder::operator()(ZSTD_DCtx_s* context) const noexcept { ZSTD_freeDCtx(context); }

HotEncoder::HotEncoder(int level) : context_(ZSTD_createCCtx()) {
  if (!context_) {
    throw std::bad_alloc();
  }
  ZSTD_CCtx_setParameter(context_.get(), ZSTD_c_compressionLevel, level);
  ZSTD_CCtx_setParameter(context_.get(), ZSTD_c_contentSizeFlag, 0);
  ZSTD_CCtx_setParameter(context_.get(), ZSTD_c_checksumFlag, 0);
  ZSTD_CCtx_setParameter(context_.get(), ZSTD_c_dictIDFlag, 0);
}

HotEncoder::Stored HotEncoder::plain(std::string_view body) {
  out_.assign(1, kPlain);
  out_.append(body);
  return {out_, false};
}

HotEncoder::Stored HotEncoder::encode(std::string_view body, const std::string* prefix) {
  if (prefix != nullptr && body == *prefix) {
    out_.assign(1, kSame);
    return {out_, true};
  }
  const bool base = prefix != nullptr && !prefix->empty();
  out_.resize(ZSTD_compressBound(body.size()));
  if (base) {
    // Valid for the next frame only, as documented; the prefix is not copied.
    ZSTD_CCtx_refPrefix(context_.get(), prefix->data(), prefix->size());
  }
  const std::size_t size = ZSTD_compress2(context_.get(), out_.data(), out_.size(), body.data(), body.size());
  if (ZSTD_isError(size) != 0 || size - kMagic.size() >= body.size()) {
    return plain(body);
  }
  assert(std::memcmp(out_.data(), kMagic.data(), kMagic.size()) == 0);
  const std::size_t skip = kMagic.size() - 1;  // the method byte takes the place of the last magic byte
  out_[skip] = kZstd;
  return {std::string_view(out_).substr(skip, size - skip), base};
}

HotDecoder::HotDecoder() : context_(ZSTD_createDCtx()) {
  if (!context_) {
    throw std::bad_alloc();
  }
}

bool HotDecoder::decode(std::string_view stored, std::size_t length, const std::string* prefix, std::string& body) {
  if (stored.empty() || length > kMaxBodyBytes) {
    return false;
  }
  const char method = stored.front();
  stored.remove_prefix(1);
  if (method == kPlain) {
    body.assign(stored);
    return body.size() == length;
  }
  if (method == kSame) {
    if (prefix == nullptr || prefix->size() != length || !stored.empty()) {
      return false;
    }
    body.assign(*prefix);
    return true;
  }
  if (method != kZstd) {
    return false;
  }
  frame_.assign(kMagic);
  frame_.append(stored);
  body.resize(length);
  if (prefix != nullptr) {
    ZSTD_DCtx_refPrefix(context_.get(), prefix->data(), prefix->size());
  }
  const std::size_t size = ZSTD_decompressDCtx(context_.get(), body.data(), body.size(), frame_.data(), frame_.size());
  return ZSTD_isError(size) == 0 && size == length;
}

}  // namespace tacho::store
