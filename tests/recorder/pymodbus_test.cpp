// An independent Modbus server, pymodbus of Debian, where it is installed.

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <sys/wait.h>

#include "recorder/link/modbus_link.hpp"
#include "schema/fields.hpp"
#include "tests/recorder/recording.hpp"
#include "tests/support/temp_dir.hpp"

using namespace tacho;
using namespace tacho::recorder;
using namespace tacho::recorder::test;

namespace {

constexpr const char* kPython = "/usr/bin/python3";

/// The script, with a pipe to its standard input whose end ends it.
class PymodbusServer {
 public:
  explicit PymodbusServer(const std::string& gaps) {
    std::array<int, 2> in{};
    std::array<int, 2> out{};
    REQUIRE(::pipe2(in.data(), O_CLOEXEC) == 0);
    REQUIRE(::pipe2(out.data(), O_CLOEXEC) == 0);
    const std::string script = TACHO_SOURCE_DIR "/tests/recorder/pymodbus_server.py";
    const std::string registers = wire::to_text(wire::documented_runs(false));
    const std::string inputs = wire::to_text(wire::documented_runs(true));
    pid_ = ::fork();
    REQUIRE(pid_ >= 0);
    if (pid_ == 0) {
      ::dup2(in[0], 0);
      ::dup2(out[1], 1);
      ::execl(kPython, "python3", script.c_str(), gaps.c_str(), registers.c_str(), inputs.c_str(), nullptr);
      ::_exit(127);
    }
    ::close(in[0]);
    ::close(out[1]);
    stdin_ = in[1];
    std::string line;
    for (char byte = 0; ::read(out[0], &byte, 1) == 1 && byte != '\n';) {
      line += byte;
    }
    ::close(out[0]);
    port_ = line.empty() ? 0 : std::stoi(line);
  }
  ~PymodbusServer() {
    ::close(stdin_);
    ::waitpid(pid_, nullptr, 0);
  }
  PymodbusServer(const PymodbusServer&) = delete;
  PymodbusServer& operator=(const PymodbusServer&) = delete;
  /// 0: it did not start, pymodbus is not there.
  [[nodiscard]] std::uint16_t port() const { return static_cast<std::uint16_t>(port_); }

 private:
  pid_t pid_ = -1;
  int stdin_ = -1;
  int port_ = 0;
};

bool installed() {
  return std::filesystem::exists(kPython) &&
         std::system(fmt::format("{} -c 'import pymodbus' 2>/dev/null", kPython).c_str()) == 0;
}

std::vector<Answer> answers_of(const std::filesystem::path& folder, Source source) {
  std::vector<Answer> out;
  const auto log = open(folder);
  log->read_raw(log->robots().at(0).id, source, {}, [&](const Answer& a) { out.push_back(a); });
  return out;
}

}  // namespace

TEST_CASE("a recording from pymodbus holds its values, whether it reads gaps as zero or refuses them") {
  if (!installed()) {
    WARN("skipped: python3-pymodbus is not installed");
    return;
  }
  for (const std::string gaps : {"zero", "exception"}) {
    INFO("gaps as " << gaps);
    const PymodbusServer server(gaps);
    REQUIRE(server.port() != 0);
    const tacho::test::TempDir dir;
    Config config = config_for(dir / "log", {{closed_port(), server.port()}});
    config.robots[0].settings.period_us = {0, 0, 100'000, 100'000};
    Recorder::Options options;
    options.run_for_us = 1'500'000;
    Recorder recorder(config, options);
    wait_done(recorder);
    const auto summary = recorder.finish();
    check_log(dir / "log", summary);
    for (const SourceSummary& row : summary) {
      CHECK(row.stored > 0);
      CHECK(row.partial == 0);
    }
    Sample sample;
    Gates gates;
    const auto inputs = answers_of(dir / "log", Source::inputs);
    REQUIRE_FALSE(inputs.empty());
    wire::decode_inputs(inputs.back().body, FieldSet().set(), gates, sample);
    REQUIRE(sample.decodable);
    for (FieldIndex f = 0; f < kFieldCount; ++f) {
      if (const RegisterSource reg = field_at(f).reg; reg.present() && reg.discrete) {
        INFO(field_at(f).name);
        CHECK((sample.at(f).integer != 0) == (reg.address % 3 == 0));
      }
    }
    const auto registers = answers_of(dir / "log", Source::registers);
    REQUIRE_FALSE(registers.empty());
    wire::decode_registers(registers.back().body, WordOrder::cdab, {}, FieldSet().set(), sample);
    REQUIRE(sample.decodable);
    CHECK(sample.at(field("voltage")).real == Approx(52.347));
    CHECK(sample.at(field("current")).real == Approx(-1.1));
    CHECK(sample.at(field("clock_second")).integer == 1131);
    const auto events = events_of(dir / "log", 1);
    const auto found =
        std::find_if(events.begin(), events.end(), [](const Event& e) { return e.kind == EventKind::word_order; });
    REQUIRE(found != events.end());
    CHECK(found->new_value == "cdab");
  }
}

TEST_CASE("of a server that refuses gaps the documented runs are asked for, and nothing is missing") {
  if (!installed()) {
    WARN("skipped: python3-pymodbus is not installed");
    return;
  }
  const PymodbusServer server("exception");
  REQUIRE(server.port() != 0);
  ModbusLinkOptions options;
  options.host = "127.0.0.1";
  options.port = server.port();
  ModbusLink link(options);
  for (const Source source : {Source::registers, Source::inputs}) {
    const PollResult first = link.poll(source, std::chrono::seconds(5));
    INFO(first.detail);
    REQUIRE(first.ok);
    CHECK_FALSE(first.partial);
    CHECK(link.plan(source).ranges() == wire::documented_runs(source == Source::inputs));
  }
}
