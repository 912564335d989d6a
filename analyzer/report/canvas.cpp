#include "analyzer/report/canvas.hpp"

#include <algorithm>
#include <cmath>

#include "analyzer/report/text.hpp"

namespace tacho::report {
namespace {

/// Calls `dot(column, row)` for every ink pixel of the text, as if written from (0, 0).
template <typename Dot>
void ink(std::string_view utf8, const Font& font, Dot dot) {
  int x = 0;
  while (!utf8.empty()) {
    const char32_t c = next_character(utf8);
    for (int y = 0; y < kGlyphHeight; ++y) {
      const std::uint8_t row = glyph_row(font, c, y);
      for (int bit = 0; bit < 8; ++bit) {
        if ((row >> (7 - bit) & 1) != 0) {
          dot(x + bit, y);
        }
      }
    }
    x += font.advance;
  }
}

}  // namespace

Colour mix(Colour a, Colour b, double share) {
  const double s = std::clamp(share, 0.0, 1.0);
  const auto channel = [s](std::uint8_t from, std::uint8_t to) {
    return static_cast<std::uint8_t>(std::lround(from + s * (to - from)));
  };
  return {channel(a.r, b.r), channel(a.g, b.g), channel(a.b, b.b)};
}

Canvas::Canvas(int width, int height, Colour background)
    : width_(width), height_(height), bytes_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height) * 3) {
  fill({0, 0, width, height}, background);
}

Colour Canvas::at(int x, int y) const {
  const std::size_t i =
      (static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x)) * 3;
  return {bytes_[i], bytes_[i + 1], bytes_[i + 2]};
}

void Canvas::set(int x, int y, Colour colour) {
  if (x < 0 || y < 0 || x >= width_ || y >= height_) {
    return;
  }
  const std::size_t i =
      (static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x)) * 3;
  bytes_[i] = colour.r;
  bytes_[i + 1] = colour.g;
  bytes_[i + 2] = colour.b;
}

void Canvas::fill(Rect rect, Colour colour) {
  for (int y = std::max(rect.y, 0); y < std::min(rect.y + rect.height, height_); ++y) {
    for (int x = std::max(rect.x, 0); x < std::min(rect.x + rect.width, width_); ++x) {
      set(x, y, colour);
    }
  }
}

void Canvas::frame(Rect rect, Colour colour) {
  fill({rect.x, rect.y, rect.width, 1}, colour);
  fill({rect.x, rect.y + rect.height - 1, rect.width, 1}, colour);
  fill({rect.x, rect.y, 1, rect.height}, colour);
  fill({rect.x + rect.width - 1, rect.y, 1, rect.height}, colour);
}

void Canvas::text(int x, int y, std::string_view utf8, Colour colour, const Font& font) {
  ink(utf8, font, [&](int dx, int dy) { set(x + dx, y + dy, colour); });
}

void Canvas::text_upwards(int x, int y, std::string_view utf8, Colour colour, const Font& font) {
  ink(utf8, font, [&](int dx, int dy) { set(x + dy, y - dx, colour); });
}

int Canvas::text_width(std::string_view utf8, const Font& font) {
  int width = 0;
  while (!utf8.empty()) {
    next_character(utf8);
    width += font.advance;
  }
  return width;
}

}  // namespace tacho::report
