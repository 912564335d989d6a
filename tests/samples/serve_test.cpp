// Simulated robots over real sockets, asked in the ways networks deliver requests.

#include "samples/simulator/serve.hpp"

#include <arpa/inet.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "samples/simulator/net.hpp"
#include "schema/error.hpp"
#include "schema/wire/frame.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/golden.hpp"
#include "tests/support/temp_dir.hpp"

namespace sim = tacho::sim;
namespace wire = tacho::wire;
using namespace std::string_literals;

namespace {

/// A client that waits at most two seconds for anything.
class Client {
 public:
  explicit Client(std::uint16_t port) : socket_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    connected_ = ::connect(socket_.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
    const timeval patience{2, 0};
    ::setsockopt(socket_.get(), SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  }
  [[nodiscard]] bool connected() const { return connected_; }
  void send(std::string_view bytes) { REQUIRE(sim::send_all(socket_, bytes)); }
  void slowly(std::string_view bytes) {
    for (const char c : bytes) {
      send({&c, 1});
      ::usleep(200);
    }
  }
  std::string receive(std::size_t most) {
    std::string bytes(most, '\0');
    const ssize_t got = ::recv(socket_.get(), bytes.data(), bytes.size(), 0);
    bytes.resize(got > 0 ? static_cast<std::size_t>(got) : 0);
    return bytes;
  }
  bool closed() { return receive(1).empty(); }
  wire::Frame frame() {
    wire::Frame frame;
    while (!decoder_.next(frame)) {
      const std::string bytes = receive(4096);
      REQUIRE(!bytes.empty());
      decoder_.feed(bytes);
      REQUIRE(!decoder_.bad());
    }
    return frame;
  }
  wire::Frame ask(std::uint16_t sequence, std::uint16_t type, std::string_view body = {}) {
    send(wire::encode_frame(1, sequence, type, body));
    return frame();
  }

 private:
  sim::Descriptor socket_;
  bool connected_ = false;
  wire::FrameDecoder decoder_;
};

std::vector<sim::ServedRobot> robots(int count) {
  std::vector<sim::ServedRobot> all;
  for (int i = 0; i < count; ++i) {
    all.push_back({sim::busy_day(static_cast<std::uint64_t>(i + 1)), 0, 0});
  }
  return all;
}

/// Modbus TCP request: read `count` from protocol address `from`.
std::string modbus(std::uint8_t unit, std::uint8_t function, std::uint16_t from, std::uint16_t count) {
  return std::string{0x12, 0x34, 0, 0, 0, 6} + static_cast<char>(unit) + static_cast<char>(function) +
         static_cast<char>(from >> 8) + static_cast<char>(from & 0xFF) + static_cast<char>(count >> 8) +
         static_cast<char>(count & 0xFF);
}

const std::string kQuiet = R"({"return_laser":false})";

}  // namespace

TEST_CASE("a status request is answered with its sequence and its number in the reserved bytes") {
  sim::Server server(robots(1), {});
  Client client(server.status_port(0));
  const wire::Frame frame = client.ask(0xABCD, 1100, kQuiet);
  CHECK(frame.header.type == 11100);
  CHECK(frame.header.sequence == 0xABCD);
  CHECK(frame.header.version == 1);
  CHECK(frame.header.reserved == std::array<std::uint8_t, 6>{0x04, 0x4C, 0, 0, 0, 0});
  const auto json = nlohmann::json::parse(frame.body);
  CHECK(json["vehicle_id"] == "amr-1");
  CHECK(!json.contains("lasers"));
}

TEST_CASE("lasers come unless they are declined, keys are honoured") {
  sim::Server server(robots(1), {});
  Client client(server.status_port(0));
  CHECK(nlohmann::json::parse(client.ask(1, 1100).body).contains("lasers"));
  const auto json = nlohmann::json::parse(client.ask(2, 1100, R"({"keys":["odo"],"return_laser":false})").body);
  CHECK(json.contains("odo"));
  CHECK(json.size() == 3);
}

TEST_CASE("a request that arrives byte by byte is answered once it is complete") {
  sim::Server server(robots(1), {});
  Client client(server.status_port(0));
  client.slowly(wire::encode_frame(2, 7, 1100, kQuiet));
  const wire::Frame frame = client.frame();
  CHECK(frame.header.sequence == 7);
  CHECK(frame.header.version == 2);
}

TEST_CASE("two requests in one packet get two answers in order") {
  sim::Server server(robots(1), {});
  Client client(server.status_port(0));
  client.send(wire::encode_frame(1, 8, 1013, "") + wire::encode_frame(1, 9, 1100, kQuiet));
  const wire::Frame io = client.frame();
  const wire::Frame status = client.frame();
  CHECK(io.header.sequence == 8);
  CHECK(io.header.type == 11013);
  CHECK(nlohmann::json::parse(io.body)["DI"].size() == 25);
  CHECK(status.header.sequence == 9);
  CHECK(status.header.type == 11100);
}

TEST_CASE("unknown numbers and bad JSON get error frames and the connection lives on") {
  sim::Server server(robots(1), {});
  Client client(server.status_port(0));
  CHECK(client.ask(1, 1999).header.type == 60001);
  CHECK(client.ask(2, 1100, "{\"keys\":").header.type == 60002);
  CHECK(client.ask(3, 1100, R"({"keys":7})").header.type == 60002);
  CHECK(client.ask(4, 1013).header.type == 11013);
}

TEST_CASE("a malformed header ends the connection without a word") {
  sim::Server server(robots(1), {});
  Client client(server.status_port(0));
  client.send("GET / HTTP/1.1\r\n\r\n");
  CHECK(client.closed());
}

TEST_CASE("one client too many is told so and sent away, the others stay") {
  sim::ServeOptions options;
  options.max_clients = 2;
  sim::Server server(robots(1), options);
  Client first(server.status_port(0));
  Client second(server.status_port(0));
  first.ask(1, 1013);
  second.ask(1, 1013);
  Client third(server.status_port(0));
  const wire::Frame frame = third.frame();
  CHECK(frame.header.type == 19204);
  CHECK(nlohmann::json::parse(frame.body)["ret_code"] == 61001);
  CHECK(wire::classify(frame, 11100) == wire::AnswerClass::client_limit);
  CHECK(third.closed());
  CHECK(first.ask(2, 1013).header.type == 11013);
}

TEST_CASE("a body file is served byte for byte") {
  const tacho::test::TempDir dir;
  const std::string body = "{\"odo\": 1.50, \"weird\":\t-0.0}\n";
  std::ofstream(dir / "body.json", std::ios::binary) << body;
  auto served = robots(1);
  served[0].scenario.body_file = (dir / "body.json").string();
  served[0].scenario.io_body_file = served[0].scenario.body_file;
  sim::Server server(served, {});
  Client client(server.status_port(0));
  CHECK(client.ask(1, 1100, kQuiet).body == body);
  CHECK(client.ask(2, 1013).body == body);
  served[0].scenario.body_file = "/no/such/body.json";
  CHECK_THROWS_WITH(sim::Server(served, {}), Catch::Matchers::Contains("/no/such/body.json"));
}

TEST_CASE("Modbus reads registers across gaps and discrete inputs") {
  sim::Server server(robots(1), {});
  Client client(server.modbus_port(0));
  client.send(modbus(1, 4, 0, 100));
  const std::string registers = client.receive(300);
  REQUIRE(registers.size() == 9 + 200);
  CHECK(registers[7] == 4);
  CHECK(static_cast<unsigned char>(registers[8]) == 200);
  CHECK(static_cast<unsigned char>(registers[9 + 2 * 69 + 1]) == 127);  // register 70: first part of the address
  client.slowly(modbus(1, 2, 0, 80));
  const std::string inputs = client.receive(300);
  REQUIRE(inputs.size() == 9 + 10);
  CHECK(inputs[8] == 10);
}

TEST_CASE("Modbus refuses what is not there and every writing function") {
  sim::Server server(robots(1), {});
  Client client(server.modbus_port(0));
  client.send(modbus(1, 4, 100, 50));
  CHECK(client.receive(300).substr(7) == "\x84\x02"s);
  for (const int function : {1, 3, 5, 6}) {
    Client other(server.modbus_port(0));
    other.send(modbus(1, static_cast<std::uint8_t>(function), 0, 1));
    CHECK(other.receive(300).substr(7) == std::string{static_cast<char>(0x80 + function), 1});
  }
}

TEST_CASE("Modbus answers only for its own unit") {
  auto served = robots(2);
  served[1].scenario.modbus_unit = -1;
  sim::Server server(served, {});
  Client strict(server.modbus_port(0));
  strict.send(modbus(9, 4, 0, 1));
  strict.send(modbus(1, 2, 0, 8));
  CHECK(strict.receive(300)[7] == 2);
  Client any(server.modbus_port(1));
  any.send(modbus(9, 4, 0, 1));
  CHECK(any.receive(300)[7] == 4);
}

TEST_CASE("a robot that is switched off is gone and comes back on its ports") {
  sim::Server server(robots(2), {});
  const std::uint16_t port = server.status_port(0);
  Client client(port);
  client.ask(1, 1013);
  server.stop(0);
  CHECK(client.closed());
  CHECK(!Client(port).connected());
  CHECK(Client(server.status_port(1)).ask(1, 1013).header.type == 11013);
  server.start(0);
  CHECK(server.status_port(0) == port);
  CHECK(Client(port).ask(1, 1013).header.type == 11013);
  CHECK(Client(server.modbus_port(0)).connected());
}

TEST_CASE("a port in use is named") {
  sim::Server server(robots(1), {});
  auto again = robots(1);
  again[0].status_port = server.status_port(0);
  CHECK_THROWS_WITH(sim::Server(again, {}), Catch::Matchers::Contains(std::to_string(server.status_port(0))));
}

TEST_CASE("the truth is written when the robots are switched off") {
  const tacho::test::TempDir dir;
  sim::ServeOptions options;
  options.truth_file = (dir / "truth.json").string();
  {
    sim::Server server(robots(2), options);
    CHECK(server.truth(1).t1_us >= server.truth(1).t0_us);
  }
  const auto json = nlohmann::json::parse(tacho::test::read_file(dir / "truth.json"));
  REQUIRE(json.size() == 2);
  CHECK(json[1]["robot"] == "amr-2");
  CHECK(json[1]["equivalent_full_cycles_soc"].get<double>() >= 0);
}
