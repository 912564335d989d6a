// How numbers are written in answers must survive, without costing the column its form.

#include <charconv>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <random>

#include "schema/store/block/number_style.hpp"
#include "tests/schema/block_fixture.hpp"

using namespace tacho;
using namespace tacho::test;
using store::ColumnForm;
using store::ColumnInfo;
using store::NumberKind;
using store::NumberStyle;

namespace {

constexpr std::size_t kRows = 300;

std::string printed(const char* format, double value) {
  char text[64];
  return std::string(text, static_cast<std::size_t>(std::snprintf(text, sizeof text, format, value)));
}

template <class Real>
std::string shortest(Real value) {
  char text[64];
  return std::string(text, std::to_chars(text, text + sizeof text, value).ptr);
}

/// Exponents as JavaScript prints them: 1e-7, 1e+21, fixed in between.
std::string short_exponent(double value) {
  std::string text = shortest(value);
  const std::size_t e = text.find("e-0");
  return e == std::string::npos ? text : text.erase(e + 2, 1);
}

double noise(std::size_t row, double size) {
  std::mt19937_64 random(row);
  return std::normal_distribution<double>(0, size)(random);
}

/// Bodies with one number; the column must be numbers with (nearly) no exceptions.
template <class Print>
ColumnInfo check_numbers(Print print, std::size_t exceptions = 0) {
  std::vector<std::string> bodies;
  for (std::size_t row = 0; row < kRows; ++row) {
    bodies.push_back("{\"v\":" + print(row) + ",\"w\":1}");
  }
  const Encoded encoded = check_columnar(bodies);
  const ColumnInfo column = column_of(encoded.block, "v");
  CHECK(column.form == ColumnForm::numbers);
  CHECK(column.exceptions <= exceptions);
  return column;
}

}  // namespace

TEST_CASE("plain integers are decimals without places") {
  const ColumnInfo column = check_numbers([](std::size_t row) { return std::to_string(1'280'000'000 + row * 1000); });
  CHECK(column.style.kind == NumberKind::decimal);
  CHECK(column.style.decimals == 0);
  CHECK(column.first == 1'280'000'000);
  CHECK(column.last == 1'280'000'000 + 299'000);
  CHECK(column.bytes < 20);
}

TEST_CASE("integers as large as 64 bits allow come back") {
  check_numbers([](std::size_t row) { return std::to_string(900'000'000'000'000'000 + static_cast<int>(row)); });
  std::vector<std::string> bodies;
  for (const char* v : {"9223372036854775807", "-9223372036854775808", "18446744073709551615", "0", "-1", "-0"}) {
    bodies.push_back("{\"v\":" + std::string(v) + "}");
  }
  check_columnar(bodies);
}

TEST_CASE("trailing zeros of fixed decimals stay") {
  const ColumnInfo column = check_numbers([](std::size_t row) { return printed("%.3f", noise(row, 10)); });
  CHECK(column.style.decimals == 3);
  CHECK(column.style.min_decimals == 3);
}

TEST_CASE("decimals cut to their shortest form stay so") {
  for (const int decimals : {1, 2, 4, 6}) {
    const ColumnInfo column = check_numbers([&](std::size_t row) {
      const double unit = std::pow(10, decimals);
      return shortest(std::round(noise(row, 3) * unit) / unit);
    });
    CHECK(column.style.decimals == decimals);
  }
}

TEST_CASE("negative zero is a number among integers and among decimals") {
  const auto some_zero = [](std::string number, std::size_t row, const char* zero) {
    return row % 5 == 0 ? std::string(zero) : number;
  };
  check_numbers([&](std::size_t row) { return some_zero(std::to_string(row), row, "-0.0"); });
  check_numbers([&](std::size_t row) { return some_zero(printed("%.2f", noise(row, 1)), row, "-0.00"); });
  check_numbers([&](std::size_t row) { return some_zero(shortest(std::round(noise(row, 50)) / 10), row, "-0.0"); }, 3);
  check_numbers([&](std::size_t row) { return some_zero(shortest(noise(row, 1)), row, "-0.0"); });
}

TEST_CASE("full-precision doubles keep the way their library prints them") {
  const auto wide = [](std::size_t row) { return noise(row, 1) * std::pow(10, static_cast<int>(row % 15) - 9); };
  const auto near_one = [](std::size_t row) { return 1 + noise(row, 0.1); };
  check_numbers([&](std::size_t row) { return nlohmann::json(wide(row)).dump(); }, 2);
  check_numbers([&](std::size_t row) { return nlohmann::json(row % 7 == 0 ? 1.0 : wide(row)).dump(); }, 2);
  check_numbers([&](std::size_t row) { return shortest(wide(row)); });
  check_numbers([&](std::size_t row) { return short_exponent(wide(row)); }, 5);
  check_numbers([&](std::size_t row) { return printed("%.17g", wide(row)); });
  check_numbers([&](std::size_t row) { return printed("%.15g", wide(row)); });
  check_numbers([&](std::size_t row) { return printed("%.16g", near_one(row)); });
  check_numbers([&](std::size_t row) { return printed("%.12g", wide(row)); });
}

TEST_CASE("a double that changes in every row costs at most 6.5 bytes where its size is known") {
  const ColumnInfo column = check_numbers([](std::size_t row) { return shortest(-9.67 + noise(row, 0.05)); });
  CHECK(column.style.kind == NumberKind::real64);
  CHECK(static_cast<double>(column.bytes) <= 6.5 * kRows);
}

TEST_CASE("floats are stored as floats, printed as floats or as doubles") {
  const auto single = [](std::size_t row) { return static_cast<float>(0.5 + noise(row, 0.1)); };
  const ColumnInfo widened = check_numbers([&](std::size_t row) { return shortest(static_cast<double>(single(row))); });
  CHECK(widened.style.kind == NumberKind::real32);
  CHECK(static_cast<double>(widened.bytes) < 3.6 * kRows);
  const ColumnInfo nine = check_numbers([&](std::size_t row) { return printed("%.9g", single(row)); });
  CHECK(nine.style.kind == NumberKind::real32);
  check_numbers([&](std::size_t row) { return shortest(single(row)); });
}

TEST_CASE("what does not fit the style of its column is an exception, not the end of the column") {
  const ColumnInfo column = check_numbers(
      [](std::size_t row) {
        return row % 50 == 0 ? std::string("null") : row % 77 == 0 ? "1E5" : shortest(noise(row, 1));
      },
      10);
  CHECK(column.exceptions > 5);
}

TEST_CASE("every value of every style has a text that reads back as the value") {
  std::mt19937_64 random(11);
  for (int round = 0; round < 2000; ++round) {
    NumberStyle style;
    style.decimals = static_cast<std::uint8_t>(random() % 18);
    style.min_decimals = static_cast<std::uint8_t>(random() % (style.decimals + 1U));
    const auto value = static_cast<std::int64_t>(random()) >> (6 + random() % 58);
    std::string text;
    append_number(style, value, text);
    INFO(text);
    CHECK(number_value(style, text) == value);
    std::string bytes;
    put_style(style, bytes);
    store::ByteReader in(bytes);
    NumberStyle taken;
    CHECK(store::take_style(in, taken));
    CHECK(taken == style);
    double real = 0;
    to_reals(style, {&value, 1}, &real);
    double read = 1;
    std::from_chars(text.data(), text.data() + text.size(), read);
    CHECK(real == read);
    CHECK(std::signbit(real) == std::signbit(read));
  }
}

TEST_CASE("many numbers become the reals that each becomes alone, to the last bit") {
  std::mt19937_64 random(13);
  constexpr std::size_t kCount = 1000;
  for (int round = 0; round < 400; ++round) {
    NumberStyle style;
    style.kind = static_cast<NumberKind>(random() % 8);
    style.decimals = static_cast<std::uint8_t>(random() % 18);
    style.min_decimals = style.decimals;
    // Small ones alone, then some that need all digits of a double, and more.
    const auto shift = static_cast<unsigned>(round % 4 == 0 ? 6 + random() % 8 : 13 + random() % 50);
    std::vector<std::int64_t> values(kCount);
    for (std::int64_t& value : values) {
      value = random() % 50 == 0 ? static_cast<std::int64_t>(random() % 3) - 2
                                 : static_cast<std::int64_t>(random()) >> shift;
    }
    std::vector<double> together(kCount);
    std::vector<double> alone(kCount);
    to_reals(style, values, together.data());
    for (std::size_t i = 0; i < kCount; ++i) {
      to_reals(style, {&values[i], 1}, &alone[i]);
    }
    INFO("kind " << static_cast<int>(style.kind) << " decimals " << int{style.decimals} << " shift " << shift);
    CHECK(std::memcmp(together.data(), alone.data(), kCount * sizeof(double)) == 0);
  }
}

TEST_CASE("integer columns of any shape come back") {
  std::mt19937_64 random(5);
  store::Packer packer(3);
  store::IntReader reader;
  for (int round = 0; round < 400; ++round) {
    const std::size_t count = 1 + random() % (round % 8 == 0 ? 3000 : 200);  // also several runs
    const auto width = static_cast<unsigned>(random() % 64);
    const auto sparse = random() % 4;
    const std::uint64_t step = round % 10 == 0 ? random() >> width : 0;  // else no straight line
    std::vector<std::int64_t> values(count);
    std::int64_t value = static_cast<std::int64_t>(random());
    for (std::int64_t& v : values) {
      if (step != 0) {
        value = static_cast<std::int64_t>(static_cast<std::uint64_t>(value) + step);
      } else if (sparse == 0 || random() % (1 + sparse * 5) == 0) {
        value = static_cast<std::int64_t>(static_cast<std::uint64_t>(value) + (random() >> width));
      }
      v = value;
    }
    std::string bytes;
    encode_ints(values, packer, bytes);
    store::ByteReader in(bytes);
    std::vector<std::int64_t> back;
    REQUIRE(reader.take(in, count, back));
    CHECK(in.left() == 0);
    CHECK(back == values);
  }
}
