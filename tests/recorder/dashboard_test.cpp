// What a terminal shows while recording: nothing wider, nothing higher than the terminal, and trouble first.

#include "recorder/dashboard.hpp"

#include <algorithm>

#include "tests/support/catch.hpp"

using namespace tacho;
using namespace tacho::recorder;

namespace {

Snapshot site(std::size_t robots, std::size_t down) {
  Snapshot out;
  out.now_us = 1'767'225'600'000'000;
  for (std::size_t i = 1; i <= robots; ++i) {
    const std::string name = "amr-" + std::to_string(i);
    const bool up = i <= robots - down;
    out.links.push_back({name, Protocol::status_port, up});
    out.links.push_back({name, Protocol::modbus, true});
    StreamNow stream;
    stream.robot = name;
    stream.period_us = 1'000'000;
    stream.stored = 1000 + i;
    stream.missed[static_cast<std::size_t>(Cause::timeout)] = up ? 0 : 7;
    stream.last_round_trip_us = 4'200;
    stream.last_answer_us = out.now_us - 400'000;
    out.streams.push_back(stream);
    out.clock_offset_us[name] = -120'000;
  }
  return out;
}

bool has(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

}  // namespace

TEST_CASE("on a wide screen every robot has a line with all there is to know") {
  const auto lines = dashboard(site(3, 1), {120, 24});
  REQUIRE(lines.size() == 5);
  CHECK(has(lines[0], "robots 2/3"));
  CHECK(has(lines[1], "last answer"));
  for (const char* part : {"amr-1", "up", "0.4 s", "1001", "4.2 ms", "-0.12 s"}) {
    CHECK(has(lines[2], part));
  }
  CHECK(has(lines[4], "DOWN"));
  CHECK(has(lines[4], "timeout"));
}

TEST_CASE("no line is wider and no block higher than the screen, whatever its size") {
  const Snapshot snapshot = site(40, 5);
  for (std::size_t columns = 1; columns <= 130; ++columns) {
    for (const std::size_t rows : {1U, 2U, 4U, 5U, 10U, 50U}) {
      const auto lines = dashboard(snapshot, {columns, rows});
      CHECK(lines.size() <= std::max<std::size_t>(1, rows - 1));
      CHECK(std::all_of(lines.begin(), lines.end(),
                        [&](const std::string& line) { return shown_width(line) <= columns; }));
    }
  }
}

TEST_CASE("on a narrow screen the links stay and the details go") {
  const auto lines = dashboard(site(2, 1), {32, 24});
  CHECK(has(lines[1], "status"));
  CHECK(has(lines[1], "modbus"));
  CHECK_FALSE(has(lines[1], "slowest"));
  CHECK(has(lines[3], "DOWN"));
}

TEST_CASE("when there are more robots than lines those with trouble come first and the rest is counted") {
  const auto lines = dashboard(site(40, 2), {100, 10});
  REQUIRE(lines.size() == 9);
  CHECK(has(lines[2], "amr-39"));
  CHECK(has(lines[3], "amr-40"));
  CHECK(has(lines[4], "amr-1 "));
  CHECK(lines[8] == "and 34 more, all connected");
  CHECK(dashboard(site(40, 30), {100, 10})[8] == "and 34 more, 24 of them not connected");
}

TEST_CASE("names are cut by what a terminal shows, and cannot move its cursor") {
  CHECK(shown_width("仓库-1") == 6);
  CHECK(fitted("仓库-1", 5) == "仓库-");
  CHECK(fitted("仓库", 3) == "仓 ");
  CHECK(fitted("a\x1b[2Jb", 6) == "a?[2Jb");
  CHECK(fitted("ab", 4) == "ab  ");
  CHECK(shown_width("\xff\xe4") == 2);  // no UTF-8
}

TEST_CASE("a stream that is no longer asked is not shown") {
  Snapshot snapshot = site(2, 0);
  snapshot.streams[1].period_us = 0;
  snapshot.links.resize(2);
  CHECK(dashboard(snapshot, {100, 24}).size() == 3);
}
