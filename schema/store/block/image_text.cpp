#include "schema/store/block/image_text.hpp"

#include <algorithm>
#include <array>

#include "schema/fields.hpp"

namespace tacho::store {

namespace {

constexpr std::size_t kHeadBytes = 4;
constexpr std::size_t kMostLeaves = 4096;
constexpr std::size_t kAddresses = 1024;

std::uint32_t u16_at(std::string_view bytes, std::size_t at) {
  return std::uint32_t{static_cast<unsigned char>(bytes[at])} << 8U | static_cast<unsigned char>(bytes[at + 1]);
}

/// What the field table says begins at each address.
constexpr auto kLetters = [] {
  std::array<char, kAddresses> letters{};
  for (const Field& field : kFields) {
    if (field.reg.present() && !field.reg.discrete && field.reg.words() == 2 && field.reg.address < kAddresses) {
      letters[field.reg.address] = field.reg.type == RegisterType::f32 ? 'f' : 'i';
    }
  }
  return letters;
}();

/// `left`: words from this one to the end of the range.
char letter_at(std::uint32_t address, std::size_t left) {
  const char letter = address < kAddresses ? kLetters[address] : '\0';
  return letter != '\0' && left > 1 ? letter : 'w';
}

std::size_t bytes_of(char letter) {
  switch (letter) {
    case 'b':
      return 1;
    case 'w':
      return 2;
    case 'f':
    case 'i':
      return 4;
    default:
      return 0;
  }
}

/// Addresses inside the leaf.
std::uint32_t addresses_of(char letter) {
  constexpr std::uint32_t kBits = 8;
  return letter == 'b' ? kBits : static_cast<std::uint32_t>(bytes_of(letter) / 2);
}

std::string leaf_path(char letter, std::uint32_t first, std::uint32_t last) {
  std::string path = (letter == 'b' ? "1x" : "3x") + std::to_string(first);
  if (last > first) {
    path += "-" + std::to_string(last);
  }
  return path;
}

}  // namespace

bool split_image(std::string_view image, bool discrete, std::string& shape, std::vector<std::string_view>& leaves) {
  shape.clear();
  leaves.clear();
  while (!image.empty()) {
    if (image.size() < kHeadBytes) {
      return false;
    }
    std::uint32_t address = u16_at(image, 0);
    const std::uint32_t count = u16_at(image, 2);
    std::size_t left = discrete ? (count + 7) / 8 : std::size_t{2} * count;
    if (count == 0 || image.size() - kHeadBytes < left || leaves.size() + left > kMostLeaves) {
      return false;
    }
    shape.append(image, 0, kHeadBytes);
    image.remove_prefix(kHeadBytes);
    while (left > 0) {
      const char letter = discrete ? 'b' : letter_at(address, left / 2);
      const std::size_t size = bytes_of(letter);
      shape += letter;
      leaves.push_back(image.substr(0, size));
      image.remove_prefix(size);
      left -= size;
      address += addresses_of(letter);
    }
  }
  return !leaves.empty();
}

bool name_registers(std::string_view shape, bool discrete, std::vector<ImageHole>& holes) {
  holes.clear();
  while (!shape.empty()) {
    if (shape.size() < kHeadBytes) {
      return false;
    }
    const std::string head(shape.substr(0, kHeadBytes));
    std::uint32_t address = u16_at(shape, 0);
    const std::uint32_t count = u16_at(shape, 2);
    const std::uint32_t end = address + count;
    std::size_t left = discrete ? (count + 7) / 8 : std::size_t{2} * count;
    shape.remove_prefix(kHeadBytes);
    for (bool first = true; left > 0; first = false) {
      const char letter = shape.empty() ? '\0' : shape.front();
      const std::size_t size = bytes_of(letter);
      if (size == 0 || size > left || (letter == 'b') != discrete || holes.size() >= kMostLeaves) {
        return false;
      }
      const std::uint32_t last = std::min(address + addresses_of(letter), end) - 1;
      holes.push_back({leaf_path(letter, address, last), letter, first ? head : std::string(), address, last});
      shape.remove_prefix(1);
      left -= size;
      address += addresses_of(letter);
    }
  }
  return !holes.empty();
}

std::string register_path(std::uint32_t address, bool pair) {
  return leaf_path('w', address, address + (pair ? 1 : 0));
}

}  // namespace tacho::store
