#pragma once
// Committed texts compared with what the program prints. `TACHO_UPDATE_GOLDEN=1` rewrites them instead; review the
// diff.

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include "tests/support/catch.hpp"

namespace tacho::test {

inline std::string read_file(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// `path` is relative to the repository.
inline void check_golden(const std::filesystem::path& path, const std::string& printed) {
  const std::filesystem::path file = std::filesystem::path(TACHO_SOURCE_DIR) / path;
  if (std::getenv("TACHO_UPDATE_GOLDEN") != nullptr) {
    std::ofstream(file, std::ios::binary) << printed;
  }
  INFO("committed copy: " << path.string() << " (TACHO_UPDATE_GOLDEN=1 rewrites it)");
  CHECK(read_file(file) == printed);
}

}  // namespace tacho::test
