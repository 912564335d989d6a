// Any answers go into a block and come back byte for byte.

#include <random>

#include "samples/simulator/answers.hpp"
#include "schema/wire/registers.hpp"
#include "tests/schema/block_fixture.hpp"

using namespace tacho;
using namespace tacho::test;
using store::ColumnForm;

namespace {

/// Random JSON of all kinds, with white space, escapes and doubled keys.
class RandomJson {
 public:
  explicit RandomJson(std::uint64_t seed) : random_(seed) {}

  std::string object(int depth) {
    std::string out = "{" + space();
    const std::uint64_t count = random_() % 6;
    for (std::uint64_t i = 0; i < count; ++i) {
      out += (i > 0 ? "," + space() : "") + key() + space() + ":" + space() + value(depth);
    }
    return out + space() + "}";
  }

 private:
  std::mt19937_64 random_;

  std::string pick(const std::vector<std::string>& from) { return from[random_() % from.size()]; }
  std::string space() { return random_() % 8 == 0 ? pick({" ", "\n", "\t", "\r\n  "}) : ""; }
  std::string key() {
    return pick({"\"a\"", "\"b\"", "\"\"", "\"c.d\"", "\"e\\\\\"", "\"\\u0066\"", "\"0\"", "\"é\""});
  }
  std::string value(int depth) {
    switch (random_() % (depth > 0 ? 6 : 4)) {
      case 0:
        return pick({"0", "-0", "-0.0", "1", "15.0", "0.82", "1e-05", "1E+5", "-2.5e7", "123456789012345678",
                     std::to_string(static_cast<double>(random_()) / 1e12)});
      case 1:
        return pick({"true", "false", "null"});
      case 2:
        return pick({"\"\"", "\"x\"", "\"a\\/b\"", "\"\\ud83d\\ude00\"", "\"2026-01-08T23:11:52.705-1100\"",
                     "\"" + std::to_string(random_()) + "\""});
      case 3:
        return pick({"[]", "{}", "[ ]", "{ }", "[1,2,3]", "[[[]]]"});
      case 4:
        return object(depth - 1);
      default:
        return "[" + value(depth - 1) + "," + object(depth - 1) + "]";
    }
  }
};

std::string nested(std::size_t depth) { return "{\"a\":" + std::string(depth, '[') + std::string(depth, ']') + "}"; }

}  // namespace

TEST_CASE("the answers of a busy robot come back, none kept raw, in a tenth of their size") {
  sim::Robot robot(sim::busy_day(4), kBlockStart);
  sim::AnswerMaker maker(robot.scenario());
  std::vector<std::string> status;
  std::vector<std::string> io;
  std::size_t bytes = 0;
  for (std::size_t row = 0; row < 300; ++row) {
    const sim::RobotState& state = robot.at(kBlockStart + static_cast<Micros>(row) * 1'000'000);
    status.push_back(maker.status(state, {}, row % 100 == 50));
    io.push_back(maker.io(state));
    bytes += status.back().size();
  }
  const Encoded encoded = check_columnar(status);
  CHECK(encoded.block.size() * 10 < bytes);
  check_columnar(io, Source::io);
}

TEST_CASE("keys that come and go cost a shape each, not the columns") {
  std::vector<std::string> bodies;
  for (int row = 0; row < 400; ++row) {
    const std::string x = "\"x\":" + std::to_string(row) + ".25";
    bodies.push_back(row % 3 == 0   ? "{" + x + ",\"block_reason\":3}"
                     : row % 7 == 0 ? "{\"slow_reason\":1," + x + "}"
                                    : "{" + x + "}");
  }
  const Encoded encoded = check_columnar(bodies);
  CHECK(encoded.stats.shapes == 3);
  CHECK(column_of(encoded.block, "x").count == 400);
  CHECK(encoded.block.size() < 600);
}

TEST_CASE("arrays of one shape are opened when they change often, others are texts") {
  std::vector<std::string> bodies;
  std::mt19937_64 random(1);
  for (int row = 0; row < 200; ++row) {
    const std::string number = std::to_string(static_cast<double>(random() % 100000) / 1000);
    const std::string path = row / 50 == 1 ? "[\"LM1\",\"LM2\"]" : "[]";
    bodies.push_back("{\"motors\":[{\"position\":" + number + ",\"name\":\"walk\"}],\"path\":" + path + "}");
  }
  const Encoded encoded = check_columnar(bodies);
  CHECK(column_of(encoded.block, "motors").form == ColumnForm::composite);
  CHECK(column_of(encoded.block, "path").form == ColumnForm::texts);
}

TEST_CASE("strings that count are numbers inside") {
  std::vector<std::string> bodies;
  for (int row = 0; row < 200; ++row) {
    const std::string second = std::to_string(100 + row % 60).substr(1);
    const std::string stamp = std::to_string(4'521'793'660'584 + row * 1'000'000'000LL);
    bodies.push_back(R"({"create_on":"2026-01-08T23:11:)" + second + R"(.705-1100","nsec":")" + stamp + R"("})");
  }
  const Encoded encoded = check_columnar(bodies);
  CHECK(column_of(encoded.block, "create_on").form == ColumnForm::composite);
  CHECK(column_of(encoded.block, "nsec").bytes < 100);
}

TEST_CASE("white space, escapes and the order of keys are part of the answer") {
  std::vector<std::string> bodies;
  for (int row = 0; row < 50; ++row) {
    bodies.push_back("{\n  \"map\" : \"a\\/b\\u0041\",\r\n\t\"n\" : " + std::to_string(row) + "\n}\n");
  }
  check_columnar(bodies);
}

TEST_CASE("doubled keys come back in their places") {
  std::vector<std::string> bodies;
  for (int row = 0; row < 50; ++row) {
    const std::string n = std::to_string(row);
    bodies.push_back(R"({"a":)" + n + R"(,"a":"x)" + n + R"(","b":{"a":1},"b":{"a":)" + n + "}}");
  }
  check_columnar(bodies);
}

TEST_CASE("what is no JSON object is kept as it is") {
  std::vector<std::string> bodies{"",
                                  "not json",
                                  "[1,2]",
                                  "17",
                                  "{\"v\":NaN}",
                                  "{\"v\":01}",
                                  "{\"v\":1e999}",
                                  "{\"v\":99999999999999999999}",
                                  "{\"v\":\"\xff\xfe\"}",
                                  "{\"v\":\"\\ud800\"}",
                                  std::string("{\"v\":\"\0\"}", 9),
                                  std::string("\x1f\x8b\x08\0\0", 5),
                                  "{\"v\":1}{",
                                  "{\"v\":1,}",
                                  nested(100),
                                  nested(100'000)};
  const std::vector<Answer> answers = answers_of(bodies);
  const Encoded encoded = encode(answers);
  check_answers(encoded.block, answers);
  CHECK(encoded.stats.raw_rows == bodies.size());
  CHECK(encoded.stats.unlike_rows == 0);
}

TEST_CASE("raw answers between others cost only themselves") {
  std::vector<std::string> bodies;
  for (int row = 0; row < 100; ++row) {
    bodies.push_back(row % 10 == 3 ? "broken " + std::to_string(row) : "{\"v\":" + std::to_string(row) + "}");
  }
  const std::vector<Answer> answers = answers_of(bodies);
  const Encoded encoded = encode(answers);
  check_answers(encoded.block, answers);
  CHECK(encoded.stats.raw_rows == 10);
  store::BlockDecoder decoder;
  REQUIRE(decoder.open(encoded.block).empty());
  std::vector<std::size_t> rows;
  CHECK(decoder.raw_bodies([&](std::size_t row, std::string_view body) {
    rows.push_back(row);
    CHECK(body == bodies[row]);
  }) == "");
  CHECK(rows.size() == 10);
}

TEST_CASE("unusual headers, late answers and numbers with holes come back") {
  std::vector<Answer> answers = answers_of(std::vector<std::string>(40, "{\"v\":1}"));
  answers[7].header = std::string("\x5a\x02\0\1\0\0\0\7\x2a\xf8\4\x4c\0\0\1\2", 16);
  answers[8].meta.t_recv_us = answers[8].meta.t_send_us - 5'000'000;
  answers[9].meta.t_send_us = std::numeric_limits<Micros>::max();
  answers[10].meta.t_recv_us = std::numeric_limits<Micros>::min();
  answers[20].meta.seq = 1'000'000;
  answers[30].meta.seq = std::numeric_limits<std::uint64_t>::max();
  check_answers(encode(answers).block, answers);
}

TEST_CASE("a block holds one stream and no more rows than it should") {
  store::BlockEncoder encoder({2, 3, WordOrder::cdab});
  CHECK(encoder.finish().empty());
  Answer answer = answer_of("{}", 0);
  REQUIRE(encoder.add(answer));
  Answer other = answer;
  other.meta.session = 9;
  CHECK_FALSE(encoder.add(other));
  REQUIRE(encoder.add(answer));
  CHECK_FALSE(encoder.add(answer));
  CHECK_FALSE(encoder.finish().empty());
  CHECK(encoder.rows() == 0);
  REQUIRE(encoder.add(other));
}

TEST_CASE("any JSON document comes back") {
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    RandomJson json(seed);
    std::vector<std::string> bodies;
    const std::string again = json.object(4);
    for (int row = 0; row < 60; ++row) {
      bodies.push_back(row % 3 == 0 ? again : json.object(4));
    }
    const std::vector<Answer> answers = answers_of(bodies);
    const Encoded encoded = encode(answers);
    check_answers(encoded.block, answers);
    CHECK(encoded.stats.raw_rows == 0);
  }
}

TEST_CASE("bytes cut out of answers come back whatever they are") {
  std::mt19937_64 random(17);
  RandomJson json(99);
  std::vector<std::string> bodies;
  for (int row = 0; row < 500; ++row) {
    std::string body = json.object(3);
    body[random() % body.size()] = static_cast<char>(random());
    bodies.push_back(body.substr(0, 1 + random() % body.size()));
  }
  const std::vector<Answer> answers = answers_of(bodies);
  check_answers(encode(answers).block, answers);
}

TEST_CASE("register sweeps come back in every word order, also with ranges missing") {
  sim::Robot robot(sim::busy_day(2), kBlockStart);
  sim::AnswerMaker maker(robot.scenario());
  std::vector<std::string> images;
  std::vector<std::string> inputs;
  for (std::size_t row = 0; row < 200; ++row) {
    const sim::RobotState& state = robot.at(kBlockStart + static_cast<Micros>(row) * 200'000);
    const auto words = maker.registers(state);
    const auto bits = maker.inputs(state);
    std::string& image = images.emplace_back();
    if (row % 9 != 4) {
      wire::append_words(image, {1, 100}, std::span(words).subspan(0, 100));
    }
    if (row % 13 != 5 || image.empty()) {
      wire::append_words(image, {120, 21}, std::span(words).subspan(119, 21));
    }
    if (row == 150) {
      wire::append_words(image, {22, 3}, std::span(words).subspan(21, 3));  // cuts values, and comes twice
    }
    wire::append_bits(inputs.emplace_back(), {1, 80}, bits);
  }
  images.push_back("");
  images.push_back(images[0].substr(0, 77));
  const std::vector<Answer> answers = answers_of(images, Source::registers);
  for (const WordOrder order : {WordOrder::cdab, WordOrder::abcd, WordOrder::badc, WordOrder::dcba}) {
    const Encoded encoded = encode(answers, order);
    check_answers(encoded.block, answers);
    CHECK(encoded.stats.raw_rows == 2);
  }
  check_columnar(inputs, Source::inputs);
}

TEST_CASE("register images of random bytes come back") {
  std::mt19937_64 random(23);
  std::vector<std::string> images(300);
  for (std::string& image : images) {
    std::vector<std::uint16_t> words(1 + random() % 60);
    for (std::uint16_t& word : words) {
      word = static_cast<std::uint16_t>(random());
    }
    const auto first = static_cast<std::uint16_t>(1 + random() % 3);
    wire::append_words(image, {first, static_cast<std::uint16_t>(words.size())}, words);
  }
  const std::vector<Answer> answers = answers_of(images, Source::registers);
  check_answers(encode(answers).block, answers);
}
