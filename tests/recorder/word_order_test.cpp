// Word order and addresses: what decides them, and that it is remembered.

#include "recorder/link/word_order.hpp"

#include <bit>
#include <fstream>
#include <random>

#include "recorder/link/link_memory.hpp"
#include "recorder/link/modbus_link.hpp"
#include "schema/fields.hpp"
#include "schema/time.hpp"
#include "tests/recorder/modbus_server.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/golden.hpp"
#include "tests/support/temp_dir.hpp"

using namespace tacho;
using namespace tacho::recorder;
using namespace tacho::recorder::test;
using namespace std::chrono_literals;

namespace {

constexpr auto kTimeout = 3000ms;

ModbusLinkOptions options(std::uint16_t port) {
  ModbusLinkOptions o;
  o.host = "127.0.0.1";
  o.port = port;
  return o;
}

/// A robot at 127.0.0.1 with sensor values; `up`: how much larger its addresses are than documented.
void fill(ModbusServer& server, WordOrder order, int up = 0) {
  std::uint16_t first = 0;
  std::uint16_t second = 0;
  for (const auto& [address, value] :
       {std::pair{15, 24.0F}, {17, 52.3F}, {19, -1.1F}, {21, 53.3F}, {25, 24.1F}, {29, 875.0F}}) {
    wire::split_words(std::bit_cast<std::uint32_t>(value), order, first, second);
    server.set_register(address + up, first);
    server.set_register(address + up + 1, second);
  }
  const bool swapped = order == WordOrder::badc || order == WordOrder::dcba;
  for (int part = 0; part < 4; ++part) {
    const std::array<std::uint16_t, 4> ip{127, 0, 0, 1};
    const std::uint16_t value = ip[static_cast<std::size_t>(part)];
    server.set_register(70 + part + up, static_cast<std::uint16_t>(swapped ? value << 8 : value));
  }
}

double value_of(const PollResult& result, std::string_view name) {
  Sample sample;
  wire::decode_registers(result.body, WordOrder::cdab, {}, FieldSet().set(), sample);
  return sample.at(find_field(name)).real;
}

std::string moved(std::string image, int by) {
  image[1] = static_cast<char>(image[1] + by);
  return image;
}

/// An image as a robot with `order` at 192.168.192.5 would send it.
std::string image_of(WordOrder order, bool battery, bool address) {
  std::vector<std::uint16_t> words(100, 0);
  const auto put = [&](std::string_view name, float value) {
    const std::size_t at = field_at(find_field(name)).reg.address - 1u;
    wire::split_words(std::bit_cast<std::uint32_t>(value), order, words[at], words[at + 1]);
  };
  put("x", -3.162F);
  put("y", 12.25F);
  if (battery) {
    put("battery_temp", 24.0F);
    put("voltage", 52.347F);
    put("current", -1.1F);
    put("controller_temp", 53.346F);
    put("total_time", 875.0F);
  }
  if (address) {
    const bool swapped = order == WordOrder::badc || order == WordOrder::dcba;
    const std::array<std::uint16_t, 4> ip{192, 168, 192, 5};
    for (std::size_t i = 0; i < 4; ++i) {
      words[69 + i] = static_cast<std::uint16_t>(swapped ? ip[i] << 8 : ip[i]);
    }
  }
  std::string image;
  wire::append_words(image, {1, 100}, words);
  return image;
}

}  // namespace

TEST_CASE("the word order of an image is found by its values, and by the address it holds") {
  for (const WordOrder order : {WordOrder::cdab, WordOrder::abcd, WordOrder::badc, WordOrder::dcba}) {
    for (const bool address : {false, true}) {
      const WordOrderGuess guess = guess_word_order({image_of(order, true, address), "192.168.192.5", {}});
      INFO(guess.why);
      CHECK(guess.sure);
      CHECK(guess.order == order);
      CHECK(guess.address_matches == address);
    }
  }
}

TEST_CASE("a robot without any sensor value is left at the default, and says so") {
  const WordOrderGuess guess = guess_word_order({image_of(WordOrder::abcd, false, true), "192.168.192.5", {}});
  CHECK_FALSE(guess.sure);
  CHECK(guess.order == WordOrder::cdab);
  CHECK(guess.why.find("default") != std::string::npos);
}

TEST_CASE("the status answer decides the order, whatever else is plausible") {
  // Values that look like sensors in either order, so that only the other protocol can tell.
  std::vector<std::uint16_t> words(100, 0);
  const std::string status = R"({"voltage":52.3,"battery_temp":24.5,"odo":21773.9,"x":12.25,"controller_temp":53.3})";
  for (const WordOrder order : {WordOrder::cdab, WordOrder::abcd, WordOrder::badc, WordOrder::dcba}) {
    for (const auto& [name, value] :
         {std::pair{"voltage", 52.3F}, {"battery_temp", 24.5F}, {"odo", 21773.9F}, {"x", 12.25F}}) {
      const std::size_t at = field_at(find_field(name)).reg.address - 1u;
      wire::split_words(std::bit_cast<std::uint32_t>(value), order, words[at], words[at + 1]);
    }
    std::string image;
    wire::append_words(image, {1, 100}, words);
    const WordOrderGuess guess = guess_word_order({image, "10.0.0.9", status});
    INFO(guess.why);
    CHECK(guess.sure);
    CHECK(guess.placed);
    CHECK(guess.order == order);
    CHECK(guess.shift == 0);
    CHECK(guess.why.find("status answer") != std::string::npos);
  }
}

TEST_CASE(
    "high words alone, which another order shows one address off, are not enough for the status answer to decide") {
  std::vector<std::uint16_t> words(100, 0);
  for (const auto& [name, value] : {std::pair{"voltage", 52.3F}, {"battery_temp", 24.6F}, {"odo", 21773.9F}}) {
    const std::size_t at = field_at(find_field(name)).reg.address - 1u;
    wire::split_words(std::bit_cast<std::uint32_t>(value), WordOrder::cdab, words[at], words[at + 1]);
  }
  std::string image;
  wire::append_words(image, {1, 100}, words);
  // The robot moves: no value is close to what was told a moment ago.
  const std::string status = R"({"voltage":52.2,"battery_temp":24.7,"odo":21790.1})";
  const WordOrderGuess guess = guess_word_order({image, "10.0.0.9", status});
  CHECK(guess.why.find("status answer") == std::string::npos);
  CHECK(guess.shift == 0);
  CHECK(guess.order == WordOrder::cdab);  // by what is plausible
}

TEST_CASE("a status answer of another robot decides nothing") {
  const std::string other = R"({"voltage":24.1,"battery_temp":31.5,"odo":17.5,"x":-7.25,"controller_temp":40.3})";
  const WordOrderGuess guess = guess_word_order({image_of(WordOrder::cdab, true, true), "192.168.192.5", other});
  CHECK(guess.sure);
  CHECK(guess.why.find("status answer") == std::string::npos);
  CHECK_FALSE(guess_word_order({image_of(WordOrder::cdab, false, true), "192.168.192.5", other}).sure);
}

TEST_CASE("addresses that are one off are seen by the robot's address, and by the status answer") {
  const std::string image = image_of(WordOrder::cdab, true, true);
  const std::string status = R"({"voltage":52.347,"battery_temp":24.0,"x":-3.162,"y":12.25,"controller_temp":53.346})";
  for (const int by : {0, 1}) {  // what is called 2 here is documented as 1
    INFO(by);
    const WordOrderGuess by_address = guess_word_order({moved(image, by), "192.168.192.5", {}});
    const WordOrderGuess by_status = guess_word_order({moved(image, by), "10.0.0.9", status});
    CHECK(by_address.shift == -by);
    CHECK(by_status.shift == -by);
    CHECK(by_address.placed);
    CHECK(by_status.order == WordOrder::cdab);
    CHECK_FALSE(by_status.address_matches);
  }
}

TEST_CASE("the link reports a found word order once; a configured one is not looked for") {
  ModbusServer server([](const Asked&) { return 0; });
  fill(server, WordOrder::abcd);
  ModbusLinkOptions o = options(server.port());
  ModbusLink link(o);
  const PollResult first = link.poll(Source::registers, kTimeout);
  REQUIRE(first.word_order);
  CHECK(*first.word_order == WordOrder::abcd);
  REQUIRE(first.notes.size() == 1);
  CHECK(first.notes[0].kind == EventKind::word_order);
  CHECK(first.notes[0].new_value == "abcd");
  CHECK_FALSE(link.poll(Source::registers, kTimeout).word_order);
  o.word_order = WordOrder::cdab;
  ModbusLink told(o);
  link.close();  // the server takes one client at a time
  CHECK_FALSE(told.poll(Source::registers, kTimeout).word_order);
}

TEST_CASE("a robot whose addresses are not sent minus one is read again rightly before anything is kept") {
  ModbusServer server([](const Asked&) { return 0; });
  fill(server, WordOrder::cdab, 1);
  ModbusLink link(options(server.port()));
  const PollResult first = link.poll(Source::registers, kTimeout);
  REQUIRE(first.ok);
  CHECK(value_of(first, "voltage") == Approx(52.3));
  CHECK(link.shift() == 1);
  REQUIRE(first.notes.size() == 2);
  CHECK(first.notes[0].subject == "address shift");
  CHECK(first.notes[0].new_value == "1");
  CHECK(first.word_order == WordOrder::cdab);
  server.take();
  CHECK(link.poll(Source::inputs, kTimeout).ok);
  CHECK(server.take().at(0).first == 2);
}

TEST_CASE("inputs that are asked for first are asked for at the right addresses, and registers say what was found") {
  ModbusServer server([](const Asked&) { return 0; });
  fill(server, WordOrder::abcd, 1);
  ModbusLink link(options(server.port()));
  const PollResult inputs = link.poll(Source::inputs, kTimeout);
  REQUIRE(inputs.ok);
  REQUIRE(inputs.notes.size() == 1);
  CHECK(inputs.notes[0].subject == "address shift");
  for (const Asked& asked : server.take()) {
    CHECK((asked.function == 4 || asked.first == 2));
  }
  const PollResult registers = link.poll(Source::registers, kTimeout);
  CHECK(registers.word_order == WordOrder::abcd);
  REQUIRE(registers.notes.size() == 1);
  CHECK(registers.notes[0].new_value == "abcd");
}

TEST_CASE("inputs of a robot without registers are recorded as documented, those of one that is silent not at once") {
  ModbusServer refusing([](const Asked& a) { return a.function == 4 ? 1 : 0; });
  ModbusLink link(options(refusing.port()));
  CHECK(link.poll(Source::inputs, kTimeout).ok);
  ModbusServer silent([](const Asked& a) { return a.function == 4 ? -1 : 0; });
  ModbusLink other(options(silent.port()));
  CHECK(other.poll(Source::inputs, std::chrono::milliseconds(80)).cause == Cause::timeout);
  CHECK_FALSE(other.poll(Source::inputs, std::chrono::milliseconds(80)).ok);
  (void)other.poll(Source::inputs, std::chrono::milliseconds(80));
  CHECK(other.poll(Source::inputs, kTimeout).ok);
}

TEST_CASE("a restarted link asks at once as the last one had learned, and asks again after an hour") {
  const tacho::test::TempDir dir;
  const std::filesystem::path file = dir / "learned.json";
  ModbusServer server([](const Asked& a) { return a.function == 4 && a.holds(28) ? 2 : 0; });
  fill(server, WordOrder::abcd, 1);
  const auto link_of = [&](Micros relearn_us = 3'600'000'000) {
    ModbusLinkOptions o = options(server.port());
    o.memory = std::make_shared<LinkMemory>(file);
    o.relearn_us = relearn_us;
    return o;
  };
  {
    const ModbusLinkOptions o = link_of();
    ModbusLink link(o);
    CHECK(link.poll(Source::registers, kTimeout).partial);
    CHECK(o.memory->save().empty());
  }
  server.take();
  {
    ModbusLink link(link_of());
    CHECK(link.shift() == 1);
    const PollResult again = link.poll(Source::registers, kTimeout);
    REQUIRE(again.ok);
    CHECK(again.partial);  // said once per recording
    CHECK(again.detail.find("27-28: refused in an earlier recording") != std::string::npos);
    CHECK(again.word_order == WordOrder::abcd);
    const auto asked = server.take();
    CHECK(asked.size() == link.plan(Source::registers).ranges().size());
    CHECK(std::none_of(asked.begin(), asked.end(), [](const Asked& a) { return a.holds(28); }));
  }
  ModbusLink later(link_of(0));
  CHECK(later.poll(Source::registers, kTimeout).ok);
  const auto asked = server.take();
  CHECK(std::any_of(asked.begin(), asked.end(), [](const Asked& a) { return a.holds(28); }));
}

TEST_CASE("what is remembered gives way to what a robot shows now") {
  const auto memory = std::make_shared<LinkMemory>();
  ModbusServer server([](const Asked&) { return 0; });
  fill(server, WordOrder::cdab);
  ModbusLinkOptions o = options(server.port());
  o.memory = memory;
  LearnedRobot wrong;
  wrong.word_order = WordOrder::abcd;
  wrong.shift = 1;
  wrong.registers = {{{1, 5}}, {{6, 200}}, wall_now_us()};  // no plan at all
  const std::string name = "127.0.0.1:" + std::to_string(server.port()) + " unit 1";
  memory->learn(name, wrong);
  ModbusLink link(o);
  CHECK(link.plan(Source::registers).ranges() == wire::plan_ranges(false));
  const PollResult result = link.poll(Source::registers, kTimeout);
  REQUIRE(result.ok);
  CHECK(value_of(result, "voltage") == Approx(52.3));
  CHECK(result.word_order == WordOrder::cdab);
  CHECK(memory->recall(name).shift == 0);
  CHECK(memory->recall(name).word_order == WordOrder::cdab);
}

TEST_CASE("a remembered order is taken while the values do not decide, and says where it is from") {
  const auto memory = std::make_shared<LinkMemory>();
  ModbusServer server([](const Asked&) { return 0; });
  for (int address = 1; address <= 140; ++address) {
    server.set_register(address, 0);
  }
  LearnedRobot known;
  known.word_order = WordOrder::abcd;
  memory->learn("127.0.0.1:" + std::to_string(server.port()) + " unit 1", known);
  ModbusLinkOptions o = options(server.port());
  o.memory = memory;
  ModbusLink link(o);
  const PollResult result = link.poll(Source::registers, kTimeout);
  CHECK(result.word_order == WordOrder::abcd);
  REQUIRE(result.notes.size() == 1);
  CHECK(result.notes[0].detail.find("remembered") != std::string::npos);
}

TEST_CASE("a damaged memory is told, not believed, and replaced by what is learned anew") {
  const tacho::test::TempDir dir;
  const std::filesystem::path file = dir / "learned.json";
  {
    LinkMemory memory(file);
    CHECK(memory.problem().empty());  // none yet
    LearnedRobot robot;
    robot.word_order = WordOrder::badc;
    robot.inputs = {{{1, 80}}, {}, 17};
    memory.learn("a:502 unit 1", robot);
    CHECK(memory.save().empty());
    CHECK(LinkMemory(file).recall("a:502 unit 1") == robot);
    CHECK(LinkMemory(file).recall("b:502 unit 1") == LearnedRobot{});
  }
  const std::string good = tacho::test::read_file(file);
  for (const std::string& bad :
       {std::string(), good.substr(0, good.size() / 2), std::string("[]"), std::string(R"({"version":9,"robots":{}})"),
        std::string(R"({"version":1,"robots":{"a":{"shift":"x"}}})"), std::string("\xFF\xFE")}) {
    std::ofstream(file, std::ios::binary | std::ios::trunc) << bad;
    LinkMemory memory(file);
    INFO(bad);
    CHECK(memory.problem().find("learned.json") != std::string::npos);
    CHECK(memory.recall("a:502 unit 1") == LearnedRobot{});
  }
  LinkMemory memory(file);
  LearnedRobot anew;
  anew.shift = 1;
  memory.learn("a:502 unit 1", anew);
  CHECK(memory.save().empty());
  CHECK(LinkMemory(file).problem().empty());
}

TEST_CASE("law: whatever ranges a memory holds, a plan takes them only when nothing documented is lost") {
  std::mt19937 random(3);
  const auto between = [&](int a, int b) { return std::uniform_int_distribution<int>(a, b)(random); };
  int taken = 0;
  for (int i = 0; i < 20'000; ++i) {
    const bool discrete = i % 2 == 1;
    std::vector<wire::Range> ranges = i % 3 == 0 ? wire::documented_runs(discrete) : wire::plan_ranges(discrete);
    std::vector<wire::Range> illegal;
    for (int k = between(0, 2); k > 0; --k) {
      auto& list = between(0, 1) == 0 ? ranges : illegal;
      list.push_back({static_cast<std::uint16_t>(between(0, 150)), static_cast<std::uint16_t>(between(0, 130))});
    }
    if (between(0, 3) == 0 && !ranges.empty()) {
      illegal.push_back(ranges.back());
      ranges.pop_back();
    }
    RegisterPlan plan(discrete);
    const bool ok = plan.restore(ranges, illegal);
    taken += ok ? 1 : 0;
    CHECK(plan.learned() == ok);
    CHECK(plan.ranges() == (ok ? ranges : wire::plan_ranges(discrete)));
    ranges.insert(ranges.end(), illegal.begin(), illegal.end());
    for (const wire::Range run : wire::documented_runs(discrete)) {
      for (int a = run.first; ok && a < run.first + run.count; ++a) {
        const auto holds = [a](wire::Range r) { return a >= r.first && a < r.first + r.count; };
        REQUIRE(std::count_if(ranges.begin(), ranges.end(), holds) == 1);
      }
    }
  }
  CHECK(taken > 100);
}

TEST_CASE("a failing disk is told once and costs nothing but the memory") {
  LinkMemory memory("/proc/no/such/folder/learned.json");
  LearnedRobot robot;
  robot.shift = 1;
  memory.learn("a", robot);
  CHECK(memory.save().find("learned again after a restart") != std::string::npos);
  CHECK(memory.save().empty());
}
