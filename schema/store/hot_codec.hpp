#pragma once
// Answers of one stream <-> the `data` column of one hot row.
//
// First the numbers of each answer: a byte of flags (Flag in hot_codec.cpp), then as varints (seven bits a byte, low
// group first; signed ones zigzag)
//   place among all answers of the part: how many there are between it and the one before (not for the first)
//   poll: likewise, where there are any (not for the first)
//   time of sending: how its distance from the one before differs from the distance before that, where it does (not for
//           the first)
//   round trip: less that of the one before; signed
//   length: less that of the one before, where it is not the same; signed
//   header: its length and its bytes, where there is one
// then, unless every body is that of the answer before (for the first: of the base), one method byte and the others:
//   0  as they are
//   1  as one zstd frame without its 4 magic bytes, content size and checksum; when the row has a base, the last body
//      of the base was the prefix (ZSTD_CCtx_refPrefix)
//   2  images: as many bytes each, and the base too. Of each its difference from the one before, byte by byte; then the
//      first byte of all, the second of all, ...; that as one zstd frame without prefix
// The row's own checksum (hot.crc) covers these bytes, so damage is found before anything is decompressed. The numbers
// stand outside the frame, so that answers are counted without opening it.
// Rejected: a trained dictionary (426 B against 250 B for the same answers, and it has to be kept for ever); a row per
// answer (46 B of columns and b-tree each).
//
// Thread rule: one thread per object.

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "schema/sample.hpp"
#include "schema/store/rows.hpp"

struct ZSTD_CCtx_s;
struct ZSTD_DCtx_s;

namespace tacho::store {

/// Longest bodies a row may have, all together; longer ones in a file are damage. Above the 16 MiB that a frame can
/// carry.
inline constexpr std::size_t kMaxBodyBytes = std::size_t{64} << 20U;

/// One answer of a hot row, without its body.
struct HotMark {
  std::int64_t place = 0;  ///< in the order of arrival of all answers of the part
  std::uint64_t seq = 0;
  Micros t_send_us = 0;
  Micros t_recv_us = 0;
  std::size_t at = 0;  ///< where in the bodies its own begins; answers with the same body share it
  std::size_t length = 0;
  std::string header;  ///< where it is unusual
};

/// Consecutive answers of one stream.
struct HotBatch {
  std::vector<HotMark> marks;
  std::string bodies;

  void add(std::int64_t place, const Answer& answer);
  /// Keeps some memory for the next answers.
  void clear();
  [[nodiscard]] bool empty() const { return marks.empty(); }
  [[nodiscard]] std::string_view body(const HotMark& mark) const {
    return std::string_view(bodies).substr(mark.at, mark.length);
  }
  /// Everything of `out` but whose it is.
  void fill(const HotMark& mark, Answer& out) const;
  [[nodiscard]] std::string_view last_body() const { return body(marks.back()); }
};

struct FreeEncoder {
  void operator()(ZSTD_CCtx_s* context) const noexcept;
};
struct FreeDecoder {
  void operator()(ZSTD_DCtx_s* context) const noexcept;
};

class HotEncoder {
 public:
  HotEncoder();

  struct Stored {
    std::string_view data;    ///< valid until the next encode()
    bool needs_base = false;  ///< false: readable without
  };
  /// `batch` has answers. `base` is null for a keyframe.
  Stored encode(const HotBatch& batch, const std::string* base);

 private:
  std::unique_ptr<ZSTD_CCtx_s, FreeEncoder> context_;
  std::string out_;
  std::string turned_;
  std::string frame_;

  bool append_bodies(std::string_view bodies, std::size_t length, const std::string* base);
};

/// The bodies of a row as they are stored.
struct PackedBodies {
  std::string_view bytes;
  bool repeats_base = false;  ///< the first is that of the base
  std::size_t from_base = 0;  ///< bytes of bodies that come from there
  std::size_t total = 0;      ///< bytes of bodies, each once when it repeats
  std::size_t length = 0;     ///< of each; 0: they differ
};
/// The answers of a row without their bodies. Empty when they make no sense: the row is damaged.
std::optional<PackedBodies> read_marks(const HotRow& row, std::vector<HotMark>& marks);

class HotDecoder {
 public:
  HotDecoder();

  /// False when the bytes are damaged. `base` is null when the row has none; it must not be `bodies`.
  [[nodiscard]] bool unpack(const PackedBodies& packed, const std::string* base, std::string& bodies);

 private:
  std::unique_ptr<ZSTD_DCtx_s, FreeDecoder> context_;
  std::string frame_;
  std::string turned_;

  bool decompress(std::string_view bytes, const std::string* prefix, char* to, std::size_t size);
};

}  // namespace tacho::store
