// However a robot's JSON library writes its numbers: through the log writer, every answer ends in columns and comes
// back byte for byte.

#include <charconv>
#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>
#include <random>

#include "samples/simulator/answers.hpp"
#include "schema/log.hpp"
#include "schema/store/block/block_decoder.hpp"
#include "schema/store/sqlite.hpp"
#include "tests/schema/store_fixture.hpp"

using namespace tacho;
using namespace tacho::test;
namespace fs = std::filesystem;

namespace {

constexpr std::size_t kRows = 120;

/// Answers of a busy robot, 7.5 KB each with 24 full-precision doubles.
const std::vector<std::string>& real_shaped() {
  static const std::vector<std::string> bodies = [] {
    const sim::Scenario scenario = sim::busy_day(4);
    sim::Robot robot(scenario, kT0);
    sim::AnswerMaker maker(scenario);
    std::vector<std::string> out;
    for (std::size_t row = 0; row < kRows; ++row) {
      out.push_back(maker.status(robot.at(kT0 + static_cast<Micros>(row) * kSecond)));
    }
    return out;
  }();
  return bodies;
}

using Print = std::function<std::string(double value, std::size_t number)>;

/// The body with every number that is not inside a string printed anew. Numbers are counted from the start of the body.
std::string restyled(const std::string& body, const Print& print) {
  std::string out;
  bool quoted = false;
  std::size_t number = 0;
  for (std::size_t at = 0; at < body.size(); ++at) {
    const char c = body[at];
    if (c == '"' && (at == 0 || body[at - 1] != '\\')) {
      quoted = !quoted;
    }
    if (quoted || (c != '-' && (c < '0' || c > '9'))) {
      out += c;
      continue;
    }
    const std::size_t end = body.find_first_not_of("0123456789.-+e", at);
    out += print(std::stod(body.substr(at, end - at)), number++);
    at = end - 1;
  }
  return out;
}

std::string printed(const char* format, double value) {
  std::array<char, 400> text{};
  return std::string(text.data(), static_cast<std::size_t>(std::snprintf(text.data(), text.size(), format, value)));
}

std::string shortest(double value) {
  std::array<char, 40> text{};
  return std::string(text.data(), std::to_chars(text.data(), text.data() + text.size(), value).ptr);
}

/// Every number now and then so small that it is printed with an exponent.
double scaled(double value, std::size_t number) { return number % 3 == 0 ? value * 1e-7 : value; }

struct Style {
  std::string name;
  std::function<std::string(const std::string&)> apply;
};

Style numbers(std::string name, Print print) {
  return {std::move(name), [print = std::move(print)](const std::string& body) { return restyled(body, print); }};
}

std::vector<Style> styles() {
  return {
      numbers("shortest round trip", [](double v, std::size_t) { return shortest(v); }),
      numbers("%.17g", [](double v, std::size_t) { return printed("%.17g", v); }),
      numbers("nine digits", [](double v, std::size_t) { return printed("%.9g", v); }),
      numbers("trailing zeros", [](double v, std::size_t) { return printed("%.6f", v); }),
      numbers("negative zeros",
              [](double v, std::size_t) { return std::abs(v) < 0.05 ? std::string("-0.0") : shortest(v); }),
      numbers("exponents of two digits", [](double v, std::size_t n) { return shortest(scaled(v, n)); }),
      numbers("exponents of one digit",
              [](double v, std::size_t n) {
                std::string text = shortest(scaled(v, n));
                const std::size_t padded = text.find("e-0");
                return padded == std::string::npos ? text : text.erase(padded + 2, 1);
              }),
      {"pretty-printed", [](const std::string& body) { return nlohmann::ordered_json::parse(body).dump(2) + "\n"; }},
      {"escaped slashes",
       [](const std::string& body) {
         std::string out = body;
         const std::string map = "\"current_map\":\"";
         const std::size_t at = out.find(map);
         REQUIRE(at != std::string::npos);
         out.insert(at + map.size(), "floor\\/1\\/");
         return out;
       }},
  };
}

struct Kept {
  std::uint32_t rows = 0;
  std::uint32_t raw = 0;
};

Kept kept_in(const fs::path& folder) {
  Kept kept;
  for (const fs::path& part : part_files(folder)) {
    store::Connection connection(part, store::OpenMode::read);
    store::Statement row(connection, "SELECT data FROM block");
    for (row.query(); row.step();) {
      store::BlockHead head;
      REQUIRE(store::read_head(row.bytes(0), head));
      kept.rows += head.rows;
      kept.raw += head.raw_rows;
    }
  }
  return kept;
}

void check_stored(const fs::path& folder, const std::vector<std::string>& bodies) {
  {
    Recording recording(folder);
    for (const std::string& body : bodies) {
      recording.poll(body);
    }
    recording.end();
  }
  store::LogReader log = open_reader(folder);
  const std::vector<Stored> out = stored(log);
  REQUIRE(out.size() == bodies.size());
  std::size_t different = 0;
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    different += out[i].body == bodies[i] ? 0U : 1U;
  }
  CHECK(different == 0);
  CHECK(log.problems().empty());
  CHECK(kept_in(folder).rows == bodies.size());
}

}  // namespace

TEST_CASE("however numbers are written, answers are columns in the log and come back byte for byte") {
  for (const Style& style : styles()) {
    INFO(style.name);
    std::vector<std::string> bodies;
    for (const std::string& body : real_shaped()) {
      bodies.push_back(style.apply(body));
    }
    TempDir dir;
    check_stored(dir.path(), bodies);
    CHECK(kept_in(dir.path()).raw == 0);
  }
}

TEST_CASE("documents that are deep, huge, doubled, broken or no JSON at all come back from the log byte for byte") {
  std::mt19937_64 random(20);
  const std::vector<std::string> values{"1e400",
                                        "-123456789012345678901234567890.5e-300",
                                        std::string(400, '9'),
                                        "\"\\ud800\"",
                                        "\"\\u0000\\/\\\"\\\\\"",
                                        "\"\xff\xfe\"",
                                        "\"\xed\xa0\x80\"",
                                        std::string(70, '[') + std::string(70, ']'),
                                        "{\"a\":{\"a\":1,\"a\":2},\"a\":[]}",
                                        "01",
                                        "-",
                                        "nul",
                                        "\"" + std::string(100'000, 'x') + "\"",
                                        "0.5"};
  std::vector<std::string> bodies{"", "{}", "[]", "null", std::string(3, '\0'), "\x1f\x8b\x08 compressed"};
  for (int row = 0; row < 400; ++row) {
    std::string body =
        "{\"v\":" + values[random() % values.size()] + ",\"v\":" + values[random() % values.size()] + "}";
    if (random() % 4 == 0) {
      body.resize(1 + random() % body.size());
    }
    if (random() % 4 == 0) {
      body[random() % body.size()] = static_cast<char>(random());
    }
    bodies.push_back(std::move(body));
  }
  TempDir dir;
  check_stored(dir.path(), bodies);
}
