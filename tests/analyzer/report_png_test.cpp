#include "analyzer/report/png.hpp"

#include <png.h>

#include "analyzer/report/palette.hpp"
#include "tests/analyzer/example_section.hpp"
#include "tests/support/catch.hpp"

using namespace tacho;
using namespace tacho::test;
using namespace tacho::report;

namespace {

struct Picture {
  int width = 0;
  int height = 0;
  std::vector<std::uint8_t> rgb;
  [[nodiscard]] Colour at(int x, int y) const {
    const auto i = static_cast<std::size_t>((y * width + x) * 3);
    return {rgb[i], rgb[i + 1], rgb[i + 2]};
  }
};

Picture decode(const std::string& bytes) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  REQUIRE(png_image_begin_read_from_memory(&image, bytes.data(), bytes.size()) != 0);
  image.format = PNG_FORMAT_RGB;
  Picture out;
  out.width = static_cast<int>(image.width);
  out.height = static_cast<int>(image.height);
  out.rgb.resize(PNG_IMAGE_SIZE(image));
  REQUIRE(png_image_finish_read(&image, nullptr, out.rgb.data(), 0, nullptr) != 0);
  return out;
}

/// Colour of the middle of cell (i, j), j counted from the bottom.
Colour cell(const Picture& picture, const Grid& grid, int i, int j) {
  const MapGeometry g = map_geometry(grid);
  return picture.at(g.map.x + i * g.pixels_per_cell + g.pixels_per_cell / 2,
                    g.map.y + g.map.height - j * g.pixels_per_cell - g.pixels_per_cell / 2);
}

Grid wide_grid(std::size_t width, std::size_t height) {
  Grid grid;
  grid.name = "wide";
  grid.width = width;
  grid.height = height;
  grid.layers = {{"n", "n", "", std::vector<double>(width * height, 0.0)}};
  grid.pictures = {"n"};
  return grid;
}

}  // namespace

TEST_CASE(
    "cells have the colour of their value, the least dark and the greatest bright, and unvisited cells stand out") {
  const Section section = example_section();
  const Grid& grid = section.grids[0];
  const std::vector<File> files = png_files(section);
  REQUIRE(files.size() == 2);
  CHECK(files[0].name == "blocked_lost_s.png");
  const Picture picture = decode(files[0].bytes);
  CHECK(cell(picture, grid, 0, 0) == viridis(0.0));
  CHECK(cell(picture, grid, 1, 0) == viridis(1.0));
  CHECK(cell(picture, grid, 0, 1) == viridis(0.5));
  CHECK(cell(picture, grid, 2, 0) == kUnvisited);
  CHECK(cell(picture, grid, 1, 1) == kUnvisited);
}

TEST_CASE("rates fade where a cell's own data say little; sums do not") {
  const Section section = example_section();
  const Grid& grid = section.grids[0];
  const Picture rate = decode(png_files(section)[1].bytes);
  CHECK(cell(rate, grid, 1, 0) == viridis(1.0));
  CHECK(cell(rate, grid, 0, 1) == kLittleData);
  CHECK(cell(rate, grid, 2, 1) == mix(kLittleData, viridis(0.0), 0.5));
}

TEST_CASE("a rate of a cell visited too rarely has its own colour, not that of a cell never visited") {
  Grid grid = example_grid();
  grid.layers.push_back({"too_few", "fewer than 5 passes", "1", {kNaN, kNaN, 1.0, kNaN, kNaN, kNaN}});
  const Picture rate = decode(encode_png(draw_heat_map(grid, grid.layers[1])));
  CHECK(cell(rate, grid, 2, 0) == kTooFew);
  CHECK(cell(rate, grid, 1, 1) == kUnvisited);
  CHECK(cell(rate, grid, 1, 0) == viridis(1.0));
  const Picture sum = decode(encode_png(draw_heat_map(grid, grid.layers[0])));
  CHECK(cell(sum, grid, 2, 0) == kUnvisited);
}

TEST_CASE("the picture has the size of the map plus margins and is the same every time") {
  const Grid grid = example_grid();
  const MapGeometry g = map_geometry(grid);
  const Picture picture = decode(encode_png(draw_heat_map(grid, grid.layers[0])));
  CHECK(picture.width > g.frame.x + g.frame.width);
  CHECK(picture.height > g.frame.y + g.frame.height);
  CHECK(g.map.width == 3 * g.pixels_per_cell);
  CHECK(g.map.height == 2 * g.pixels_per_cell);
  CHECK(encode_png(draw_heat_map(grid, grid.layers[0])) == encode_png(draw_heat_map(grid, grid.layers[0])));
}

TEST_CASE("a huge map is drawn with several cells per pixel and loses none of its peaks") {
  Grid grid = wide_grid(5000, 40);
  grid.layers[0].value[20 * 5000 + 3333] = 9.0;
  const MapGeometry g = map_geometry(grid);
  CHECK(g.cells_per_pixel == 5);
  CHECK(g.map.width == 1000);
  const Canvas canvas = draw_heat_map(grid, grid.layers[0]);
  const int x = g.map.x + 3333 / 5;
  const int y = g.map.y + g.map.height - 20 / 5 - 1;
  CHECK_FALSE(canvas.at(x, y) == viridis(0.0));
  CHECK(canvas.at(x + 1, y) == viridis(0.0));
}

TEST_CASE("a map of one cell, of zeros, or without any visited cell is drawn") {
  for (const double value : {0.0, 3.0, -2.0, kNaN}) {
    Grid grid = wide_grid(1, 1);
    grid.layers[0].value[0] = value;
    const Picture picture = decode(encode_png(draw_heat_map(grid, grid.layers[0])));
    CHECK(picture.width > 400);
  }
  const Grid none = wide_grid(0, 0);
  CHECK(draw_heat_map(none, none.layers[0]).width() > 400);
}

TEST_CASE("the scale ends at round numbers, and one extreme cell does not darken the rest") {
  const std::vector<double> plain{0.0, 3.2, 4.7};
  const ColourScale scale = colour_scale(plain);
  CHECK(scale.bottom == 0.0);
  CHECK(scale.top == Approx(5.0));
  CHECK_FALSE(scale.clipped_above);
  std::vector<double> skewed(100, 1.0);
  skewed.push_back(1000.0);
  const ColourScale clipped = colour_scale(skewed);
  CHECK(clipped.top <= 2.0);
  CHECK(clipped.clipped_above);
  const std::vector<double> negative{-1.0, 2.0};
  CHECK(colour_scale(negative).bottom <= -1.0);
}

TEST_CASE("steps of axes are 1, 2 or 5 times a power of ten") {
  CHECK(round_step(10.0, 5) == Approx(2.0));
  CHECK(round_step(11.0, 5) == Approx(5.0));
  CHECK(round_step(0.03, 3) == Approx(0.01));
  CHECK(round_step(0.0, 5) == 1.0);
  CHECK(round_step(kNaN, 5) == 1.0);
}

TEST_CASE("the palette gets lighter from end to end") {
  const auto lightness = [](Colour c) { return 0.2126 * c.r + 0.7152 * c.g + 0.0722 * c.b; };
  double before = -1.0;
  for (int i = 0; i <= 100; ++i) {
    const double now = lightness(viridis(i / 100.0));
    CHECK(now > before);
    before = now;
  }
}

TEST_CASE("text is drawn with ink, clipped at the edge, also letters beyond ASCII") {
  Canvas canvas(40, 20, {255, 255, 255});
  canvas.text(30, 2, "Wü二", {0, 0, 0});
  int ink = 0;
  for (int y = 0; y < 20; ++y) {
    for (int x = 0; x < 40; ++x) {
      ink += canvas.at(x, y) == Colour{0, 0, 0} ? 1 : 0;
    }
  }
  CHECK(ink > 10);
  CHECK(Canvas::text_width("Wü二") == 21);
}
