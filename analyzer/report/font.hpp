#pragma once
// Bitmap fonts for the pictures: text of a PNG must look the same on every machine, so no font file is looked for.

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

namespace tacho::report {

inline constexpr std::size_t kGlyphs = 191;
inline constexpr int kGlyphHeight = 13;

extern const std::array<std::uint8_t, kGlyphs * kGlyphHeight> kRegularRows;
extern const std::array<std::uint8_t, kGlyphs * kGlyphHeight> kBoldRows;

struct Font {
  const std::array<std::uint8_t, kGlyphs * kGlyphHeight>* rows;
  int advance;  ///< pixels from one glyph to the next
};
inline const Font kRegular{&kRegularRows, 7};
inline const Font kBold{&kBoldRows, 8};

/// Row `y` (0 at the top) of a character's glyph, highest bit on the left. A character outside Latin-1 shows as "?".
std::uint8_t glyph_row(const Font& font, char32_t character, int y);

}  // namespace tacho::report
