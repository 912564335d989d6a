// Marks from another terminal: over a socket in the folder of the log.

#include "recorder/mark.hpp"

#include <sys/stat.h>

#include "tests/support/catch.hpp"
#include "tests/support/temp_dir.hpp"

using namespace tacho;
using namespace tacho::recorder;
using tacho::test::TempDir;

namespace {

std::string refused(const std::filesystem::path& log, const Mark& mark) {
  try {
    send_mark(log, mark);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

bool has(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

}  // namespace

TEST_CASE("marks arrive in their order, each once, with the robot they are for") {
  TempDir dir;
  MarkSocket socket(dir.path());
  CHECK_FALSE(socket.next());
  send_mark(dir.path(), {"", "pallet slipped"});
  send_mark(dir.path(), {"amr-1", "Hindernis vor Tür 3"});
  const auto first = socket.next();
  REQUIRE(first);
  CHECK(first->robot.empty());
  CHECK(first->text == "pallet slipped");
  const auto second = socket.next();
  REQUIRE(second);
  CHECK(second->robot == "amr-1");
  CHECK(second->text == "Hindernis vor Tür 3");
  CHECK_FALSE(socket.next());
}

TEST_CASE("a mark that nobody takes is refused, also when a killed recorder left its socket") {
  TempDir dir;
  CHECK(has(refused(dir.path(), {"", "x"}), "nobody records into this log"));
  CHECK(has(refused(dir / "nothing", {"", "x"}), "No such file"));
  {
    const MarkSocket socket(dir.path());
    CHECK(refused(dir.path(), {"", "x"}).empty());
    // A killed recorder leaves the name without anybody behind it.
    std::filesystem::create_hard_link(dir / "recorder.sock", dir / "left");
  }
  CHECK_FALSE(std::filesystem::exists(dir / "recorder.sock"));
  std::filesystem::rename(dir / "left", dir / "recorder.sock");
  CHECK(has(refused(dir.path(), {"", "x"}), "nobody records into this log"));
  MarkSocket next(dir.path());
  send_mark(dir.path(), {"", "again"});
  CHECK(next.next()->text == "again");
}

TEST_CASE("others than owner and group cannot reach the socket") {
  TempDir dir;
  const MarkSocket socket(dir.path());
  struct stat file {};
  REQUIRE(stat((dir / "recorder.sock").c_str(), &file) == 0);
  CHECK((file.st_mode & 0777U) == 0660U);
}

TEST_CASE("texts that are empty, too long or no UTF-8 are refused, and control characters do not reach the log") {
  TempDir dir;
  MarkSocket socket(dir.path());
  CHECK(has(refused(dir.path(), {"", ""}), "the text is empty"));
  CHECK(has(refused(dir.path(), {"", std::string(kLongestMark + 1, 'x')}), "too long"));
  for (const char* text : {"\xFF", "\xC3", "a\xE2\x82", "\xC0\xAF"}) {
    CHECK(has(refused(dir.path(), {"", text}), "no UTF-8"));
  }
  CHECK_FALSE(socket.next());
  send_mark(dir.path(), {"", "one\ntwo\x1B[2J"});
  CHECK(socket.next()->text == "one two [2J");
  send_mark(dir.path(), {"", std::string(kLongestMark, 'x')});
  CHECK(socket.next()->text.size() == kLongestMark);
}

TEST_CASE("a folder with a long path can be marked, too") {
  TempDir dir;
  const std::filesystem::path deep = dir / std::string(120, 'd') / std::string(120, 'e');
  std::filesystem::create_directories(deep);
  MarkSocket socket(deep);
  send_mark(deep, {"", "here"});
  CHECK(socket.next()->text == "here");
}
