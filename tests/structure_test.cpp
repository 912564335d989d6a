// The house itself: who may include whom, which third-party header lives where, how long a file may get.

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <string>
#include <vector>

#include "tests/support/catch.hpp"

namespace fs = std::filesystem;

namespace {

struct Line {
  std::string file;  // relative to the repository
  std::string include;
};

bool is_source(const fs::path& path) { return path.extension() == ".cpp" || path.extension() == ".hpp"; }

std::vector<fs::path> sources() {
  std::vector<fs::path> found;
  for (const char* top : {"schema", "recorder", "analyzer", "samples", "tests"}) {
    for (const auto& entry : fs::recursive_directory_iterator(fs::path(TACHO_SOURCE_DIR) / top)) {
      if (entry.is_regular_file() && is_source(entry.path())) {
        found.push_back(entry.path());
      }
    }
  }
  std::sort(found.begin(), found.end());
  return found;
}

std::vector<Line> includes() {
  std::vector<Line> lines;
  for (const fs::path& path : sources()) {
    std::ifstream in(path);
    for (std::string text; std::getline(in, text);) {
      const std::size_t open = text.find_first_of("<\"");
      if (text.rfind("#include", 0) == 0 && open != std::string::npos) {
        const std::size_t close = text.find_first_of(">\"", open + 1);
        lines.push_back({fs::relative(path, TACHO_SOURCE_DIR).string(), text.substr(open + 1, close - open - 1)});
      }
    }
  }
  return lines;
}

bool starts_with(const std::string& text, const std::string& head) { return text.rfind(head, 0) == 0; }

/// "schema/store" for files of the store, "analyzer/analyses" and so on; the longest room that matches.
std::string room_of(const std::string& path) {
  static const std::vector<std::string> kRooms{"schema/wire", "schema/store",      "schema",        "recorder/link",
                                               "recorder",    "analyzer/analyses", "analyzer/math", "analyzer/report",
                                               "analyzer",    "samples/simulator", "tests"};
  for (const std::string& room : kRooms) {
    if (starts_with(path, room + "/")) {
      return room;
    }
  }
  return "";
}

}  // namespace

TEST_CASE("dependencies point one way") {
  const std::map<std::string, std::vector<std::string>> may_include{
      {"schema/wire", {"schema", "schema/wire"}},
      {"schema/store", {"schema", "schema/store"}},
      {"schema", {"schema", "schema/wire", "schema/store"}},
      {"recorder/link", {"schema", "schema/wire", "recorder/link"}},
      {"recorder", {"schema", "schema/wire", "schema/store", "recorder", "recorder/link"}},
      {"analyzer/math", {"analyzer/math"}},
      {"analyzer/analyses", {"schema", "analyzer", "analyzer/math", "analyzer/analyses"}},
      {"analyzer/report", {"schema", "analyzer/report"}},
      {"analyzer", {"schema", "schema/store", "analyzer", "analyzer/analyses", "analyzer/report"}},
      {"samples/simulator", {"schema", "schema/wire", "schema/store", "samples/simulator"}},
  };
  for (const Line& line : includes()) {
    const std::string from = room_of(line.file);
    const std::string to = room_of(line.include);
    if (from == "tests" || to.empty()) {
      continue;
    }
    INFO(line.file << " includes " << line.include);
    const auto& allowed = may_include.at(from);
    const bool section = from == "analyzer/analyses" && line.include == "analyzer/report/section.hpp";
    CHECK((section || std::find(allowed.begin(), allowed.end(), to) != allowed.end()));
  }
}

TEST_CASE("each third-party header stays in the folders that own it") {
  const std::vector<std::pair<std::string, std::vector<std::string>>> walls{
      {"sqlite3", {"schema/store/", "tests/support/faulty_vfs"}},
      {"zstd", {"schema/store/"}},
      {"simdjson", {"schema/wire/"}},
      {"nlohmann/", {"analyzer/report/", "analyzer/commands/", "recorder/link/link_memory", "samples/simulator/"}},
      {"Eigen/", {"analyzer/math/", "analyzer/analyses/"}},
      {"modbus/", {"samples/simulator/"}},
      {"toml++/", {"recorder/config", "analyzer/settings"}},
      {"httplib.h", {"recorder/metrics_server"}},
      {"png.h", {"analyzer/report/"}},
      {"CLI/", {"recorder/main.cpp", "analyzer/main.cpp", "samples/simulator/main.cpp", "analyzer/commands/"}},
      {"catch2/", {}},
  };
  for (const Line& line : includes()) {
    for (const auto& [header, folders] : walls) {
      // Tests may use what they test; SQLite they see through the store, or as a disk below it.
      if (starts_with(line.include, header) && (header == "sqlite3" || !starts_with(line.file, "tests/"))) {
        INFO(line.file << " includes <" << line.include << ">");
        CHECK(std::any_of(folders.begin(), folders.end(), [&](const auto& f) { return starts_with(line.file, f); }));
      }
    }
  }
}

TEST_CASE("no file is longer than 600 lines") {
  for (const fs::path& path : sources()) {
    std::ifstream in(path);
    const auto lines = std::count(std::istreambuf_iterator<char>(in), {}, '\n');
    INFO(path.string() << ": " << lines);
    CHECK(lines <= 600);
  }
}

TEST_CASE("the top level holds what the plan says and nothing else") {
  const std::vector<std::string> allowed{
      "CMakeLists.txt", "CMakePresets.json", "README.md", "LICENSE", "recorder", "analyzer", "schema",
      "tests",          "samples",           "build"};
  for (const auto& entry : fs::directory_iterator(TACHO_SOURCE_DIR)) {
    const std::string name = entry.path().filename().string();
    INFO(name);
    CHECK((name[0] == '.' || std::find(allowed.begin(), allowed.end(), name) != allowed.end()));
  }
}

TEST_CASE("every folder of sources says what lives there") {
  for (const fs::path& path : sources()) {
    const fs::path folder = path.parent_path();
    if (starts_with(fs::relative(folder, TACHO_SOURCE_DIR).string(), "tests/")) {
      continue;
    }
    INFO(folder.string());
    CHECK(fs::exists(folder / "README.md"));
  }
}
