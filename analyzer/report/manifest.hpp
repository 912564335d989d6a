#pragma once
// What a report was made from and what it consists of, with SHA-256 of both, so that a copy can be checked years later.

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "analyzer/report/json.hpp"

namespace tacho::report {

/// 64 lower case hexadecimal digits.
std::string sha256(std::string_view bytes);
/// Throws Error when the file cannot be read.
std::string sha256_of(const std::filesystem::path& file);

/// A file by name (relative, '/' between folders), size and hash.
struct FileDigest {
  std::string name;
  std::uint64_t bytes = 0;
  std::string sha256;
};

struct Manifest {
  Origin origin;
  std::vector<FileDigest> input;  ///< parts of the log
  FileDigest config;              ///< name empty: defaults only
  std::vector<Coverage> coverage;
  std::vector<Robot> robots;      ///< names for the coverage
  std::vector<FileDigest> files;  ///< of the report, by name; the manifest itself is not among them
};

std::string manifest_text(const Manifest& manifest);

/// Names of the files that an earlier manifest lists; empty when the text is no manifest. Names that would lead out of
/// the folder are left out.
std::vector<std::string> files_of_manifest(std::string_view text);

}  // namespace tacho::report
