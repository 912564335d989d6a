// The Modbus link against libmodbus' server.

#include "recorder/link/modbus_link.hpp"
#include "schema/fields.hpp"
#include "tests/recorder/modbus_server.hpp"
#include "tests/support/catch.hpp"

using namespace tacho;
using namespace tacho::recorder;
using namespace tacho::recorder::test;
using namespace std::chrono_literals;

namespace {

constexpr auto kTimeout = 3000ms;
constexpr auto kShort = 80ms;

ModbusLinkOptions options(std::uint16_t port) {
  ModbusLinkOptions o;
  o.host = "127.0.0.1";
  o.port = port;
  o.word_order = WordOrder::cdab;
  return o;
}

/// Of a robot that an earlier link has looked at: inputs are asked for at once.
ModbusLinkOptions known(std::uint16_t port) {
  ModbusLinkOptions o = options(port);
  o.memory = std::make_shared<LinkMemory>();
  LearnedRobot robot;
  robot.word_order = WordOrder::cdab;
  o.memory->learn("127.0.0.1:" + std::to_string(port) + " unit 1", robot);
  return o;
}

bool in_gap(bool discrete, int address) {
  const auto runs = wire::documented_runs(discrete);
  return std::none_of(runs.begin(), runs.end(),
                      [&](wire::Range r) { return address >= r.first && address < r.first + r.count; });
}

/// Refuses requests that touch an undocumented address, as a strict server does.
int strict(const Asked& asked) {
  for (int a = asked.first; a < asked.first + asked.count; ++a) {
    if (in_gap(asked.function == 2, a)) {
      return 2;
    }
  }
  return 0;
}

FieldSet fields_of(const PollResult& result, Source source) {
  Sample sample;
  Gates gates;
  sample.meta.source = source;
  if (source == Source::inputs) {
    wire::decode_inputs(result.body, FieldSet().set(), gates, sample);
  } else {
    wire::decode_registers(result.body, WordOrder::cdab, gates, FieldSet().set(), sample);
  }
  CHECK(sample.decodable);
  return sample.seen();
}

FieldSet all_fields(bool discrete) {
  FieldSet set;
  for (std::size_t i = 0; i < kFieldCount; ++i) {
    set[i] = kFields[i].reg.present() && kFields[i].reg.discrete == discrete;
  }
  return set;
}

std::size_t value_words(FieldIndex f) { return field_at(f).reg.words(); }

}  // namespace

TEST_CASE("the whole table is read in as few requests as planned, with functions 4 and 2 only") {
  ModbusServer server([](const Asked&) { return 0; });
  ModbusLink link(options(server.port()));
  const PollResult registers = link.poll(Source::registers, kTimeout);
  REQUIRE(registers.ok);
  CHECK_FALSE(registers.partial);
  const PollResult inputs = link.poll(Source::inputs, kTimeout);
  REQUIRE(inputs.ok);
  CHECK_FALSE(inputs.partial);
  CHECK((fields_of(registers, Source::registers) & all_fields(false)) == all_fields(false));
  CHECK((fields_of(inputs, Source::inputs) & all_fields(true)) == all_fields(true));
  const auto asked = server.take();
  REQUIRE(asked.size() == 3);
  CHECK(asked[0].function == 4);
  CHECK(asked[0].first == 1);
  CHECK(asked[0].count == 100);
  CHECK(asked[2].function == 2);
  CHECK(server.connections() == 1);
}

TEST_CASE("a documented address is the sent address plus one") {
  ModbusServer server([](const Asked&) { return 0; });
  ModbusLink link(options(server.port()));
  const PollResult result = link.poll(Source::registers, kTimeout);
  REQUIRE(result.ok);
  Sample sample;
  wire::decode_registers(result.body, WordOrder::cdab, {}, FieldSet().set(), sample);
  CHECK(sample.at(field("clock_second")).integer == 131);  // the server puts its own address into every register
}

TEST_CASE("a server that refuses gaps is read by the documented runs, in the same sweep and from then on") {
  ModbusServer server(strict);
  ModbusLink link(options(server.port()));
  for (const Source source : {Source::registers, Source::inputs}) {
    const bool discrete = source == Source::inputs;
    const PollResult first = link.poll(source, kTimeout);
    REQUIRE(first.ok);
    CHECK_FALSE(first.partial);
    CHECK((fields_of(first, source) & all_fields(discrete)) == all_fields(discrete));
    server.take();
    const PollResult second = link.poll(source, kTimeout);
    REQUIRE(second.ok);
    CHECK(second.body == first.body);
    const auto asked = server.take();
    CHECK(asked.size() == wire::documented_runs(discrete).size());
    CHECK(std::all_of(asked.begin(), asked.end(), [](const Asked& a) { return strict(a) == 0; }));
  }
  CHECK(server.connections() == 1);
}

TEST_CASE("one illegal address is found by at most eight extra requests and costs its own value only, once") {
  for (const Source source : {Source::registers, Source::inputs}) {
    const bool discrete = source == Source::inputs;
    for (FieldIndex f = 0; f < kFieldCount; ++f) {
      const RegisterSource reg = field_at(f).reg;
      if (!reg.present() || reg.discrete != discrete) {
        continue;
      }
      const int bad = reg.address + static_cast<int>(value_words(f)) - 1;
      RegisterPlan plan(discrete);
      std::vector<wire::Range> read;
      int asked = 0;
      const auto ask = [&](wire::Range r) {
        ++asked;
        for (int a = r.first; a < r.first + r.count; ++a) {
          if (a == bad || in_gap(discrete, a)) {
            return Reply::bad_address;
          }
        }
        read.push_back(r);
        return Reply::ok;
      };
      INFO("address " << bad);
      const int planned = static_cast<int>(plan.ranges().size());
      const int runs = static_cast<int>(wire::documented_runs(discrete).size());
      const auto news = plan.sweep(ask);
      CHECK(asked <= planned + runs + RegisterPlan::kMaxExtraRequests);
      REQUIRE(news.size() == 1);
      CHECK(news[0] == wire::Range{reg.address, reg.words()});
      int missing = 0;
      for (const wire::Range run : wire::documented_runs(discrete)) {
        for (int a = run.first; a < run.first + run.count; ++a) {
          missing += std::none_of(read.begin(), read.end(),
                                  [a](wire::Range r) { return a >= r.first && a < r.first + r.count; });
        }
      }
      CHECK(missing == reg.words());
      asked = 0;
      CHECK(plan.sweep(ask).empty());
      CHECK(asked == static_cast<int>(plan.ranges().size()));
      CHECK(asked <= runs + 1);
    }
  }
}

TEST_CASE("what was isolated is said once as a partial sweep and not asked again") {
  ModbusServer server([](const Asked& a) { return a.function == 4 && a.holds(27) ? 2 : strict(a); });
  ModbusLink link(options(server.port()));
  const PollResult first = link.poll(Source::registers, kTimeout);
  REQUIRE(first.ok);
  CHECK(first.partial);
  CHECK(first.cause == Cause::modbus_exception);
  INFO(first.detail);
  CHECK(first.detail.find("[3x]27-28") != std::string::npos);
  CHECK(first.detail.find("exception 2") != std::string::npos);
  CHECK(first.detail.find("not asked again") != std::string::npos);
  server.take();
  const PollResult second = link.poll(Source::registers, kTimeout);
  REQUIRE(second.ok);
  CHECK_FALSE(second.partial);
  const FieldSet seen = fields_of(second, Source::registers);
  CHECK_FALSE(seen.test(field("odo")));
  CHECK(seen.test(field("total_time")));
  CHECK(seen.test(field("controller_voltage")));
  const auto asked = server.take();
  CHECK(std::none_of(asked.begin(), asked.end(), [](const Asked& a) { return a.holds(27) || a.holds(28); }));
}

TEST_CASE("a refused address is asked for again after a while, as robots get updated") {
  std::atomic<bool> updated{false};
  ModbusServer server([&](const Asked& a) { return !updated && a.function == 4 && a.holds(135) ? 2 : 0; });
  ModbusLinkOptions o = options(server.port());
  o.relearn_us = 0;
  ModbusLink link(o);
  CHECK(link.poll(Source::registers, kTimeout).partial);
  CHECK_FALSE(link.poll(Source::registers, kTimeout).partial);  // known by now: no news, no second gap
  updated = true;
  const PollResult after = link.poll(Source::registers, kTimeout);
  REQUIRE(after.ok);
  CHECK(fields_of(after, Source::registers).test(field("battery_cycle")));
}

TEST_CASE("a server that allows short requests only is read in halves and loses nothing") {
  for (const int limit : {40, 20, 12}) {
    for (const int exception : {2, 3}) {
      INFO("limit " << limit << " exception " << exception);
      ModbusServer server([&](const Asked& a) { return a.count > limit ? exception : 0; });
      ModbusLink link(options(server.port()));
      FieldSet seen;
      for (int i = 0; i < 6; ++i) {
        const PollResult result = link.poll(Source::registers, kTimeout);
        REQUIRE(result.ok);
        seen = fields_of(result, Source::registers) & all_fields(false);
      }
      CHECK(seen == all_fields(false));
      CHECK(link.plan(Source::registers).illegal().empty());
    }
  }
}

TEST_CASE("a server that refuses everything teaches nothing") {
  std::atomic<bool> starting{true};
  ModbusServer server([&](const Asked&) { return starting ? 2 : 0; });
  ModbusLink link(options(server.port()));
  const PollResult refused = link.poll(Source::registers, kTimeout);
  CHECK_FALSE(refused.ok);
  CHECK(refused.cause == Cause::modbus_exception);
  CHECK(link.connected());
  starting = false;
  const PollResult fine = link.poll(Source::registers, kTimeout);
  REQUIRE(fine.ok);
  CHECK_FALSE(fine.partial);
}

TEST_CASE("exceptions are told in words and keep the connection") {
  ModbusServer server([](const Asked& a) { return a.function == 2 ? 1 : a.first > 100 ? 6 : 0; });
  ModbusLink link(options(server.port()));
  const PollResult inputs = link.poll(Source::inputs, kTimeout);
  CHECK_FALSE(inputs.ok);
  CHECK(inputs.cause == Cause::modbus_exception);
  CHECK(inputs.detail.find("illegal function") != std::string::npos);
  const PollResult registers = link.poll(Source::registers, kTimeout);
  REQUIRE(registers.ok);
  CHECK(registers.partial);
  CHECK(registers.detail.find("device busy") != std::string::npos);
  CHECK(registers.detail.find("120-131,135-136,139-140") != std::string::npos);
  CHECK(server.connections() == 1);
}

TEST_CASE("silence is a timeout that names the unit id, closes the connection, and heals") {
  std::atomic<bool> silent{true};
  ModbusServer server([&](const Asked&) { return silent ? -1 : 0; });
  ModbusLink link(options(server.port()));
  const PollResult result = link.poll(Source::registers, kShort);
  CHECK_FALSE(result.ok);
  CHECK(result.cause == Cause::timeout);
  CHECK(result.detail.find("unit 1") != std::string::npos);
  CHECK(result.detail.find("modbusSlaveId") != std::string::npos);
  CHECK_FALSE(link.connected());
  silent = false;
  CHECK(link.poll(Source::registers, kTimeout).ok);
  CHECK(server.connections() == 2);
}

TEST_CASE("a range that is never answered is named, left out after three sweeps, and asked for again after a while") {
  std::atomic<bool> silent{true};
  for (const int address : {2, 135}) {  // of the first and of the last range
    silent = true;
    ModbusServer server([&](const Asked& a) {
      const int refused = strict(a);
      return refused == 0 && silent && a.function == 4 && a.holds(address) ? -1 : refused;
    });
    ModbusLinkOptions o = options(server.port());
    o.relearn_us = 3'000'000;
    ModbusLink link(o);
    PollResult result;
    int sweeps = 0;
    for (; sweeps < 10 && result.detail.find("not asked again") == std::string::npos; ++sweeps) {
      result = link.poll(Source::registers, 150ms);
    }
    INFO(address << ": " << result.detail);
    CHECK(sweeps <= 4);  // when it is asked first, it takes one to ask it last
    CHECK(result.ok);
    CHECK(result.partial);
    CHECK(result.cause == Cause::timeout);
    CHECK(result.detail.find("no answer at [3x]") != std::string::npos);
    for (int i = 0; i < 5; ++i) {
      result = link.poll(Source::registers, kTimeout);
      REQUIRE(result.ok);
      CHECK_FALSE(result.partial);
      CHECK(link.connected());
    }
    CHECK(link.poll(Source::inputs, kTimeout).ok);
    silent = false;
    std::this_thread::sleep_for(3'000ms);
    result = link.poll(Source::registers, kTimeout);
    CHECK(fields_of(result, Source::registers) == all_fields(false));
  }
}

TEST_CASE("silence inside a run of which something else is refused costs its own piece only") {
  const wire::Range run = wire::documented_runs(false).front();
  const int refused = run.first + run.count - 1;
  for (const int quiet : {run.first + 1, run.first + run.count / 2 - 2}) {
    std::atomic<int> waits{0};
    ModbusServer server([&](const Asked& a) {
      const int code = a.function == 4 && a.holds(refused) ? 2 : strict(a);
      waits += code == 0 && a.function == 4 && a.holds(quiet) ? 1 : 0;
      return code == 0 && a.function == 4 && a.holds(quiet) ? -1 : code;
    });
    ModbusLink link(options(server.port()));
    PollResult result;
    for (int sweeps = 0; sweeps < 16; ++sweeps) {
      result = link.poll(Source::registers, 150ms);
    }
    INFO(quiet << ": " << result.detail);
    waits = 0;
    result = link.poll(Source::registers, kTimeout);
    CHECK(result.ok);
    CHECK(waits == 0);
    CHECK(link.connected());
    CHECK(fields_of(result, Source::registers).count() > all_fields(false).count() / 2);
    CHECK(RegisterPlan(false).restore(link.plan(Source::registers).ranges(), link.plan(Source::registers).illegal()));
  }
}

TEST_CASE("answers that are slow all together leave no range out") {
  ModbusServer server([](const Asked& a) {
    std::this_thread::sleep_for(60ms);
    return strict(a);
  });
  ModbusLink link(options(server.port()));
  for (int i = 0; i < 6; ++i) {
    (void)link.poll(Source::registers, 150ms);  // never enough for the whole sweep
  }
  CHECK(fields_of(link.poll(Source::registers, kTimeout), Source::registers) == all_fields(false));
}

TEST_CASE("a sweep that dies half-way keeps what it has read and says what is missing") {
  std::atomic<int> mode{-1};
  ModbusServer server([&](const Asked& a) { return a.first > 100 ? mode.load() : 0; });
  ModbusLink link(options(server.port()));
  const PollResult silent = link.poll(Source::registers, 200ms);
  REQUIRE(silent.ok);
  CHECK(silent.partial);
  CHECK(silent.cause == Cause::timeout);
  CHECK_FALSE(link.connected());
  CHECK(fields_of(silent, Source::registers).test(field("x")));
  CHECK_FALSE(fields_of(silent, Source::registers).test(field("clock_year")));
  mode = -2;
  const PollResult closed = link.poll(Source::registers, kTimeout);
  REQUIRE(closed.ok);
  CHECK(closed.cause == Cause::closed);
  mode = 0;
  CHECK_FALSE(link.poll(Source::registers, kTimeout).partial);
}

TEST_CASE("answers that do not fit their request are gaps with words, and end the connection") {
  struct Lie {
    const char* what;
    std::size_t at;
    char value;
    Cause cause;
    const char* words;
  };
  for (const Lie& lie : {Lie{"transaction", 0, 0x55, Cause::wrong_sequence, "transaction"},
                         {"protocol", 2, 1, Cause::malformed, "protocol"},
                         {"length", 4, 0x40, Cause::malformed, "long"},
                         {"unit", 6, 9, Cause::malformed, "unit 9"},
                         {"function", 7, 4, Cause::malformed, "function 4"},
                         {"byte count", 8, 3, Cause::malformed, "asked for"}}) {
    TinyServer server([&](Peer& peer, int) {
      const std::string asked = peer.read(12);
      std::string bytes = asked.substr(0, 4) + std::string("\0\x0D\x01\x02\x0A", 5) + std::string(10, '\x11');
      bytes[lie.at] = lie.value;
      peer.write(bytes);
      peer.wait_closed();
    });
    ModbusLink link(known(server.port()));
    const PollResult result = link.poll(Source::inputs, kTimeout);
    INFO(lie.what << ": " << result.detail);
    CHECK_FALSE(result.ok);
    CHECK(result.body.empty());
    CHECK(result.cause == lie.cause);
    CHECK(result.detail.find(lie.words) != std::string::npos);
    CHECK_FALSE(link.connected());
  }
}

TEST_CASE("a second answer behind the first ends the connection, not the answer") {
  TinyServer server([&](Peer& peer, int) {
    const std::string asked = peer.read(12);
    const std::string bytes = asked.substr(0, 4) + std::string("\0\x0D\x01\x02\x0A", 5) + std::string(10, '\x11');
    peer.write(bytes + bytes);
    peer.wait_closed();
  });
  ModbusLink link(known(server.port()));
  for (int i = 0; i < 2; ++i) {
    const PollResult result = link.poll(Source::inputs, kTimeout);
    CHECK(result.ok);
    CHECK_FALSE(result.partial);
    CHECK_FALSE(link.connected());
  }
  CHECK(server.connections() == 2);
}

TEST_CASE("a restarted server is found again") {
  auto server = std::make_unique<ModbusServer>([](const Asked&) { return 0; });
  const std::uint16_t port = server->port();
  ModbusLink link(options(port));
  REQUIRE(link.poll(Source::inputs, kTimeout).ok);
  server.reset();
  const PollResult gone = link.poll(Source::inputs, kTimeout);
  CHECK_FALSE(gone.ok);
  CHECK(gone.cause == Cause::connect_refused);
  server = std::make_unique<ModbusServer>([](const Asked&) { return 0; }, port);
  CHECK(link.poll(Source::inputs, kTimeout).ok);
}

TEST_CASE("answers that are not Modbus are malformed, and interrupting ends a wait") {
  TinyServer talker([](Peer& peer, int) {
    peer.read(12);
    peer.write("HTTP/1.1 400 Bad Request\r\n\r\n");
    peer.wait_closed();
  });
  ModbusLink confused(options(talker.port()));
  const PollResult malformed = confused.poll(Source::registers, 300ms);
  CHECK_FALSE(malformed.ok);
  CHECK_FALSE(confused.connected());

  ModbusServer silent([](const Asked&) { return -1; });
  ModbusLink link(options(silent.port()));
  std::thread other([&] {
    while (silent.connections() == 0) {
      std::this_thread::sleep_for(1ms);
    }
    link.interrupt();
  });
  const PollResult result = link.poll(Source::registers, 30s);
  other.join();
  CHECK(result.cause == Cause::shutdown);
}
