// All that a recorder sends to a robot, captured on the way while everything goes wrong.

#include "samples/simulator/serve.hpp"
#include "tests/recorder/logging_proxy.hpp"
#include "tests/recorder/recording.hpp"
#include "tests/support/temp_dir.hpp"

using namespace tacho;
using namespace tacho::recorder;
using namespace tacho::recorder::test;
using namespace std::chrono_literals;

namespace {

constexpr auto kEachFault = 80ms;

/// `bodies`: of requests 1100.
std::map<int, int> status_requests(const std::vector<std::string>& connections, std::map<std::string, int>& bodies) {
  std::map<int, int> count;
  for (const std::string& bytes : connections) {
    wire::FrameDecoder decoder;
    decoder.feed(bytes);
    wire::Frame frame;
    while (decoder.next(frame)) {
      ++count[frame.header.type];
      if (frame.header.type == 1100) {
        ++bodies[frame.body];
      } else {
        CHECK(frame.body.empty());
      }
    }
    CHECK_FALSE(decoder.bad());
    CHECK(decoder.buffered() == 0);
  }
  return count;
}

std::map<int, int> modbus_requests(const std::vector<std::string>& connections) {
  constexpr std::size_t kRequestBytes = 12;
  std::map<int, int> count;
  for (const std::string& bytes : connections) {
    CHECK(bytes.size() % kRequestBytes == 0);
    for (std::size_t at = 0; at + kRequestBytes <= bytes.size(); at += kRequestBytes) {
      CHECK(bytes.substr(at + 2, 4) == std::string("\0\0\0\x06", 4));
      ++count[static_cast<unsigned char>(bytes[at + 7])];
    }
  }
  return count;
}

}  // namespace

TEST_CASE(
    "under every fault nothing but requests 1100 and 1013 and functions 2 and 4 leaves the recorder, and nothing "
    "goes to the push port") {
  sim::Scenario scenario;
  scenario.always_idle = true;
  sim::ServeOptions serving;
  serving.push_period_us = 50'000;
  sim::Server robot({{scenario, 0, 0, 0}}, serving);
  const LoggingProxy status(robot.status_port(0));
  const LoggingProxy modbus(robot.modbus_port(0));
  const LoggingProxy push(robot.push_port(0));
  const tacho::test::TempDir dir;
  Config config = config_for(dir / "log", {{status.port(), modbus.port()}});
  config.robots[0].push_port = push.port();
  for (const Source source : {Source::push, Source::pose, Source::ring}) {
    config.robots[0].settings.period_us[static_cast<std::size_t>(source)] = 50'000;
  }
  config.robots[0].settings.status.timeout_us = config.robots[0].settings.modbus.timeout_us = 60'000;
  std::vector<SourceSummary> summary;
  {
    Recorder recorder(config, {});
    for (const sim::LinkFault& fault : sim::link_faults()) {
      for (const sim::Port port : sim::kPorts) {
        robot.fault(0, port, &fault);
      }
      std::this_thread::sleep_for(kEachFault);
    }
    CHECK(recorder.mark({"", "writes what the ring holds"}) == 1);
    for (const sim::Port port : sim::kPorts) {
      robot.fault(0, port, nullptr);
    }
    std::this_thread::sleep_for(1s);
    recorder.stop();
    summary = recorder.finish();
  }
  check_log(dir / "log", summary);
  std::map<std::string, int> bodies;
  const auto frames = status_requests(status.sent(), bodies);
  REQUIRE(frames.size() == 2);
  CHECK(frames.at(1100) > 20);
  CHECK(frames.at(1013) > 20);
  CHECK(bodies.size() == 2);
  CHECK(bodies[R"({"return_laser":false})"] > 20);
  CHECK(bodies[R"({"keys":["x","y","angle","confidence","vx","vy","w","odo"],"return_laser":false})"] > 20);
  for (const std::string& bytes : push.sent()) {
    CHECK(bytes.empty());
  }
  CHECK(push.sent().size() > 5);
  const auto pushed =
      std::find_if(summary.begin(), summary.end(), [](const auto& s) { return s.source == Source::push; });
  REQUIRE(pushed != summary.end());
  CHECK(pushed->stored > 20);
  const auto functions = modbus_requests(modbus.sent());
  REQUIRE(functions.size() == 2);
  CHECK(functions.at(2) > 20);
  CHECK(functions.at(4) > 20);
}
