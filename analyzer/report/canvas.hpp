#pragma once
// An RGB picture to draw on: rectangles, lines, text. Everything outside is clipped.

#include <cstdint>
#include <string_view>
#include <vector>

#include "analyzer/report/font.hpp"

namespace tacho::report {

struct Colour {
  std::uint8_t r = 0;
  std::uint8_t g = 0;
  std::uint8_t b = 0;
  friend bool operator==(const Colour&, const Colour&) = default;
};
/// `a` at share 0, `b` at share 1, in between a straight line in sRGB.
Colour mix(Colour a, Colour b, double share);

struct Rect {
  int x = 0;
  int y = 0;
  int width = 0;
  int height = 0;
};

class Canvas {
 public:
  Canvas(int width, int height, Colour background);
  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  [[nodiscard]] Colour at(int x, int y) const;
  void set(int x, int y, Colour colour);
  void fill(Rect rect, Colour colour);
  /// One pixel wide, drawn inside the rectangle.
  void frame(Rect rect, Colour colour);
  /// `x`, `y`: upper left corner.
  void text(int x, int y, std::string_view utf8, Colour colour, const Font& font = kRegular);
  /// Read from bottom to top; `x`, `y`: lower left corner of the box.
  void text_upwards(int x, int y, std::string_view utf8, Colour colour, const Font& font = kRegular);
  static int text_width(std::string_view utf8, const Font& font = kRegular);

  /// Rows from the top, 3 bytes per pixel.
  [[nodiscard]] const std::vector<std::uint8_t>& bytes() const { return bytes_; }

 private:
  int width_;
  int height_;
  std::vector<std::uint8_t> bytes_;
};

}  // namespace tacho::report
