#pragma once
// A report as a folder:
//   summary.txt            findings of all sections, worst first
//   report.json            all sections
//   NAME/NAME.json         one section; NAME/*.csv its tables, curves and maps (NAME/schema.csv: the columns);
//   NAME/*.png manifest.json          what it was made from, and the SHA-256 of every file above
// The same log, configuration and version give the same bytes.

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "analyzer/report/csv.hpp"
#include "analyzer/report/manifest.hpp"
#include "analyzer/report/section.hpp"

namespace tacho::report {

/// Everything but the manifest, names relative to the folder, sorted.
std::vector<File> report_files(std::span<const Section> sections, const Origin& origin);

/// Fills `manifest.files` and writes all. An existing report is replaced; throws Error when the folder holds anything
/// else, or cannot be written. The manifest is written last: a folder without one is an interrupted report.
void write_report(const std::filesystem::path& folder, std::span<const Section> sections, Manifest manifest);

/// Writes one file, making its folders; throws Error.
void write_file(const std::filesystem::path& path, std::string_view bytes);

/// Findings of all sections, worst first, as text.
std::string summary_text(std::span<const Section> sections, const Origin& origin);

}  // namespace tacho::report
