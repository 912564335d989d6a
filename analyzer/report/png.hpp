#pragma once
// Heat maps as PNG: one layer of a Grid with axes in metres, legend with unit and numbers, scale bar and title.

#include <string>
#include <vector>

#include "analyzer/report/canvas.hpp"
#include "analyzer/report/csv.hpp"
#include "analyzer/report/section.hpp"

namespace tacho::report {

inline constexpr Colour kUnvisited{0xF7, 0xF7, 0xF7};
inline constexpr Colour kTooFew{0xE3, 0xC9, 0xA8};      ///< visited, but too rarely for a rate
inline constexpr Colour kLittleData{0xC4, 0xC4, 0xC4};  ///< what a cell of opacity 0 looks like

/// Where the cells stand in the picture. Row j = 0 of the grid is at the bottom.
struct MapGeometry {
  Rect map;    ///< pixels of the cells
  Rect frame;  ///< the map and the empty floor around it
  int pixels_per_cell = 1;
  std::size_t cells_per_pixel = 1;  ///< above 1 on very large maps: a pixel shows the greatest of its cells
};
MapGeometry map_geometry(const Grid& grid);

/// Values above the legend's top show as its top colour. When the grid has a layer "opacity" (0..1) and this layer is a
/// rate (its unit has a "/"), cells fade to kLittleData where their own data say little. Where a rate is
/// missing and a layer "too_few" has a value, the cell is kTooFew, and that layer's title says so in the legend.
Canvas draw_heat_map(const Grid& grid, const GridLayer& layer);

std::string encode_png(const Canvas& canvas);

/// One picture per layer named in Grid::pictures: GRID_LAYER.png.
std::vector<File> png_files(const Section& section);

}  // namespace tacho::report
