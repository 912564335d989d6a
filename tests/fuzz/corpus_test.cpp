// The fuzzers' corpus as an ordinary test: whatever once was interesting stays harmless.

#include <random>

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
  CHECK(replay("mbap", fuzz::mbap) >= 5);
  CHECK(replay("register_plan", fuzz::register_plan) >= 5);
  CHECK(replay("config", fuzz::config) >= 10);
  CHECK(replay("learned", fuzz::learned) >= 5);
}

TEST_CASE("random bytes keep the laws of the links", "[fuzz]") {
  std::mt19937 random(1);
  for (int i = 0; i < 5'000; ++i) {
    std::string bytes(random() % 48, '\0');
    const auto rare = 1 + random() % 16;  // how many bytes are zero, which a server made of bytes answers
    for (char& byte : bytes) {
      byte = random() % rare == 0 ? static_cast<char>(random()) : '\0';
    }
    fuzz::mbap(bytes);
    fuzz::register_plan(bytes);
  }
}
