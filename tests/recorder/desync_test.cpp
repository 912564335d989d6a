// Very many polls against answers that are late, doubled, of another request or mutilated: not one is taken for
// another. TACHO_LONG=1: a million.

#include <fmt/format.h>

#include <cstdlib>

#include "recorder/link/modbus_link.hpp"
#include "recorder/link/tcp_link.hpp"
#include "schema/wire/requests.hpp"
#include "tests/recorder/echo_robot.hpp"
#include "tests/support/catch.hpp"

using namespace tacho;
using namespace tacho::recorder;
using namespace tacho::recorder::test;
using namespace std::chrono_literals;

namespace {

constexpr auto kTimeout = 3ms;  // late answers take 4
constexpr double kLies = 0.1;

int polls() { return std::getenv("TACHO_LONG") != nullptr ? 500'000 : 10'000; }

struct Tally {
  int good = 0;
  int wrong = 0;
  int missed = 0;
};

void report(const char* what, const Tally& tally, std::uint64_t lies) {
  fmt::print("{}: {} polls, {} right, {} wrong, {} missed; {} answers were faulty\n", what,
             tally.good + tally.wrong + tally.missed, tally.good, tally.wrong, tally.missed, lies);
  CHECK(tally.wrong == 0);
  CHECK(tally.good + tally.missed == polls());
  CHECK(tally.good > polls() / 20);  // 90 % where the machine has nothing else to do
  CHECK(lies > static_cast<std::uint64_t>(polls() / 30));
}

/// True when every range of the image is the answer to a request of this sweep for that range.
bool right_image(std::string_view image, std::uint64_t before, std::uint64_t last) {
  const auto word = [&](std::size_t at) {
    return static_cast<std::uint16_t>(static_cast<unsigned char>(image[at]) << 8 |
                                      static_cast<unsigned char>(image[at + 1]));
  };
  std::uint64_t id = before;
  while (!image.empty()) {
    const unsigned first = word(0);
    const unsigned count = word(2);
    const auto since = static_cast<std::uint16_t>(word(4) - echo_word(id, first));  // requests since the range before
    if (since == 0 || id + since > last) {
      return false;
    }
    id += since;
    for (unsigned k = 0; k < count; ++k) {
      if (word(4 + 2 * std::size_t{k}) != echo_word(id, first + k)) {
        return false;
      }
    }
    image.remove_prefix(4 + 2 * std::size_t{count});
  }
  return true;
}

}  // namespace

TEST_CASE("no status answer is ever taken for the answer to another request") {
  EchoRobot robot(sim::Port::status,
                  {"late", "slow", "duplicate", "duplicate_soon", "duplicate_late", "previous_first",
                   "previous_instead", "one_behind", "wrong_sequence", "wrong_type", "cut_body", "garbage_before",
                   "garbage_behind", "random_bytes", "unasked", "reset", "half_close"},
                  kLies);
  TcpLink link({"127.0.0.1", robot.port(), 1, wire::status_request_body({}), nullptr});
  Tally tally;
  for (int i = 0; i < polls(); ++i) {
    const PollResult result = link.poll(i % 4 == 3 ? Source::io : Source::status, kTimeout);
    if (!result.ok) {
      ++tally.missed;
    } else if (result.body == echo_body(robot.last())) {  // of the last request that arrived, which is this poll's
      ++tally.good;
    } else {
      ++tally.wrong;
    }
  }
  CHECK(link.echoes_sequence());
  report("status", tally, robot.lies());
}

TEST_CASE("no register is ever taken from the answer to another request") {
  EchoRobot robot(sim::Port::modbus, {"late",           "slow",           "duplicate",        "duplicate_soon",
                                      "duplicate_late", "previous_first", "previous_instead", "one_behind",
                                      "wrong_sequence", "wrong_type",     "wrong_unit",       "wrong_byte_count",
                                      "short_length",   "long_length",    "cut_body",         "garbage_before",
                                      "garbage_behind", "random_bytes",   "exception_6",      "reset",
                                      "half_close"},
                  kLies);
  ModbusLinkOptions options;
  options.host = "127.0.0.1";
  options.port = robot.port();
  options.word_order = WordOrder::cdab;
  ModbusLink link(options);
  Tally tally;
  for (int i = 0; i < polls(); ++i) {
    const std::uint64_t before = robot.last();
    const PollResult result = link.poll(Source::registers, kTimeout);
    ++(!result.ok ? tally.missed : right_image(result.body, before, robot.last()) ? tally.good : tally.wrong);
  }
  report("registers", tally, robot.lies());
}
