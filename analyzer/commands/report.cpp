#include "analyzer/commands/report.hpp"

#include <algorithm>

#include "analyzer/analysis.hpp"
#include "analyzer/commands/info.hpp"
#include "analyzer/report/folder.hpp"

namespace tacho::commands {
namespace {

namespace fs = std::filesystem;

report::FileDigest digest(const fs::path& file) {
  return {file.filename().string(), fs::file_size(file), report::sha256_of(file)};
}

/// Parts by number; only names, sizes and contents, so that a copy elsewhere makes the same report.
std::vector<report::FileDigest> input_of(const Job& job) {
  std::vector<report::FileDigest> out;
  if (job.reader != nullptr) {
    for (const store::LogReader::PartInfo& part : job.reader->parts()) {
      out.push_back(digest(part.path));
    }
  }
  return out;
}

report::Manifest manifest_of(const Job& job) {
  report::Manifest manifest;
  manifest.origin = job.origin();
  manifest.input = input_of(job);
  if (!job.options.config.empty()) {
    manifest.config = digest(job.options.config);
  }
  manifest.robots = job.robots;
  manifest.coverage = job.log->coverage();
  const std::vector<RobotId> ids = job.robot_ids();
  std::erase_if(manifest.coverage,
                [&](const Coverage& c) { return std::find(ids.begin(), ids.end(), c.robot) == ids.end(); });
  return manifest;
}

}  // namespace

int report_all(Job& job) {
  if (job.options.output.empty()) {
    throw UsageError("report writes a folder: name it with -o DIR");
  }
  std::vector<Section> sections;
  if (!job.robots.empty()) {
    sections = run_analyses(analyses(), *job.log, job.robot_ids(), job.window, job.options.zone, job.settings);
  }
  sections.insert(sections.begin(), info(*job.log, job.info()));
  tell_problems(*job.log);
  report::Manifest manifest = manifest_of(job);
  const std::string summary = report::summary_text(sections, manifest.origin);
  report::write_report(job.options.output, sections, std::move(manifest));
  write_stdout(summary);
  std::vector<Finding> findings;
  for (const Section& section : sections) {
    findings.insert(findings.end(), section.findings.begin(), section.findings.end());
  }
  return exit_code(findings, job.options.fail_on);
}

}  // namespace tacho::commands
