#include "analyzer/report/folder.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <iterator>

#include "analyzer/report/png.hpp"
#include "analyzer/report/terminal.hpp"
#include "analyzer/report/text.hpp"
#include "schema/error.hpp"
#include "schema/time.hpp"

namespace tacho::report {
namespace {

namespace fs = std::filesystem;
constexpr const char* kManifest = "manifest.json";

std::string read_all(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

/// Removes an earlier report, and nothing but it.
void make_room(const fs::path& folder) {
  std::error_code ec;
  if (!fs::exists(folder, ec)) {
    return;
  }
  if (!fs::is_directory(folder, ec)) {
    throw Error(folder.string(), "is a file", "give -o a folder");
  }
  const bool empty = fs::is_empty(folder, ec);
  if (ec) {
    throw Error(folder.string(), ec.message(), "give -o a folder that can be read and written");
  }
  if (empty) {
    return;
  }
  const std::vector<std::string> old = files_of_manifest(read_all(folder / kManifest));
  if (old.empty()) {
    throw Error(folder.string(), "holds files that are no report", "give -o a new or empty folder");
  }
  for (const std::string& name : old) {
    fs::remove(folder / name, ec);
  }
  fs::remove(folder / kManifest, ec);
}

std::string period_text(const Window& window, const std::string& zone) {
  const Window open;
  const auto text = [&](Micros t, Micros none, const char* word) {
    return t == none ? std::string(word) : iso_zone(t, zone);
  };
  return text(window.from_us, open.from_us, "start of the log") + " to " +
         text(window.to_us, open.to_us, "end of the log") + ", days in " + zone;
}

std::string verdict_counts(const std::vector<Finding>& findings) {
  std::string out;
  for (const Verdict verdict :
       {Verdict::fail, Verdict::warn, Verdict::unknown, Verdict::pass, Verdict::not_applicable}) {
    const auto n =
        std::count_if(findings.begin(), findings.end(), [&](const Finding& f) { return f.verdict == verdict; });
    out += (out.empty() ? "" : ", ") + std::to_string(n) + " " + std::string(verdict_name(verdict));
  }
  return out;
}

}  // namespace

void write_file(const fs::path& path, std::string_view bytes) {
  std::error_code ec;
  if (path.has_parent_path()) {
    fs::create_directories(path.parent_path(), ec);
  }
  errno = 0;
  std::ofstream out(path, std::ios::binary | std::ios::trunc);
  out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  out.flush();
  if (!out) {
    throw Error(path.string(),
                ec           ? ec.message()
                : errno != 0 ? std::strerror(errno)
                             : "cannot be written",
                "check that the folder can be written and the disk has room");
  }
}

std::string summary_text(std::span<const Section> sections, const Origin& origin) {
  std::vector<Finding> findings;
  for (const Section& section : sections) {
    findings.insert(findings.end(), section.findings.begin(), section.findings.end());
  }
  std::string robots;
  for (const std::string& robot : origin.robots) {
    robots += (robots.empty() ? "" : ", ") + one_line(robot);
  }
  std::string out = "Tachograph report, " + origin.tool + "\n";
  out += "robots: " + (robots.empty() ? "none in this log" : robots) + "\n";
  out += "period: " + period_text(origin.window, origin.zone) + "\n";
  out += "findings: " + verdict_counts(findings) + "\n\n";
  TerminalOptions options;
  options.zone = origin.zone;
  for (const Finding& finding : worst_first(std::move(findings))) {
    out += terminal_text(finding, options);
  }
  return out;
}

std::vector<File> report_files(std::span<const Section> sections, const Origin& origin) {
  std::vector<File> files;
  files.push_back({"summary.txt", summary_text(sections, origin)});
  files.push_back({"report.json", json_text(sections, origin)});
  for (const Section& section : sections) {
    const std::string stem = file_stem(section.name);
    files.push_back({stem + "/" + stem + ".json", json_text({&section, 1}, origin)});
    for (File& file : csv_files(section)) {
      files.push_back({stem + "/" + file.name, std::move(file.bytes)});
    }
    for (File& file : png_files(section)) {
      files.push_back({stem + "/" + file.name, std::move(file.bytes)});
    }
  }
  std::sort(files.begin(), files.end(), [](const File& a, const File& b) { return a.name < b.name; });
  return files;
}

void write_report(const fs::path& folder, std::span<const Section> sections, Manifest manifest) {
  make_room(folder);
  for (const File& file : report_files(sections, manifest.origin)) {
    write_file(folder / file.name, file.bytes);
    manifest.files.push_back({file.name, file.bytes.size(), sha256(file.bytes)});
  }
  write_file(folder / kManifest, manifest_text(manifest));
}

}  // namespace tacho::report
