#include "analyzer/report/folder.hpp"

#include <nlohmann/json.hpp>

#include "schema/error.hpp"
#include "tests/analyzer/example_section.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/golden.hpp"
#include "tests/support/temp_dir.hpp"

using namespace tacho;
using namespace tacho::test;
using namespace tacho::report;
namespace fs = std::filesystem;

namespace {

std::vector<Section> sections() { return {example_section()}; }

Manifest manifest() {
  Manifest out;
  out.origin.tool = "tacho-analyzer test";
  out.origin.robots = {"amb-01"};
  out.input = {{"0001.db", 3, sha256("abc")}};
  return out;
}

std::map<std::string, std::string> contents(const fs::path& folder) {
  std::map<std::string, std::string> out;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) {
      out[fs::relative(entry.path(), folder).generic_string()] = read_file(entry.path());
    }
  }
  return out;
}

}  // namespace

TEST_CASE("SHA-256 agrees with the standard's examples") {
  CHECK(sha256("") == "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  CHECK(sha256("abc") == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  TempDir dir;
  write_file(dir / "a", std::string(3'000'000, 'a'));
  CHECK(sha256_of(dir / "a") == sha256(std::string(3'000'000, 'a')));
  CHECK_THROWS_AS(sha256_of(dir / "none"), Error);
}

TEST_CASE("a report lists every file with its hash, and the hashes are right") {
  TempDir dir;
  write_report(dir / "out", sections(), manifest());
  const auto files = contents(dir / "out");
  const auto document = nlohmann::json::parse(files.at("manifest.json"));
  CHECK(document["files"].size() + 1 == files.size());
  for (const auto& file : document["files"]) {
    const std::string& bytes = files.at(file["name"].get<std::string>());
    CHECK(file["bytes"].get<std::size_t>() == bytes.size());
    CHECK(file["sha256"].get<std::string>() == sha256(bytes));
  }
  for (const char* name : {"summary.txt", "report.json", "example/example.json", "example/episodes.csv",
                           "example/schema.csv", "example/blocked_lost_s.png"}) {
    INFO(name);
    CHECK(files.count(name) == 1);
  }
}

TEST_CASE("the same input gives the same bytes") {
  TempDir dir;
  write_report(dir / "a", sections(), manifest());
  write_report(dir / "b", sections(), manifest());
  CHECK(contents(dir / "a") == contents(dir / "b"));
}

TEST_CASE("a report replaces an earlier one, and nothing else") {
  TempDir dir;
  std::vector<Section> two = sections();
  two.push_back(example_section());
  two.back().name = "gone";
  write_report(dir / "out", two, manifest());
  REQUIRE(fs::exists(dir / "out" / "gone" / "gone.json"));
  write_report(dir / "out", sections(), manifest());
  CHECK_FALSE(fs::exists(dir / "out" / "gone" / "gone.json"));

  write_file(dir / "mine" / "notes.txt", "important");
  CHECK_THROWS_AS(write_report(dir / "mine", sections(), manifest()), Error);
  CHECK(contents(dir / "mine").size() == 1);
}

TEST_CASE("a manifest cannot make us delete files outside the report") {
  const std::string evil =
      R"({"format":"tachograph-manifest","files":[{"name":"../keep"},{"name":"/etc/keep"},{"name":"ok"}]})";
  CHECK(files_of_manifest(evil) == std::vector<std::string>{"ok"});
  CHECK(files_of_manifest("no JSON").empty());
  CHECK(files_of_manifest(R"({"files":[{"name":"x"}]})").empty());
}

TEST_CASE("a folder that cannot be written is named with the cause") {
  TempDir dir;
  write_file(dir / "file", "x");
  try {
    write_report(dir / "file", sections(), manifest());
    FAIL("nothing thrown");
  } catch (const Error& error) {
    CHECK(std::string(error.what()).find("is a file") != std::string::npos);
  }
  CHECK_THROWS_AS(write_file(dir / "file" / "below", "x"), Error);
}

TEST_CASE("the summary counts verdicts and begins with the worst") {
  const std::string text = summary_text(sections(), manifest().origin);
  CHECK(text.find("1 FAIL, 0 WARN, 1 UNKNOWN, 1 PASS, 0 NA") != std::string::npos);
  CHECK(text.find("EXA-03") < text.find("EXA-01"));
}
