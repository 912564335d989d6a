// The Modbus TCP codec against the bytes of the standard, and against libmodbus as the other side.

#include "recorder/link/mbap.hpp"

#include <modbus/modbus.h>
#include <sys/socket.h>
#include <unistd.h>

#include <random>

#include "tests/support/catch.hpp"

using namespace tacho::recorder::mbap;
using namespace std::string_literals;

namespace {

const Request kTwo{0x1234, 1, Function::input_registers, 14, 2};
const std::string kGood = "\x12\x34\0\0\0\x07\x01\x04\x04\x41\xC8\0\0"s;

std::string with(std::size_t at, char value) {
  std::string bytes = kGood;
  bytes[at] = value;
  return bytes;
}

/// What libmodbus answers to the bytes of one request.
std::string libmodbus_answer(const Request& request) {
  std::array<int, 2> ends{};
  REQUIRE(::socketpair(AF_UNIX, SOCK_STREAM, 0, ends.data()) == 0);
  const std::unique_ptr<modbus_t, void (*)(modbus_t*)> context(modbus_new_tcp("127.0.0.1", 502), modbus_free);
  const std::unique_ptr<modbus_mapping_t, void (*)(modbus_mapping_t*)> mapping(modbus_mapping_new(0, 80, 0, 140),
                                                                               modbus_mapping_free);
  for (int i = 0; i < 140; ++i) {
    mapping->tab_input_registers[i] = static_cast<std::uint16_t>(1000 + i);
  }
  for (int i = 0; i < 80; ++i) {
    mapping->tab_input_bits[i] = static_cast<std::uint8_t>(i % 3 == 0);
  }
  modbus_set_socket(context.get(), ends[0]);
  const std::string bytes = encode(request);
  REQUIRE(::send(ends[1], bytes.data(), bytes.size(), 0) == static_cast<ssize_t>(bytes.size()));
  std::array<std::uint8_t, MODBUS_TCP_MAX_ADU_LENGTH> query{};
  const int size = modbus_receive(context.get(), query.data());
  REQUIRE(size > 0);
  modbus_reply(context.get(), query.data(), size, mapping.get());
  std::string answer(300, '\0');
  const ssize_t got = ::recv(ends[1], answer.data(), answer.size(), MSG_DONTWAIT);
  answer.resize(got > 0 ? static_cast<std::size_t>(got) : 0);
  ::close(ends[0]);
  ::close(ends[1]);
  return answer;
}

}  // namespace

TEST_CASE("a request is the twelve bytes of the standard") {
  CHECK(encode(kTwo) == "\x12\x34\0\0\0\x06\x01\x04\0\x0E\0\x02"s);
  CHECK(encode({0xFFFF, 255, Function::discrete_inputs, 0, 80}) == "\xFF\xFF\0\0\0\x06\xFF\x02\0\0\0\x50"s);
}

TEST_CASE("an answer is taken when every field of it fits the request") {
  const Answer answer = judge(kGood, kTwo);
  REQUIRE(answer.verdict == Verdict::data);
  CHECK(answer.payload == "\x41\xC8\0\0"s);
  CHECK(answer.size == kGood.size());
}

TEST_CASE("an answer cut anywhere is incomplete, and bytes behind it are told from its size") {
  for (std::size_t size = 0; size < kGood.size(); ++size) {
    CHECK(judge(kGood.substr(0, size), kTwo).verdict == Verdict::incomplete);
  }
  const std::string twice = kGood + kGood;
  const Answer answer = judge(twice, kTwo);
  CHECK(answer.verdict == Verdict::data);
  CHECK(answer.size == kGood.size());
}

TEST_CASE("any other value of any byte of the header, function or byte count is no answer") {
  for (std::size_t at = 0; at < 9; ++at) {
    for (int value = 0; value < 256; ++value) {
      const std::string bytes = with(at, static_cast<char>(value));
      const Answer answer = judge(bytes, kTwo);
      INFO("byte " << at << " is " << value);
      CHECK((answer.verdict == Verdict::data) == (bytes == kGood));
      CHECK((answer.verdict == Verdict::other_request || answer.verdict == Verdict::malformed) == !answer.why.empty());
      if (at < 2 && bytes != kGood) {
        CHECK(answer.verdict == Verdict::other_request);
      }
    }
  }
}

TEST_CASE("an answer from another unit names both units and the parameter") {
  const Answer answer = judge(with(6, 9), kTwo);
  CHECK(answer.verdict == Verdict::malformed);
  CHECK(answer.why.find("unit 9") != std::string::npos);
  CHECK(answer.why.find("modbusSlaveId") != std::string::npos);
}

TEST_CASE("exceptions are told from answers, a lying one is none") {
  for (const int code : {1, 2, 3, 4, 5, 6, 10, 11, 0, 255}) {
    const std::string bytes = "\x12\x34\0\0\0\x03\x01\x84"s + static_cast<char>(code);
    const Answer answer = judge(bytes, kTwo);
    CHECK(answer.verdict == Verdict::exception);
    CHECK(answer.exception == code);
  }
  CHECK(judge("\x12\x34\0\0\0\x03\x01\x82\x02"s, kTwo).verdict == Verdict::malformed);
  CHECK(judge("\x12\x34\0\0\0\x04\x01\x84\x02\0"s, kTwo).verdict == Verdict::malformed);
}

TEST_CASE("a header that cannot be right is told before the rest has arrived") {
  CHECK(judge("HTTP/1."s, kTwo).verdict == Verdict::malformed);
  CHECK(judge("\x12\x34\0\0\x7F\xFF\x01"s, kTwo).verdict == Verdict::malformed);
  CHECK(judge("\x12\x33\0\0\0\x07\x01"s, kTwo).verdict == Verdict::other_request);
}

TEST_CASE("law: what libmodbus answers is read as libmodbus meant it") {
  std::mt19937 random(5);
  const auto between = [&](int a, int b) { return std::uniform_int_distribution<int>(a, b)(random); };
  for (int i = 0; i < 300; ++i) {
    const bool discrete = i % 2 == 1;
    Request request{static_cast<std::uint16_t>(i * 257), 1,
                    discrete ? Function::discrete_inputs : Function::input_registers,
                    static_cast<std::uint16_t>(between(0, 100)), static_cast<std::uint16_t>(between(1, 60))};
    const std::string bytes = libmodbus_answer(request);
    const Answer answer = judge(bytes, request);
    const bool exists = request.address + request.count <= (discrete ? 80 : 140);
    REQUIRE(answer.verdict == (exists ? Verdict::data : Verdict::exception));
    for (std::size_t k = 0; exists && k < request.count; ++k) {
      const auto byte = [&](std::size_t at) { return static_cast<unsigned char>(answer.payload[at]); };
      const std::size_t at = request.address + k;
      if (discrete) {
        CHECK((byte(k / 8) >> (k % 8) & 1) == (at % 3 == 0 ? 1 : 0));
      } else {
        CHECK((byte(2 * k) << 8 | byte(2 * k + 1)) == static_cast<int>(1000 + at));
      }
    }
  }
}
