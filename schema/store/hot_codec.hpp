#pragma once
// Bytes of one hot row <-> answer body.
//
// Stored form: one method byte, then
//   0  the body as it is
//   1  a zstd frame without its 4 magic bytes, content size and checksum; when the row has a base, the base's body was
//      the prefix (ZSTD_CCtx_refPrefix)
//   2  nothing: the body equals the base's body
// The row's own checksum (hot.crc) covers these bytes, so damage is found before anything is decompressed.
// Rejected: a trained dictionary (426 B against 250 B for the same answers, and it has to be kept for ever).
//
// Thread rule: one thread per object.

#include <cstddef>
#include <memory>
#include <string>
#include <string_view>

struct ZSTD_CCtx_s;
struct ZSTD_DCtx_s;

namespace tacho::store {

/// Longest body a row may have; longer ones in a file are damage. Above the 16 MiB that a frame can carry.
inline constexpr std::size_t kMaxBodyBytes = std::size_t{64} << 20U;

struct FreeEncoder {
  void operator()(ZSTD_CCtx_s* context) const noexcept;
};
struct FreeDecoder {
  void operator()(ZSTD_DCtx_s* context) const noexcept;
};

class HotEncoder {
 public:
  /// `level`: zstd level, 1 to 19; above 3 costs much time for little.
  explicit HotEncoder(int level);

  struct Stored {
    std::string_view bytes;   ///< valid until the next encode()
    bool needs_base = false;  ///< false: readable without the prefix
  };
  /// `prefix` is null for a keyframe.
  Stored encode(std::string_view body, const std::string* prefix);

 private:
  std::unique_ptr<ZSTD_CCtx_s, FreeEncoder> context_;
  std::string out_;
  Stored plain(std::string_view body);
};

class HotDecoder {
 public:
  HotDecoder();

  /// False when the bytes are damaged. `prefix` is null when the row has no base. `body` must not be `*prefix`.
  [[nodiscard]] bool decode(std::string_view stored, std::size_t length, const std::string* prefix, std::string& body);

 private:
  std::unique_ptr<ZSTD_DCtx_s, FreeDecoder> context_;
  std::string frame_;
};

}  // namespace tacho::store
