#include "analyzer/report/font.hpp"

namespace tacho::report {

std::uint8_t glyph_row(const Font& font, char32_t character, int y) {
  constexpr std::size_t ascii = 0x7F - 0x20;
  std::size_t index = U'?' - 0x20;
  if (character >= 0x20 && character < 0x7F) {
    index = character - 0x20;
  } else if (character >= 0xA0 && character <= 0xFF) {
    index = character - 0xA0 + ascii;
  }
  return (*font.rows)[index * kGlyphHeight + static_cast<std::size_t>(y)];
}

}  // namespace tacho::report
