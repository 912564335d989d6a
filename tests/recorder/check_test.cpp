// `check` fails where a recording would lack something, and says what.

#include "recorder/check.hpp"

#include <fstream>

#include "tests/recorder/recording.hpp"
#include "tests/support/temp_dir.hpp"

using namespace tacho;
using namespace tacho::recorder;
using namespace tacho::recorder::test;
using tacho::test::TempDir;

namespace {

/// One robot of which the status port alone is asked.
Config status_only(const std::filesystem::path& log, std::uint16_t port) {
  Config config = config_for(log, {{port, 1}});
  config.retention.reserve_bytes = 0;
  config.robots[0].settings.period_us = {1'000'000, 0, 0, 0};
  return config;
}

bool has(const CheckResult& result, const std::string& text) { return result.text.find(text) != std::string::npos; }

}  // namespace

TEST_CASE("a robot that answers and a folder that can be made are no problem") {
  TempDir dir;
  TinyServer server([](Peer& peer, int) { serve_status(peer); });
  const CheckResult result = check(status_only(dir / "new" / "log", server.port()));
  INFO(result.text);
  CHECK(result.problems == 0);
  CHECK(has(result, "vehicle AMB-1"));
  CHECK_FALSE(has(result, "FAILED"));
  CHECK_FALSE(std::filesystem::exists(dir / "new"));
}

TEST_CASE("a key that the robot leaves out of its answer is a problem") {
  TempDir dir;
  TinyServer server([](Peer& peer, int) { serve_status(peer); });
  Config config = status_only(dir / "log", server.port());
  config.robots[0].settings.status.request.keys = {"x", "confidance"};
  const CheckResult result = check(config);
  INFO(result.text);
  CHECK(result.problems == 1);
  CHECK(has(result, "asked for 'confidance'"));
}

TEST_CASE("an answer that no analysis could use is a problem") {
  TempDir dir;
  TinyServer server([](Peer& peer, int) {
    wire::FrameDecoder decoder;
    wire::Frame frame;
    for (std::string byte = peer.read(1); !byte.empty(); byte = peer.read(1)) {
      decoder.feed(byte);
      if (decoder.next(frame)) {
        peer.write(
            wire::encode_frame(1, frame.header.sequence, wire::answer_type(frame.header.type), "\x1f\x8b zipped"));
      }
    }
  });
  const CheckResult result = check(status_only(dir / "log", server.port()));
  INFO(result.text);
  CHECK(result.problems == 1);
  CHECK(has(result, "cannot be decoded"));
}

TEST_CASE("a log that could not be written and a reserve that the disk does not have are problems") {
  TempDir dir;
  TinyServer server([](Peer& peer, int) { serve_status(peer); });
  std::ofstream(dir / "file") << "no folder";
  CheckResult result = check(status_only(dir / "file" / "log", server.port()));
  INFO(result.text);
  CHECK(result.problems == 1);
  CHECK(has(result, "file is not a folder"));

  Config config = status_only(dir / "log", server.port());
  config.retention.reserve_bytes = std::uint64_t{1} << 60;
  result = check(config);
  CHECK(result.problems == 1);
  CHECK(has(result, "cannot be kept"));
}
