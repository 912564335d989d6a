// The format as it is described: other_reader.py, written from schema/store/block/FORMAT.md, reads what we read.

#include <fmt/format.h>

#include <bit>
#include <charconv>
#include <random>

#include "samples/simulator/answers.hpp"
#include "schema/log.hpp"
#include "tests/schema/store_fixture.hpp"
#include "tests/support/process.hpp"

using namespace tacho;
using namespace tacho::test;
namespace fs = std::filesystem;

namespace {

Outcome read_with_python(const fs::path& folder, RobotId robot, Source source) {
  const std::string script = TACHO_SOURCE_DIR "/tests/schema/other_reader.py";
  return run("/usr/bin/env",
             {"python3", script, folder.string(), std::to_string(robot), std::string(source_name(source))});
}

bool python_is_here() {
  TempDir empty;
  constexpr int kNoProgram = 127;
  constexpr int kNoLibrary = 77;
  const int code = read_with_python(empty.path(), 1, Source::status).code;
  if (code == kNoProgram || code == kNoLibrary) {
    WARN("skipped: no python3 with SQLite here, or no libzstd.so");
    return false;
  }
  return true;
}

std::string hex(std::string_view bytes) {
  std::string out;
  for (const char byte : bytes) {
    out += fmt::format("{:02x}", static_cast<unsigned char>(byte));
  }
  return out;
}

std::vector<std::string> read_by_us(const fs::path& folder, RobotId robot, Source source) {
  std::vector<std::string> lines;
  store::LogReader log = open_reader(folder);
  log.read_raw(robot, source, Window{}, [&](const Answer& a) {
    lines.push_back(fmt::format(R"({{"session":{},"seq":{},"t_send_us":{},"t_recv_us":{},"header":"{}","body":"{}"}})",
                                a.meta.session, a.meta.seq, a.meta.t_send_us, a.meta.t_recv_us, hex(a.header),
                                hex(a.body)));
  });
  CHECK(log.problems().empty());
  return lines;
}

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find('\n', at), text.size());
    lines.push_back(text.substr(at, end - at));
    at = end + 1;
  }
  return lines;
}

std::string shortest(auto value, auto... how) {
  std::array<char, 64> text{};
  return std::string(text.data(), std::to_chars(text.data(), text.data() + text.size(), value, how...).ptr);
}

/// Every way in which a column may be written, and bodies that are in no column.
std::string odd_status(std::mt19937_64& random, std::uint64_t n) {
  if (n % 50 == 7) {
    return n % 100 == 7 ? "" : fmt::format("no JSON {}\xff", n);
  }
  const double real = std::uniform_real_distribution(-9.0, 9.0)(random);
  const auto small = static_cast<float>(real);
  const std::string escaped = n % 2 == 0 ? R"("k\u0065y")" : R"("key")";
  std::string body = "{";
  body += fmt::format(R"("seventeen":{:.17g},"nine":{:.9g},"float":{},"widened":{})", real, small * 1e-6,
                      shortest(small), shortest(static_cast<double>(small)));
  body += fmt::format(R"(,"float_short":{},"huge":{},"large_float":{})", shortest(small * 1e-5F), shortest(real * 1e19),
                      shortest(small * 1e9F));
  body += fmt::format(R"(,"power":{},"real_zero":{})",
                      shortest(n % 3 == 0 ? std::ldexp(1.0F, static_cast<int>(n % 200) - 100) : small),
                      n % 4 == 1 ? "-0.0" : shortest(real));
  // Written as other libraries do: no padding of exponents, points behind whole numbers.
  std::string bare = shortest(real * 1e-5, std::chars_format::scientific);
  bare.erase(bare.find("e-0") + 2, 1);
  body += fmt::format(R"(, "bare":{},"pointed":{:.1f},"fixed":{:.3f},"cut":{})", n % 3 == 0 ? bare : shortest(real),
                      real, real, std::round(real * 100) / 100);
  body += fmt::format(R"(,"zero":{},"time":{},"when":"2026-01-01 00:{:02}:{:02}.{:03}")", n % 4 == 0 ? "-0.0" : "0.5",
                      n * 1000 + random() % 3, n / 60 % 60, n % 60, random() % 1000);
  body += fmt::format(R"(,"list":[{},[{},null,{{"a":"{}"}}],{:.4f}],"same":[1,[2]],"flag":{},"mixed":{})", random() % 9,
                      random() % 5000, n, real, n % 7 == 0, n % 9 == 0 ? "null" : std::to_string(n * n));
  body += fmt::format(R"(,"text":"{}","deep":{{ "x":{{"y" : {}}},"z":{{}}}},{}:{},"x":1,"x":{})",
                      n / 40 % 3 == 0 ? "ä\\n" : "b", n % 11, escaped, n, n + 2);
  return body + (n % 5 == 0 ? fmt::format(R"(,"seldom":{:.2f}}})", real) : std::string("}\n"));
}

/// Three floats: rounded, rounded mostly, with all bits; a second range now and then.
std::string odd_registers(std::mt19937_64& random, std::uint64_t n, WordOrder order) {
  std::string image{'\0', '\1', '\0', '\6'};
  for (int i = 0; i < 3; ++i) {
    const double real = std::uniform_real_distribution(-30.0, 30.0)(random);
    const bool rounded = i == 0 || (i == 1 && n % 30 != 0);
    const auto bits = std::bit_cast<std::uint32_t>(static_cast<float>(rounded ? std::round(real * 100) / 100 : real));
    const auto byte = [&](unsigned place) { return static_cast<char>(bits >> (24 - 8 * place)); };
    static const std::map<WordOrder, std::array<unsigned, 4>> kOrders{{WordOrder::cdab, {2, 3, 0, 1}},
                                                                      {WordOrder::abcd, {0, 1, 2, 3}},
                                                                      {WordOrder::badc, {1, 0, 3, 2}},
                                                                      {WordOrder::dcba, {3, 2, 1, 0}}};
    for (const unsigned place : kOrders.at(order)) {
      image += byte(place);
    }
  }
  const auto low = static_cast<char>(n * 7 % 256);
  if (n % 10 < 7) {  // a word, two that are a whole number, a word
    image += {'\0', '\x86', '\0', '\4', '\1', low, n % 4 == 0 ? '\xff' : '\0', '\1', '\0', low, '\2', low};
  } else if (n % 10 == 8) {  // the first of the two alone
    image += {'\0', '\x87', '\0', '\1', '\0', low};
  }
  return image;
}

constexpr std::array kOrders{WordOrder::cdab, WordOrder::abcd, WordOrder::badc, WordOrder::dcba};
constexpr std::array kSources{Source::status, Source::io, Source::registers, Source::inputs};

/// A log of four robots: days that have ended in parts of their own, a session that ended, one that was killed with
/// answers that are still hot.
class Writing {
 public:
  explicit Writing(const fs::path& folder) : live_(folder.string() + "-live"), writer_(live_, options()) {
    scenario_.registers_rounded = false;
    session(kT0 + kDay - 400 * kSecond - 2000, 800);  // one is sent before midnight and answered behind it
    writer_.end_session(t_us_, true);
    session(t_us_ + kDay, 700);
    copy_as_killed(live_, folder);
  }

 private:
  fs::path live_;
  store::LogWriter writer_;
  Ingest ingest_{writer_, [] { return Micros{1000}; }};
  sim::Scenario scenario_ = sim::busy_day(4);
  std::mt19937_64 random_{3};
  Micros t_us_ = 0;
  SessionId session_ = 0;
  std::map<std::pair<RobotId, Source>, std::string> before_;

  static store::WriterOptions options() {
    store::WriterOptions options;
    options.decode = answer_decode();
    options.durable = false;
    options.keyframe_every = 20;
    return options;
  }

  void session(Micros t_us, std::uint64_t polls) {
    Session start;
    start.t_start_us = t_us_ = t_us;
    start.software = "test";
    std::vector<RobotId> robots;
    for (const char* name : {"amr-1", "amr-2", "amr-3", "amr-4"}) {
      robots.push_back(writer_.robot(name, "127.0.0.1:19204:502"));
    }
    session_ = writer_.begin_session(start);
    for (const RobotId robot : robots) {
      for (const Source source : kSources) {
        Stream stream = stream_of(session_, robot, source);
        stream.word_order = kOrders[robot - 1];
        ingest_.declare(stream);
      }
    }
    sim::Robot moving(scenario_, t_us);
    sim::AnswerMaker maker(scenario_);
    for (std::uint64_t n = 0; n < polls; ++n) {
      const sim::RobotState& state = moving.at(t_us_);
      for (const RobotId robot : robots) {
        for (const Source source : kSources) {
          poll(robot, source, n,
               robot == 1 && n < 60 ? maker.body(source, state) : odd(robot, source, n, state, maker));
        }
      }
      t_us_ += kSecond;
      if (n % 6 == 5) {
        writer_.commit();
      }
    }
    writer_.commit();
  }

  std::string odd(RobotId robot, Source source, std::uint64_t n, const sim::RobotState& state,
                  sim::AnswerMaker& maker) {
    switch (source) {
      case Source::status:
        return odd_status(random_, n);
      case Source::io:
        return random_() % 3 == 0 ? fmt::format("{{\"a\":{}}}", random_() % 100) : before_[{robot, source}];
      case Source::registers:
        return robot == 1 ? maker.body(source, state) : odd_registers(random_, n, kOrders[robot - 1]);
      default:
        return maker.body(source, state);
    }
  }

  void poll(RobotId robot, Source source, std::uint64_t n, std::string body) {
    if (n % 90 == 60) {
      ingest_.add(gap_of(session_, robot, source, n, 1, t_us_));
      return;
    }
    Answer answer =
        answer_of(session_, robot, source, n, t_us_ + static_cast<Micros>(random_() % 900), std::move(body));
    answer.meta.t_recv_us += static_cast<Micros>(random_() % 500);
    answer.header = n % 70 == 3 ? fmt::format("Z\1{:014}", n) : "";
    before_[{robot, source}] = answer.body;
    ingest_.append(answer);
  }
};

/// What no answer of the log needs would not be tested.
std::vector<std::string> ways_of_storing() {
  std::vector<std::string> ways{
      "digits 0",           "digits 1",   "digits 5", "exceptions", "low bits", "method 1 with base",
      "method 2 with base", "one by one", "shorter",  "sparse",     "together"};
  for (const char* table : {"block", "clock", "event", "gap", "hot", "manifest", "rollup"}) {
    ways.push_back(fmt::format("row of {}", table));
  }
  for (const auto& [name, count] :
       {std::pair{"form", 4}, {"kind", 8}, {"method", 3}, {"order", 4}, {"prediction", 4}}) {
    for (int i = 0; i < count; ++i) {
      ways.push_back(fmt::format("{} {}", name, i));
    }
  }
  return ways;
}

}  // namespace

TEST_CASE("a program written from the description of the format reads every answer as we do") {
  if (!python_is_here()) {
    return;
  }
  TempDir dir;
  const fs::path folder = dir / "log";
  { const Writing writing(folder); }
  REQUIRE(part_files(folder).size() == 3);
  std::set<std::string> used;
  for (const RobotId robot : {1U, 2U, 3U, 4U}) {
    for (const Source source : kSources) {
      INFO("robot " << robot << ", " << source_name(source));
      const std::vector<std::string> ours = read_by_us(folder, robot, source);
      const Outcome other = read_with_python(folder, robot, source);
      INFO(other.err);
      REQUIRE(other.code == 0);
      const std::vector<std::string> theirs = lines_of(other.out);
      CHECK(ours.size() > 1400);
      CHECK(theirs.size() == ours.size());
      const auto differs = std::mismatch(ours.begin(), ours.end(), theirs.begin(), theirs.end());
      if (differs.first != ours.end() && differs.second != theirs.end()) {
        CHECK(*differs.second == *differs.first);
      }
      CHECK(differs == std::pair(ours.end(), theirs.end()));
      for (const std::string& way : lines_of(other.err)) {
        used.insert(way);
      }
    }
  }
  for (const std::string& way : ways_of_storing()) {
    INFO(way);
    CHECK(used.count(way) == 1);
  }
}
