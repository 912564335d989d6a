// The fuzzers' corpus as an ordinary test: whatever once was interesting stays harmless.

#include "tests/fuzz/targets.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/golden.hpp"

using namespace tacho;

namespace {

std::size_t replay(const std::string& name, void (*target)(std::string_view)) {
  std::size_t inputs = 0;
  for (const auto& entry :
       std::filesystem::directory_iterator(std::filesystem::path(TACHO_SOURCE_DIR) / "tests/fuzz/corpus" / name)) {
    const std::string bytes = test::read_file(entry.path());
    INFO(entry.path().string());
    target(bytes);
    for (std::size_t length = 0; length < bytes.size(); length += 1 + bytes.size() / 16) {
      target(std::string_view(bytes).substr(0, length));
    }
    ++inputs;
  }
  return inputs;
}

}  // namespace

TEST_CASE("every input of the fuzz corpus keeps the laws, whole and cut", "[fuzz]") {
  CHECK(replay("frame", fuzz::frame) >= 5);
  CHECK(replay("status_json", fuzz::status_json) >= 5);
  CHECK(replay("registers", fuzz::registers) >= 5);
  CHECK(replay("block", fuzz::block) >= 5);
}
