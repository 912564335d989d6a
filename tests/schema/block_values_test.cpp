// Values read from columns are those that decoding the answers gives.

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "samples/simulator/answers.hpp"
#include "schema/store/block/image_text.hpp"
#include "schema/wire/registers.hpp"
#include "schema/wire/status_json.hpp"
#include "tests/schema/block_fixture.hpp"

using namespace tacho;
using namespace tacho::test;
using store::BlockDecoder;
using store::ColumnValues;
using store::ValueKind;

namespace {

constexpr store::Want kAll{true, true, true};

ColumnValues values_of(BlockDecoder& decoder, const std::string& path, TextPool& pool) {
  ColumnValues values;
  INFO(path);
  REQUIRE(decoder.read(path, kAll, pool, values) == "");
  REQUIRE(values.kind.size() == decoder.head().rows);
  REQUIRE(values.real.size() == decoder.head().rows);
  REQUIRE(values.integer.size() == decoder.head().rows);
  REQUIRE(values.text.size() == decoder.head().rows);
  const auto like_first = [&](ValueKind kind) { return kind == values.kind.front(); };
  CHECK((!values.alike || std::all_of(values.kind.begin(), values.kind.end(), like_first)));
  return values;
}

/// Remembers which bytes of a block were asked for.
class WatchedBlock final : public store::BlockBytes {
 public:
  explicit WatchedBlock(std::string_view bytes) : bytes_(bytes), asked_(bytes.size()) {}
  std::size_t size() const override { return bytes_.size(); }
  std::string_view at(std::size_t offset, std::size_t length) override {
    const std::string_view part = bytes_.substr(offset, length);
    std::fill_n(asked_.begin() + static_cast<std::ptrdiff_t>(offset), part.size(), true);
    return part;
  }
  std::size_t count() const { return static_cast<std::size_t>(std::count(asked_.begin(), asked_.end(), true)); }
  std::size_t last() const {
    return asked_.size() - static_cast<std::size_t>(std::find(asked_.rbegin(), asked_.rend(), true) - asked_.rbegin());
  }

 private:
  std::string_view bytes_;
  std::vector<bool> asked_;
};

bool given(State state) {
  return state == State::present || state == State::not_supplied || state == State::not_meaningful;
}

/// The state before conditions and sensor marks, and the value, as the field table's kind asks for.
void check_cell(const Field& field, const ColumnValues& values, std::size_t row, const TextPool& pool,
                const Sample& sample, FieldIndex f) {
  const Cell& cell = sample.cells[f];
  const ValueKind kind = values.kind[row];
  const bool number = kind == ValueKind::number || kind == ValueKind::whole;
  const bool flag = kind == ValueKind::flag || (kind == ValueKind::whole && (values.integer[row] | 1) == 1);
  if (kind == ValueKind::absent || kind == ValueKind::null) {
    CHECK(cell.state == (kind == ValueKind::null ? State::null : State::absent));
    return;
  }
  switch (field.kind) {
    case Kind::real:
      REQUIRE(given(cell.state) == number);
      CHECK((!number || values.real[row] * field.json.scale == cell.real));
      return;
    case Kind::integer:
    case Kind::code:
      REQUIRE(given(cell.state) == (kind == ValueKind::whole));
      CHECK((kind != ValueKind::whole || values.integer[row] == cell.integer));
      return;
    case Kind::flag:
      REQUIRE(given(cell.state) == flag);
      CHECK((!flag || values.integer[row] == cell.integer));
      return;
    case Kind::text:
      REQUIRE(given(cell.state) == (kind == ValueKind::text));
      CHECK((kind != ValueKind::text || pool.at(values.text[row]) == sample.text(f)));
      return;
    case Kind::list:
    case Kind::structured: {
      const bool fits = kind == ValueKind::array || (kind == ValueKind::object && field.kind == Kind::structured);
      REQUIRE(given(cell.state) == fits);
      CHECK((!fits || pool.at(values.text[row]) == sample.text(f)));
      return;
    }
    case Kind::alarms:
    case Kind::points:
      CHECK(kind == ValueKind::array);
      return;
  }
}

void check_like_decoder(const std::vector<std::string>& bodies) {
  const std::vector<Answer> answers = answers_of(bodies);
  const Encoded encoded = encode(answers);
  BlockDecoder decoder;
  REQUIRE(decoder.open(encoded.block).empty());
  std::vector<Sample> samples(bodies.size());
  wire::JsonDecoder json;
  for (std::size_t row = 0; row < bodies.size(); ++row) {
    json.decode(bodies[row], FieldSet().set(), false, samples[row]);
  }
  TextPool pool;
  for (FieldIndex f = 0; f < kFieldCount; ++f) {
    const Field& field = kFields[f];
    if (field.json.key.empty()) {
      continue;
    }
    INFO(field.name);
    const ColumnValues values = values_of(decoder, std::string(field.json.key), pool);
    const ColumnValues former = values_of(decoder, std::string(field.json.former_key), pool);
    for (std::size_t row = 0; row < bodies.size(); ++row) {
      const bool old = values.kind[row] == ValueKind::absent && !field.json.former_key.empty();
      INFO("row " << row);
      check_cell(field, old ? former : values, row, pool, samples[row], f);
    }
  }
}

}  // namespace

TEST_CASE("fields of a busy robot read from columns as the decoder reads them from answers") {
  for (const sim::Scenario& scenario : {sim::busy_day(3), sim::busy_day(8)}) {
    sim::Robot robot(scenario, kBlockStart);
    sim::AnswerMaker maker(robot.scenario());
    std::vector<std::string> bodies;
    for (std::size_t row = 0; row < 120; ++row) {
      bodies.push_back(maker.status(robot.at(kBlockStart + static_cast<Micros>(row) * 5'000'000)));
    }
    check_like_decoder(bodies);
  }
}

TEST_CASE("absent, null, wrong types, fractions and large numbers keep apart") {
  const std::vector<std::string> values{"1",
                                        "0",
                                        "-0",
                                        "-0.0",
                                        "5.0",
                                        "7.5",
                                        "true",
                                        "false",
                                        "null",
                                        "\"3\"",
                                        "\"\\u00e9\\/\"",
                                        "[1,2]",
                                        "{\"a\":[1]}",
                                        "{}",
                                        "1e-05",
                                        "9007199254740993",
                                        "18446744073709551615"};
  std::vector<std::string> bodies{"{}"};
  for (const std::string& value : values) {
    bodies.push_back("{\"x\":" + value + ",\"battery_cycle\":" + value + ",\"blocked\":" + value + ",\"odd\":" + value +
                     ",\"current_map\":" + value + ",\"area_ids\":" + value + ",\"ref_pos\":" + value +
                     ",\"calib_status\":{\"status\":" + value + "}}");
  }
  check_like_decoder(bodies);
}

TEST_CASE("a path is read whatever form its column took") {
  std::vector<std::string> bodies;
  for (int row = 0; row < 100; ++row) {
    const std::string n = std::to_string(row);
    bodies.push_back(row == 50 ? std::string("junk")
                               : "{\"constant\":2.5,\"number\":" + n + ".5,\"mixed\":" + (row % 2 == 0 ? n : "null") +
                                     ",\"flag\":" + (row < 30 ? "true" : "false") + ",\"text\":\"t" + n +
                                     "\",\"list\":[" + n + "],\"object\":{ \"a\" : " + n + "}}");
  }
  const Encoded encoded = encode(answers_of(bodies));
  BlockDecoder decoder;
  REQUIRE(decoder.open(encoded.block).empty());
  TextPool pool;
  const ColumnValues constant = values_of(decoder, "constant", pool);
  const ColumnValues number = values_of(decoder, "number", pool);
  const ColumnValues mixed = values_of(decoder, "mixed", pool);
  const ColumnValues flag = values_of(decoder, "flag", pool);
  const ColumnValues text = values_of(decoder, "text", pool);
  const ColumnValues list = values_of(decoder, "list", pool);
  const ColumnValues object = values_of(decoder, "object", pool);
  const ColumnValues inside = values_of(decoder, "object.a", pool);
  const ColumnValues missing = values_of(decoder, "missing", pool);
  for (std::size_t row = 0; row < bodies.size(); ++row) {
    INFO("row " << row);
    CHECK(missing.kind[row] == ValueKind::absent);
    if (row == 50) {
      CHECK(number.kind[row] == ValueKind::absent);
      CHECK(object.kind[row] == ValueKind::absent);
      continue;
    }
    const std::string n = std::to_string(row);
    CHECK(constant.real[row] == 2.5);
    CHECK(number.kind[row] == ValueKind::number);
    CHECK(number.real[row] == static_cast<double>(row) + 0.5);
    CHECK(mixed.kind[row] == (row % 2 == 0 ? ValueKind::whole : ValueKind::null));
    CHECK(flag.integer[row] == (row < 30 ? 1 : 0));
    CHECK(pool.at(text.text[row]) == "t" + n);
    CHECK(list.kind[row] == ValueKind::array);
    CHECK(pool.at(list.text[row]) == "[" + n + "]");
    CHECK(object.kind[row] == ValueKind::object);
    CHECK(pool.at(object.text[row]) == "{ \"a\" : " + n + "}");
    CHECK(inside.integer[row] == static_cast<std::int64_t>(row));
  }
}

TEST_CASE("a column is read without the bytes of the others, and short ones without going far into the block") {
  std::vector<std::string> bodies;
  std::mt19937_64 random(21);
  for (int row = 0; row < 600; ++row) {
    std::string body = "{";
    for (int noise = 0; noise < 10; ++noise) {
      body += "\"a" + std::to_string(noise) + "\":0." +
              std::to_string(100'000'000'000'001 + random() % 400'000'000'000'000 * 2) + ",";
    }
    bodies.push_back(body + "\"short\":" + std::to_string(row / 7) + "}");
  }
  const Encoded encoded = encode(answers_of(bodies));
  WatchedBlock block(encoded.block);
  BlockDecoder decoder;
  REQUIRE(decoder.open(block).empty());
  TextPool pool;
  CHECK(values_of(decoder, "short", pool).integer[599] == 85);
  CHECK(block.count() < block.size() / 10);
  CHECK(block.last() < block.size() / 8);
  const std::size_t before = block.count();
  values_of(decoder, "a3", pool);
  CHECK(block.count() - before < block.size() / 9);
}

TEST_CASE("a dot inside a key is not a path") {
  const Encoded encoded =
      encode(answers_of({R"({"a.b":1,"a":{"b":2},"":{"c":3}})", R"({"a.b":1,"a":{"b":4},"":{"c":3}})"}));
  BlockDecoder decoder;
  REQUIRE(decoder.open(encoded.block).empty());
  TextPool pool;
  CHECK(values_of(decoder, "a.b", pool).integer == std::vector<std::int64_t>{2, 4});
  CHECK(values_of(decoder, "a\\.b", pool).integer == std::vector<std::int64_t>{1, 1});
  CHECK(values_of(decoder, "c", pool).kind[0] == ValueKind::absent);
}

TEST_CASE("times and statistics come without the bodies") {
  std::vector<std::string> bodies;
  for (int row = 0; row < 100; ++row) {
    bodies.push_back("{\"v\":" + std::to_string((row * 37) % 100 - 50) + ".25}");
  }
  const std::vector<Answer> answers = answers_of(bodies);
  const Encoded encoded = encode(answers);
  const store::ColumnInfo column = column_of(encoded.block, "v");
  CHECK(column.min == -50.25);
  CHECK(column.max == 49.25);
  CHECK(column.first == -50.25);
  BlockDecoder decoder;
  REQUIRE(decoder.open(encoded.block).empty());
  CHECK(decoder.head().seq_first == 100);
  CHECK(decoder.head().seq_last == 199);
  CHECK(decoder.head().t_first_us == answers.front().meta.t_send_us);
  CHECK(decoder.head().t_last_us == answers.back().meta.t_send_us);
  std::vector<std::uint64_t> seq;
  std::vector<Micros> send;
  std::vector<Micros> recv;
  REQUIRE(decoder.times(seq, send, recv) == "");
  for (std::size_t row = 0; row < answers.size(); ++row) {
    CHECK(seq[row] == answers[row].meta.seq);
    CHECK(send[row] == answers[row].meta.t_send_us);
    CHECK(recv[row] == answers[row].meta.t_recv_us);
  }
}

TEST_CASE("registers read from columns as the decoder reads them from images") {
  sim::Robot robot(sim::busy_day(6), kBlockStart);
  sim::AnswerMaker maker(robot.scenario());
  std::vector<std::string> images;
  for (std::size_t row = 0; row < 100; ++row) {
    std::string& image = images.emplace_back();
    auto words = maker.registers(robot.at(kBlockStart + static_cast<Micros>(row) * 200'000));
    if (row == 7) {
      wire::split_words(0x7FC00001U, WordOrder::cdab, words[0], words[1]);  // NaN
    }
    wire::append_words(image, {1, 100}, std::span(words).subspan(0, 100));
    if (row % 4 != 1) {
      wire::append_words(image, {120, 21}, std::span(words).subspan(119, 21));
    }
  }
  const Encoded encoded = encode(answers_of(images, Source::registers));
  BlockDecoder decoder;
  REQUIRE(decoder.open(encoded.block).empty());
  TextPool pool;
  for (FieldIndex f = 0; f < kFieldCount; ++f) {
    const Field& field = kFields[f];
    if (!field.reg.present() || field.reg.discrete) {
      continue;
    }
    INFO(field.name);
    const std::string path = store::register_path(field.reg.address, field.reg.words() == 2);
    const ColumnValues values = values_of(decoder, path, pool);
    for (std::size_t row = 0; row < images.size(); ++row) {
      Sample sample;
      wire::decode_registers(images[row], WordOrder::cdab, Gates{}, FieldSet().set(), sample);
      const Cell& cell = sample.cells[f];
      INFO("row " << row);
      REQUIRE((values.kind[row] == ValueKind::absent) == (cell.state == State::absent));
      if (!given(cell.state)) {
        continue;
      }
      if (field.kind == Kind::real) {
        const double real = field.reg.type == RegisterType::i16
                                ? static_cast<double>(static_cast<std::int16_t>(values.integer[row]))
                                : values.real[row];
        CHECK(real * field.reg.scale == cell.real);
      } else if (field.reg.type == RegisterType::f32) {
        CHECK(static_cast<std::int64_t>(values.real[row]) == cell.integer);
      } else {
        const bool narrow = field.reg.type == RegisterType::i16;
        CHECK((narrow ? static_cast<std::int16_t>(values.integer[row]) : values.integer[row]) == cell.integer);
      }
    }
  }
}

TEST_CASE("inputs are eight to a column") {
  std::vector<std::string> images(2);
  std::vector<std::uint8_t> bits(20);
  bits[1] = bits[9] = 1;
  wire::append_bits(images[0], {1, 20}, bits);
  bits[17] = 1;
  wire::append_bits(images[1], {1, 20}, bits);
  const Encoded encoded = check_columnar(images, Source::inputs);
  BlockDecoder decoder;
  REQUIRE(decoder.open(encoded.block).empty());
  TextPool pool;
  CHECK(values_of(decoder, "1x1-8", pool).integer == std::vector<std::int64_t>{2, 2});
  CHECK(values_of(decoder, "1x9-16", pool).integer == std::vector<std::int64_t>{2, 2});
  CHECK(values_of(decoder, "1x17-20", pool).integer == std::vector<std::int64_t>{0, 2});
}
