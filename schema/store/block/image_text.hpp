#pragma once
// Register images (schema/wire/registers.hpp describes the bytes) taken apart in the way JSON is: a shape, and leaves
// that are bytes of the image.
//
// Shape: per range first address and count (u16 big-endian each, as in the image), then one letter per leaf:
//   w  a word    f  two words that hold a float    i  two words that hold a whole number    b  eight discrete inputs
// Paths are addresses as documented, "3x8" for a word, "3x21-22" for a pair, "1x1-8" for eight inputs (lowest bit
// first, the last ones of a range may be fewer): they need no field table to be understood.

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace tacho::store {

struct ImageHole {
  std::string path;
  char letter = 'w';
  std::string before;       ///< bytes of the image between the leaf before and this one
  std::uint32_t first = 0;  ///< address
  std::uint32_t last = 0;   ///< of the last that was asked for: the last byte of inputs may hold fewer than eight
};

/// `discrete`: inputs [1x], else words [3x]. Words that the field table joins are one leaf where both were read. False
/// when the bytes are no image.
[[nodiscard]] bool split_image(std::string_view image, bool discrete, std::string& shape,
                               std::vector<std::string_view>& leaves);

/// False when the bytes are no shape. Images end with their last leaf.
[[nodiscard]] bool name_registers(std::string_view shape, bool discrete, std::vector<ImageHole>& holes);

/// Path of the word at `address`, or of the pair that begins there.
std::string register_path(std::uint32_t address, bool pair);

}  // namespace tacho::store
