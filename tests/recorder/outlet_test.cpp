// What is printed while nobody reads.

#include "recorder/outlet.hpp"

#include "recorder/console.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <thread>

#include "tests/support/catch.hpp"

using namespace tacho::recorder;
using namespace std::chrono_literals;

namespace {

struct Pipe {
  std::array<int, 2> ends{};
  Pipe() { REQUIRE(::pipe2(ends.data(), O_CLOEXEC) == 0); }
  ~Pipe() {
    close_reader();
    ::close(ends[1]);
  }
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;
  void close_reader() {
    if (ends[0] >= 0) {
      ::close(std::exchange(ends[0], -1));
    }
  }
  std::string read(std::size_t size) const {
    std::string out(size, 0);
    std::size_t have = 0;
    while (have < size) {
      const ssize_t n = ::read(ends[0], out.data() + have, size - have);
      REQUIRE(n > 0);
      have += static_cast<std::size_t>(n);
    }
    return out;
  }
};

}  // namespace

TEST_CASE("what is put is written in order") {
  Pipe pipe;
  {
    Outlet outlet(pipe.ends[1]);
    CHECK(outlet.put("one\n"));
    CHECK(outlet.put("two\n"));
  }
  CHECK(pipe.read(8) == "one\ntwo\n");
}

TEST_CASE("nobody waits for a reader that has stopped, and one that reads again gets what fitted, in order") {
  Pipe pipe;
  Outlet outlet(pipe.ends[1]);
  const std::string line(999, 'x');
  std::size_t taken = 0;
  while (taken < 2000 && outlet.put(line + "\n")) {
    ++taken;
  }
  CHECK(taken * 1000 >= Outlet::kMostBytes - 1000);  // and what the pipe holds
  CHECK(taken < 2000);
  CHECK(outlet.waiting() > 0);
  outlet.flush(10ms);  // returns
  CHECK(pipe.read(taken * 1000).find(line + "\n" + line) == 0);
  outlet.flush(5s);
  CHECK(outlet.waiting() == 0);
  CHECK(outlet.put("again"));
  CHECK(pipe.read(5) == "again");
}

TEST_CASE("a descriptor that somebody has made non-blocking loses nothing") {
  Pipe pipe;
  ::fcntl(pipe.ends[1], F_SETFL, O_NONBLOCK);
  Outlet outlet(pipe.ends[1]);
  CHECK(outlet.put(std::string(200'000, 'x')));
  std::this_thread::sleep_for(20ms);
  CHECK(pipe.read(200'000) == std::string(200'000, 'x'));
}

TEST_CASE("the end waits a second for a reader that has stopped, and no longer") {
  Pipe pipe;
  std::size_t put = 0;
  const auto before = std::chrono::steady_clock::now();
  {
    Outlet outlet(pipe.ends[1]);
    while (outlet.put(std::string(1000, 'x'))) {
      ++put;
    }
  }
  CHECK(std::chrono::steady_clock::now() - before >= 900ms);
  CHECK(pipe.read(put * 1000).size() == put * 1000);  // so that nobody writes any more when the pipe goes
}

TEST_CASE("messages that nobody reads for a while are not crowded out by the dashboard, which is back when they are") {
  constexpr int kMessages = 2000;
  Pipe pipe;
  Snapshot site;
  for (int i = 0; i < 30; ++i) {
    site.links.push_back({"robot-" + std::to_string(i), tacho::Protocol::status_port, true});
    site.streams.emplace_back().robot = site.links.back().robot;
  }
  std::string seen;
  const auto read_until = [&](const std::string& text) {
    std::array<char, 65536> buffer;  // uninitialised on purpose: written by read
    for (ssize_t n = 1; n > 0 && seen.find(text) == std::string::npos;) {
      n = ::read(pipe.ends[0], buffer.data(), buffer.size());
      seen.append(buffer.data(), static_cast<std::size_t>(std::max<ssize_t>(n, 0)));
    }
  };
  {
    Console console(true, pipe.ends[1]);
    console.status(site);
    for (int i = 0; i < kMessages; ++i) {
      console.message("message " + std::to_string(i) + ".");
    }
    read_until("message " + std::to_string(kMessages - 1) + ".");
    while (seen.find("robot-0") != std::string::npos) {
      seen.erase(0, seen.rfind("robot-0") + 1);
    }
    CHECK(seen.find("message 1000.") != std::string::npos);  // no dashboard among the later ones
    CHECK(seen.find("not read in time") == std::string::npos);
    seen.clear();
    console.flush();
    console.status(site);
    read_until("robot-0");
    CHECK(seen.find("\x1b[?25l") != std::string::npos);
  }
  read_until("\x1b[?25h");
  CHECK(seen.ends_with("\x1b[?25h"));
}
