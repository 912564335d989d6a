// The format as its description says: a reader in another language, written from block/FORMAT.md, gives the same bytes.

#include <sys/wait.h>

#include <array>
#include <cstdio>
#include <memory>
#include <random>

#include "samples/simulator/write.hpp"
#include "schema/log.hpp"
#include "tests/schema/store_fixture.hpp"

using namespace tacho;
using namespace tacho::test;
namespace fs = std::filesystem;

namespace {

constexpr const char* kPython = "/usr/bin/python3";
constexpr int kSkipped = 77;

std::string hex(std::string_view bytes) {
  constexpr std::string_view kDigits = "0123456789abcdef";
  std::string out;
  for (const char c : bytes) {
    const auto byte = static_cast<unsigned char>(c);
    out += kDigits[byte >> 4U];
    out += kDigits[byte & 15U];
  }
  return out.empty() ? "-" : out;
}

std::string as_we_read(const fs::path& log, RobotId robot, Source source) {
  const auto reader = open_log(std::vector<fs::path>{log});
  std::string out;
  reader->read_raw(robot, source, {}, [&](const Answer& a) {
    out += std::to_string(a.meta.session) + " " + std::to_string(a.meta.seq) + " " + std::to_string(a.meta.t_send_us) +
           " " + std::to_string(a.meta.t_recv_us) + " " + hex(a.header) + " " + hex(a.body) + "\n";
  });
  return out;
}

struct Printed {
  std::string text;
  int code = 0;
};

Printed as_the_other_reads(const fs::path& log, RobotId robot, Source source) {
  const std::string command = std::string(kPython) + " " TACHO_SOURCE_DIR "/tests/schema/other_reader.py " +
                              log.string() + " " + std::to_string(robot) + " " + std::string(source_name(source));
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> pipe(popen(command.c_str(), "r"), [](std::FILE*) { return 0; });
  REQUIRE(pipe);
  Printed out;
  std::array<char, 65536> buffer{};
  for (std::size_t n = 1; n > 0;) {
    n = std::fread(buffer.data(), 1, buffer.size(), pipe.get());
    out.text.append(buffer.data(), n);
  }
  out.code = WEXITSTATUS(pclose(pipe.get()));
  return out;
}

/// Lines both readers gave; 0 when the other one cannot run here.
std::size_t compare(const fs::path& log, RobotId robot, Source source) {
  const Printed other = as_the_other_reads(log, robot, source);
  if (!fs::exists(kPython) || other.code == kSkipped) {
    WARN("skipped: python3 or libzstd is not installed");
    return 0;
  }
  INFO(source_name(source));
  CHECK(other.code == 0);
  const std::string ours = as_we_read(log, robot, source);
  CHECK((other.text == ours));  // in brackets: megabytes are no message
  CHECK_FALSE(ours.empty());
  return static_cast<std::size_t>(std::count(ours.begin(), ours.end(), '\n'));
}

/// What robots of any make may print, and what is no JSON at all.
std::vector<std::string> odd_bodies(unsigned n) {
  const std::string i = std::to_string(n);
  std::array<char, 400> printed{};
  const double x = 0.1 * n * (n % 2 == 0 ? 1 : -1) / 3;
  std::snprintf(printed.data(), printed.size(), R"({"a":%.17g,"b":%.9g,"c":%.3f,"d":%.4e,"e":%g})", x, x, x, x,
                x * 1e-7);
  return {printed.data(),
          "{\n  \"x\" : " + i + ".50,\n  \"deep\" : { \"er\" : [ " + i + ", {\"y\": -0.0} ], \"\" : null }\n}",
          R"({"path\/to":"a\"b)" + i + R"(","k\u00e9y":1e-05,"d.o\\t":1E+20,"same":1,"same":)" + i + "}",
          R"({"t":"2026-01-01T00:00:0)" + std::to_string(n % 10) + R"(.123Z","zero":-0.0,"flag":)" +
              (n % 3 == 0 ? "true}" : "false}"),
          R"({"big":1180591620717411303424,"f":0.100000001,"w":)" + std::string(n % 7 + 1, '9') + ".0}",
          n % 50 == 0 ? std::string("no JSON\0\xFF", 9) : "[" + i + "]",
          ""};
}

std::string image_of(unsigned n) {
  std::string image("\0\1\0\x64", 4);
  for (unsigned i = 0; i < 200; ++i) {
    image += static_cast<char>(i % 40 == 0 ? n * (i + 1) : i);
  }
  return image;
}

/// Polls of a source, some missing, some with an unusual header.
void record(store::LogWriter& writer, SessionId session, Source source, int polls,
            const std::function<std::string(unsigned)>& body) {
  writer.declare(stream_of(session, 1, source));
  for (int i = 0; i < polls; ++i) {
    if (i % 13 == 5) {
      continue;
    }
    Answer answer = answer_of(session, 1, source, static_cast<std::uint64_t>(i), kT0 + i * kSecond + i % 7 * 311,
                              body(static_cast<unsigned>(i)));
    answer.header = i % 31 == 0 ? "unusual header " + std::to_string(i) : "";
    answer.meta.t_recv_us += i % 5 * 100;
    writer.append(answer);
    if (i % 4 == 3) {
      writer.commit();
    }
  }
}

SessionId begin(store::LogWriter& writer) {
  writer.robot("amr-1", "127.0.0.1:19204:502");
  Session session;
  session.t_start_us = kT0;
  return writer.begin_session(session);
}

}  // namespace

TEST_CASE("a reader written from the description of the format reads what a robot said, of every source") {
  TempDir dir;
  sim::WriteOptions options;
  options.duration_us = 240'000'000;
  options.io_period_us = options.registers_period_us = options.inputs_period_us = 1'000'000;
  options.pose_period_us = options.push_period_us = 2'000'000;
  sim::write_log({sim::busy_day(3)}, options, dir / "log");
  for (const Source source :
       {Source::status, Source::io, Source::registers, Source::inputs, Source::pose, Source::push}) {
    (void)compare(dir / "log", 1, source);
  }
}

TEST_CASE("it reads numbers and texts written in any way, and what is no JSON, in blocks and while they are hot") {
  TempDir dir;
  const auto odd = [](unsigned n) {
    const std::vector<std::string> bodies = odd_bodies(n);
    return bodies[n / 60 % bodies.size()];  // each kind for a while, so that it gets columns of its own
  };
  for (const bool blocks : {true, false}) {
    const fs::path log = dir / (blocks ? "blocks" : "hot");
    {
      store::WriterOptions options;
      options.blocks = blocks;
      options.keyframe_every = 10;
      store::LogWriter writer(dir / "live", options);
      const SessionId session = begin(writer);
      record(writer, session, Source::status, 840, odd);
      record(writer, session, Source::io, 60, [](unsigned n) { return body_of(n / 3); });  // repeats
      record(writer, session, Source::registers, 200, image_of);
      writer.commit();
      if (blocks) {
        writer.end_session(kT0 + 1000 * kSecond, true);
      } else {
        copy_as_killed(dir / "live", log);
      }
    }
    if (blocks) {
      fs::copy(dir / "live", log, fs::copy_options::recursive);
    }
    fs::remove_all(dir / "live");
    INFO(log);
    for (const Source source : {Source::status, Source::io, Source::registers}) {
      const std::size_t lines = compare(log, 1, source);
      CHECK((lines == 0 || lines > 50));
    }
  }
}
