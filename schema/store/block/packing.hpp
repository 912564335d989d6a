#pragma once
// zstd for the small pieces of a block. A piece is a varint (stored bytes times two, plus one when they are zstd), then
// the bytes; the 4 magic bytes of a zstd frame are not stored, and bytes that would not shrink stay as they are. How
// long a piece is when unpacked is known to who reads it.
//
// Thread rule: one thread per object.

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "schema/store/block/bytes.hpp"
#include "schema/store/hot_codec.hpp"

namespace tacho::store {

/// No piece of a block is longer when unpacked; a longer one is damage.
inline constexpr std::size_t kMaxPieceBytes = std::size_t{128} << 20U;

class Packer {
 public:
  /// `level`: zstd level of texts, 1 to 19.
  explicit Packer(int level);
  /// Appends `bytes` as a piece.
  void append_text(std::string& out, std::string_view bytes) { append(*texts_, out, bytes); }
  void append_numbers(std::string& out, std::string_view bytes) { append(*numbers_, out, bytes); }

 private:
  std::unique_ptr<ZSTD_CCtx_s, FreeEncoder> texts_;
  std::unique_ptr<ZSTD_CCtx_s, FreeEncoder> numbers_;
  std::string frame_;

  void append(ZSTD_CCtx_s& context, std::string& out, std::string_view bytes);
};

class Unpacker {
 public:
  Unpacker();
  /// Takes the next piece. The view points into the block or into `buffer`, which is only used when something has to be
  /// decompressed. Empty: damaged, or not `length` bytes.
  [[nodiscard]] std::optional<std::string_view> take(ByteReader& in, std::size_t length, std::vector<char>& buffer);

 private:
  std::unique_ptr<ZSTD_DCtx_s, FreeDecoder> context_;
  std::string frame_;
};

}  // namespace tacho::store
