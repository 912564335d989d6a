#include "analyzer/report/png.hpp"

#include <png.h>

#include <algorithm>
#include <cassert>
#include <memory>

#include "analyzer/report/text.hpp"
#include "schema/error.hpp"

namespace tacho::report {

std::string encode_png(const Canvas& canvas) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(canvas.width());
  image.height = static_cast<png_uint_32>(canvas.height());
  image.format = PNG_FORMAT_RGB;
  const std::unique_ptr<png_image, decltype(&png_image_free)> owner(&image, &png_image_free);
  png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(image);
  std::string out(size, '\0');
  if (png_image_write_to_memory(&image, out.data(), &size, 0, canvas.bytes().data(), 0, nullptr) == 0) {
    throw Error("picture", image.message, "report this as a defect");
  }
  out.resize(size);
  return out;
}

std::vector<File> png_files(const Section& section) {
  std::vector<File> files;
  for (const Grid& grid : section.grids) {
    for (const std::string& name : grid.pictures) {
      const auto layer = std::find_if(grid.layers.begin(), grid.layers.end(),
                                      [&](const GridLayer& candidate) { return candidate.name == name; });
      assert(layer != grid.layers.end() && "a picture of a layer that the grid does not have");
      files.push_back({file_stem(grid.name + "_" + name) + ".png", encode_png(draw_heat_map(grid, *layer))});
    }
  }
  return files;
}

}  // namespace tacho::report
