#include <algorithm>
#include <cmath>
#include <limits>

#include "analyzer/report/palette.hpp"
#include "analyzer/report/png.hpp"
#include "analyzer/report/text.hpp"

namespace tacho::report {
namespace {

constexpr Colour kPaper{0xFF, 0xFF, 0xFF};
constexpr Colour kInk{0x22, 0x22, 0x22};
constexpr Colour kSoft{0x77, 0x77, 0x77};
constexpr Colour kFrame{0xAA, 0xAA, 0xAA};

constexpr int kLeft = 76;
constexpr int kTop = 52;
constexpr int kRight = 200;
constexpr int kBottom = 58;
constexpr int kLargestMap = 1000;  // pixels
constexpr int kLargestCell = 20;
constexpr int kFloor = 12;  // empty floor around the cells
constexpr int kLeastFrameWidth = 420;
constexpr int kLeastFrameHeight = 300;

int as_int(double value) { return static_cast<int>(std::lround(value)); }

/// Metres -> pixels of one picture.
struct Transform {
  const Grid& grid;
  const MapGeometry& geometry;
  [[nodiscard]] double pixels_per_metre() const {
    return geometry.pixels_per_cell / (grid.cell_m * static_cast<double>(geometry.cells_per_pixel));
  }
  [[nodiscard]] double x_of(double pixel) const {
    return static_cast<double>(grid.i0) * grid.cell_m + (pixel - geometry.map.x) / pixels_per_metre();
  }
  [[nodiscard]] double y_of(double pixel) const {
    return static_cast<double>(grid.j0) * grid.cell_m +
           (geometry.map.y + geometry.map.height - pixel) / pixels_per_metre();
  }
  [[nodiscard]] int pixel_x(double x_m) const {
    return as_int(geometry.map.x + (x_m - static_cast<double>(grid.i0) * grid.cell_m) * pixels_per_metre());
  }
  [[nodiscard]] int pixel_y(double y_m) const {
    return as_int(geometry.map.y + geometry.map.height -
                  (y_m - static_cast<double>(grid.j0) * grid.cell_m) * pixels_per_metre());
  }
};

/// The cell (or of a block of cells the greatest) at block column `bi`, block row `bj` from the bottom.
struct BlockValue {
  double value = std::numeric_limits<double>::quiet_NaN();
  double opacity = 1.0;
};
BlockValue block_value(const Grid& grid, const GridLayer& layer, const GridLayer* opacity, std::size_t block,
                       std::pair<std::size_t, std::size_t> at) {
  BlockValue out;
  for (std::size_t j = at.second * block; j < std::min(grid.height, (at.second + 1) * block); ++j) {
    for (std::size_t i = at.first * block; i < std::min(grid.width, (at.first + 1) * block); ++i) {
      const std::size_t cell = j * grid.width + i;
      if (std::isfinite(layer.value[cell]) && !(layer.value[cell] <= out.value)) {
        out.value = layer.value[cell];
        out.opacity = opacity != nullptr && std::isfinite(opacity->value[cell]) ? opacity->value[cell] : 1.0;
      }
    }
  }
  return out;
}

/// A layer that says how sure a rate is.
const GridLayer* beside(const Grid& grid, const GridLayer& layer, std::string_view name) {
  if (layer.unit.find('/') == std::string::npos) {
    return nullptr;  // a sum is a fact, however few passes it comes from
  }
  const auto found =
      std::find_if(grid.layers.begin(), grid.layers.end(), [&](const GridLayer& l) { return l.name == name; });
  return found == grid.layers.end() ? nullptr : &*found;
}
const GridLayer* opacity_of(const Grid& grid, const GridLayer& layer) { return beside(grid, layer, "opacity"); }
const GridLayer* too_few_of(const Grid& grid, const GridLayer& layer) { return beside(grid, layer, "too_few"); }

void draw_cells(Canvas& canvas, const Grid& grid, const GridLayer& layer, const ColourScale& scale) {
  const MapGeometry geometry = map_geometry(grid);
  const GridLayer* opacity = opacity_of(grid, layer);
  const GridLayer* too_few = too_few_of(grid, layer);
  const std::size_t block = geometry.cells_per_pixel;
  const int size = geometry.pixels_per_cell;
  for (std::size_t bj = 0; bj * block < grid.height; ++bj) {
    for (std::size_t bi = 0; bi * block < grid.width; ++bi) {
      const BlockValue cell = block_value(grid, layer, opacity, block, {bi, bj});
      const int x = geometry.map.x + static_cast<int>(bi) * size;
      const int y = geometry.map.y + geometry.map.height - (static_cast<int>(bj) + 1) * size;
      if (!std::isfinite(cell.value)) {
        if (too_few != nullptr && std::isfinite(block_value(grid, *too_few, nullptr, block, {bi, bj}).value)) {
          canvas.fill({x, y, size, size}, kTooFew);
        }
        continue;
      }
      canvas.fill({x, y, size, size}, mix(kLittleData, viridis(scale.share(cell.value)), cell.opacity));
    }
  }
}

void draw_axes(Canvas& canvas, const Grid& grid, const MapGeometry& geometry) {
  const Transform to{grid, geometry};
  const Rect f = geometry.frame;
  canvas.frame({f.x - 1, f.y - 1, f.width + 2, f.height + 2}, kFrame);
  const double step = round_step((f.width + f.height) / 2.0 / to.pixels_per_metre(), 7);
  for (double k = std::ceil(to.x_of(f.x) / step); k * step <= to.x_of(f.x + f.width); ++k) {
    const int x = to.pixel_x(k * step);
    const std::string label = brief(k * step);
    canvas.fill({x, f.y + f.height + 1, 1, 5}, kSoft);
    canvas.text(x - Canvas::text_width(label) / 2, f.y + f.height + 8, label, kInk);
  }
  for (double k = std::ceil(to.y_of(f.y + f.height) / step); k * step <= to.y_of(f.y); ++k) {
    const int y = to.pixel_y(k * step);
    const std::string label = brief(k * step);
    canvas.fill({f.x - 6, y, 5, 1}, kSoft);
    canvas.text(f.x - 9 - Canvas::text_width(label), y - kGlyphHeight / 2, label, kInk);
  }
  canvas.text(f.x + f.width - Canvas::text_width("x [m]"), f.y + f.height + 26, "x [m]", kSoft);
  canvas.text_upwards(8, f.y + f.height / 2 + Canvas::text_width("y [m]") / 2, "y [m]", kSoft);
}

void draw_scale_bar(Canvas& canvas, const Grid& grid, const MapGeometry& geometry) {
  const Transform to{grid, geometry};
  const Rect f = geometry.frame;
  const double length = round_step(f.width / to.pixels_per_metre(), 5);
  const int pixels = as_int(length * to.pixels_per_metre());
  const std::string label = brief(length) + " m";
  const int x = f.x;
  const int y = f.y + f.height + 42;
  canvas.fill({x, y, pixels, 3}, kInk);
  canvas.fill({x, y - 4, 1, 11}, kInk);
  canvas.fill({x + pixels - 1, y - 4, 1, 11}, kInk);
  canvas.text(x + pixels + 8, y - 5, label, kInk);
}

/// Values without a unit are counts or shares; whole numbers only means counts.
std::string legend_unit(const GridLayer& layer) {
  if (!layer.unit.empty() && layer.unit != "1") {
    return layer.unit;
  }
  const bool whole = std::all_of(layer.value.begin(), layer.value.end(),
                                 [](double v) { return !std::isfinite(v) || v == std::floor(v); });
  return whole ? "count" : "share";
}

void draw_legend(Canvas& canvas, const Grid& grid, const GridLayer& layer, const ColourScale& scale, Rect frame) {
  const bool faded = opacity_of(grid, layer) != nullptr;
  const GridLayer* too_few = too_few_of(grid, layer);
  const int x = frame.x + frame.width + 22;
  constexpr int bar = 18;
  const int swatches = 1 + (faded ? 1 : 0) + (too_few != nullptr ? 1 : 0);
  const int top = frame.y + 22;
  const int height = std::clamp(frame.height - 22 - 24 * swatches - 14, 120, 360);
  const std::string unit = legend_unit(layer);
  canvas.text(x, frame.y, unit, kInk, kBold);
  for (int y = 0; y < height; ++y) {
    canvas.fill({x, top + y, bar, 1}, viridis(1.0 - static_cast<double>(y) / (height - 1)));
  }
  canvas.frame({x - 1, top - 1, bar + 2, height + 2}, kFrame);
  for (const double tick : scale.ticks) {
    const int y = top + as_int((1.0 - scale.share(tick)) * (height - 1));
    canvas.fill({x + bar + 1, y, 4, 1}, kSoft);
    const bool open = scale.clipped_above && tick == scale.ticks.back();
    canvas.text(x + bar + 8, y - kGlyphHeight / 2, (open ? "> " : "") + brief(tick, 4), kInk);
  }
  int y = top + height + 14;
  const auto swatch = [&](Colour colour, const std::string& words) {
    canvas.fill({x, y, bar, 13}, colour);
    canvas.frame({x - 1, y - 1, bar + 2, 15}, kFrame);
    canvas.text(x + bar + 8, y, words, kInk);
    y += 22;
  };
  swatch(kUnvisited, "not visited");
  if (too_few != nullptr) {
    swatch(kTooFew, too_few->title);
  }
  if (faded) {
    swatch(kLittleData, "little data");
  }
}

}  // namespace

MapGeometry map_geometry(const Grid& grid) {
  MapGeometry out;
  const auto width = std::max<std::size_t>(grid.width, 1);
  const auto height = std::max<std::size_t>(grid.height, 1);
  const std::size_t longest = std::max(width, height);
  constexpr std::size_t room = kLargestMap;
  out.cells_per_pixel = (longest + room - 1) / room;
  out.pixels_per_cell = out.cells_per_pixel > 1 ? 1 : std::min(static_cast<int>(room / longest), kLargestCell);
  const auto pixels = [&](std::size_t cells) {
    return static_cast<int>((cells + out.cells_per_pixel - 1) / out.cells_per_pixel) * out.pixels_per_cell;
  };
  out.frame = {kLeft, kTop, std::max(pixels(width) + 2 * kFloor, kLeastFrameWidth),
               std::max(pixels(height) + 2 * kFloor, kLeastFrameHeight)};
  out.map = {kLeft + (out.frame.width - pixels(width)) / 2, kTop + (out.frame.height - pixels(height)) / 2,
             pixels(width), pixels(height)};
  return out;
}

Canvas draw_heat_map(const Grid& grid, const GridLayer& layer) {
  const MapGeometry geometry = map_geometry(grid);
  const ColourScale scale = colour_scale(layer.value);
  Canvas canvas(kLeft + geometry.frame.width + kRight, kTop + geometry.frame.height + kBottom, kPaper);
  canvas.fill(geometry.frame, kUnvisited);
  draw_cells(canvas, grid, layer, scale);
  draw_axes(canvas, grid, geometry);
  draw_scale_bar(canvas, grid, geometry);
  draw_legend(canvas, grid, layer, scale, geometry.frame);

  const auto fitting = [&](const std::string& text, const Font& font) {
    return shortened(text, static_cast<std::size_t>((canvas.width() - kLeft - 8) / font.advance));
  };
  canvas.text(kLeft, 10, fitting(layer.title.empty() ? layer.name : layer.title, kBold), kInk, kBold);
  const bool told = grid.map.empty() || grid.title.find(grid.map) != std::string::npos;
  const std::string below = grid.title + (told ? "" : ", map " + grid.map) + ", cell " + brief(grid.cell_m) + " m";
  canvas.text(kLeft, 28, fitting(below, kRegular), kSoft);
  return canvas;
}

}  // namespace tacho::report
