#include "schema/wire/registers.hpp"

#include <bit>
#include <limits>
#include <random>

#include "tests/support/catch.hpp"

using namespace tacho;
using namespace tacho::wire;

namespace {

// Input registers of three real robots, words as the robots stored them, documented addresses from 1.
// clang-format off
constexpr auto kWords20200719 = std::to_array<std::uint16_t>({
    50646, 49161, 26214, 16310, 60293, 16273, 8, 1, 6, 3, 14737, 16254, 0, 0, 0, 32768, 0, 32768, 0, 32768,
    0, 32768, 0, 32768, 0, 32768, 30505, 17947, 32768, 17865, 0, 0, 0, 0, 12, 0, 3, 2, 6, 21,
    0, 1, 0, 1, 0, 0, 10276, 49170, 43935, 16561, 0, 32768, 0, 32768, 0, 32768, 0, 32768, 0, 32768,
    0, 0, 0, 0, 0, 0, 0, 0, 65535, 192, 168, 4, 14, 0, 0, 0, 0, 0, 0, 0,
    4194, 16908, 0, 0, 0, 0, 0, 0, 0, 32768, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
});
constexpr auto kWords20200407 = std::to_array<std::uint16_t>({
    25376, 16530, 27368, 16459, 28941, 49224, 5, 1, 6, 3, 632, 16225, 80, 0, 0, 16832, 25428, 16977, 52429, 49036,
    25166, 16981, 16777, 16568, 18350, 16829, 27625, 18439, 49152, 17498, 0, 0, 0, 5, 5, 0, 3, 2, 4, 7,
    23, 1, 0, 1, 0, 0, 48864, 16524, 9018, 16526, 0, 32768, 0, 32768, 0, 32768, 0, 32768, 0, 32768,
    0, 1, 0, 0, 0, 0, 0, 0, 65535, 192, 168, 98, 125, 0, 0, 0, 0, 0, 0, 0,
    59638, 17139, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 32768, 0, 0, 0, 0, 0, 0,
});
constexpr auto kWords20180925 = std::to_array<std::uint16_t>({
    41684, 48892, 529, 49137, 60290, 16454, 65535, 0, 0, 0, 60322, 16253, 81, 0, 5243, 16888, 16253, 16856, 0, 16788,
    0, 16920, 0, 16896, 49283, 16832, 20777, 18107, 0, 16952, 0, 0, 0, 65535, 0, 0, 2, 1, 0, 0,
    3, 1, 0, 0, 2, 0, 45236, 48413, 9700, 49156, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
});
// clang-format on

const FieldSet kAll = FieldSet().set();

Gates gates_with(std::string_view flag, bool on) {
  Gates gates;
  gates.known.set(find_field(flag));
  gates.on.set(find_field(flag), on);
  return gates;
}

template <std::size_t N>
std::string image_of(const std::array<std::uint16_t, N>& words) {
  std::string image;
  append_words(image, {1, static_cast<std::uint16_t>(N)}, words);
  return image;
}

Sample decode(const std::string& image, const Gates& gates = {}, WordOrder order = WordOrder::cdab) {
  Sample sample;
  sample.meta.seq = 77;
  decode_registers(image, order, gates, kAll, sample);
  CHECK(sample.meta.seq == 77);
  return sample;
}

void put_f32(std::array<std::uint16_t, 140>& words, std::size_t address, float value,
             WordOrder order = WordOrder::cdab) {
  split_words(std::bit_cast<std::uint32_t>(value), order, words[address - 1], words[address]);
}

}  // namespace

TEST_CASE("the register snapshot of 2020-04-07 decodes to its known values", "[wire]") {
  const Sample s = decode(image_of(kWords20200407));
  REQUIRE(s.decodable);
  CHECK(s.at(field("battery_temp")).real == Approx(24.0));
  CHECK(s.at(field("controller_temp")).real == Approx(53.346).margin(5e-4));
  CHECK(s.at(field("voltage")).real == Approx(52.347).margin(5e-4));
  CHECK(s.at(field("current")).real == Approx(-1.1).margin(1e-6));
  CHECK(s.at(field("odo")).real == Approx(138671.64).margin(5e-3));
  CHECK(s.at(field("total_time")).real == Approx(875.0 * 3600.0));
  CHECK(s.at(field("battery_level")).real == Approx(0.80));
  CHECK(s.at(field("reloc_status_register")).integer == 1);
  CHECK(s.at(field("task_type")).integer == 3);
  CHECK(s.at(field("rfid")).state == State::not_supplied);  // -1: none read
  CHECK(s.at(field("rfid")).integer == -1);
  CHECK(s.at(field("ip_1")).integer == 192);
  CHECK(s.at(field("ip_4")).integer == 125);
  CHECK(s.at(field("clock_year")).state == State::absent);  // beyond what was read
  CHECK(s.at(field("blocked")).state == State::absent);     // an input, not a register
}

TEST_CASE("the register snapshot of 2018-09-25 decodes to its known values", "[wire]") {
  const Sample s = decode(image_of(kWords20180925));
  CHECK(s.at(field("voltage")).real == Approx(27.031).margin(5e-4));
  CHECK(s.at(field("current")).real == Approx(18.5).margin(5e-3));
  CHECK(s.at(field("battery_temp")).real == Approx(31.01).margin(5e-3));
  CHECK(s.at(field("odo")).real > 23975.6);
  CHECK(s.at(field("odo")).real < 23976.6);
  CHECK(s.at(field("battery_level")).real == Approx(0.81));
  CHECK(s.at(field("steer")).has());                        // 59-60, the last words read
  CHECK(s.at(field("jack_state")).state == State::absent);  // 61, not read
  CHECK(s.at(field("target_station_id")).integer == -1);
}

TEST_CASE("a sensor that answers -0.0 is not supplied, and its value is kept", "[wire]") {
  const Sample s = decode(image_of(kWords20200719));
  for (const FieldIndex f : {field("battery_temp"), field("voltage"), field("controller_temp"),
                             field("controller_humi"), field("controller_voltage")}) {
    INFO(kFields[f].name);
    CHECK(s.at(f).state == State::not_supplied);
    CHECK(s.at(f).real == 0.0);
    CHECK(std::signbit(s.at(f).real));
  }
  CHECK(s.at(field("vx")).has());  // -0.0 is an ordinary speed
  CHECK(s.at(field("vx")).real == 0.0);
}

TEST_CASE("a confidence of zero is no estimate", "[wire]") {
  std::array<std::uint16_t, 140> words{};
  CHECK(decode(image_of(words)).at(field("confidence")).state == State::not_supplied);
  put_f32(words, 11, 0.5f);
  CHECK(decode(image_of(words)).at(field("confidence")).has());
}

TEST_CASE("the block reason means something only while the input says blocked", "[wire]") {
  const std::string image = image_of(kWords20200407);
  CHECK(decode(image).at(field("block_reason")).state == State::not_meaningful);
  CHECK(decode(image).at(field("block_reason")).integer == 1);
  CHECK(decode(image, gates_with("blocked", false)).at(field("block_reason")).state == State::not_meaningful);
  CHECK(decode(image, gates_with("slowed", true)).at(field("block_x")).state == State::not_meaningful);
  const Sample blocked = decode(image, gates_with("blocked", true));
  CHECK(blocked.at(field("block_reason")).has());
  CHECK(blocked.at(field("block_x")).has());
  CHECK(blocked.at(field("slow_reason")).state == State::not_meaningful);
}

TEST_CASE("inputs set the gates that registers need, and a later answer changes them", "[wire]") {
  std::array<std::uint8_t, 80> bits{};
  bits[1] = 1;   // 2 blocked
  bits[22] = 1;  // 23 DI 3
  std::string image;
  append_bits(image, {1, 80}, bits);
  Gates gates;
  Sample sample;
  decode_inputs(image, FieldSet().set(field("di_3")), gates, sample);
  REQUIRE(sample.decodable);
  CHECK(sample.at(field("di_3")).integer == 1);
  CHECK(sample.at(field("blocked")).state == State::absent);  // not wanted, but it gates
  CHECK(gates.known.test(field("blocked")));
  CHECK(gates.on.test(field("blocked")));
  CHECK_FALSE(gates.on.test(field("slowed")));
  CHECK_FALSE(gates.known.test(field("di_3")));

  bits[1] = 0;
  image.clear();
  append_bits(image, {1, 80}, bits);
  decode_inputs(image, kAll, gates, sample);
  CHECK(gates.known.test(field("blocked")));
  CHECK_FALSE(gates.on.test(field("blocked")));
  CHECK(sample.at(field("blocked")).has());
  CHECK(sample.at(field("blocked")).integer == 0);
}

TEST_CASE("NaN and infinity are not numbers of this field", "[wire]") {
  for (const float value : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(),
                            -std::numeric_limits<float>::infinity()}) {
    std::array<std::uint16_t, 140> words{};
    put_f32(words, 1, value);
    CHECK(decode(image_of(words)).at(field("x")).state == State::wrong_type);
  }
}

TEST_CASE("32-bit and signed registers keep their sign", "[wire]") {
  std::array<std::uint16_t, 140> words{};
  split_words(70000, WordOrder::cdab, words[134], words[135]);
  words[33] = 0xFFFE;
  words[63] = 1234;
  const Sample s = decode(image_of(words));
  CHECK(s.at(field("battery_cycle")).integer == 70000);
  CHECK(s.at(field("current_station_id")).integer == -2);
  CHECK(s.at(field("jack_height")).real == Approx(1.234));
}

TEST_CASE("a value cut at the end of a range is absent, not half", "[wire]") {
  const std::array<std::uint16_t, 1> one{16832};
  std::string image;
  append_words(image, {1, 1}, one);  // first word of x only
  const Sample s = decode(image);
  CHECK(s.decodable);
  CHECK(s.at(field("x")).state == State::absent);
}

TEST_CASE("words put into any order come back", "[wire]") {
  std::mt19937 random(1);
  for (int i = 0; i < 1000; ++i) {
    const auto bits = static_cast<std::uint32_t>(random());
    for (const WordOrder order : {WordOrder::cdab, WordOrder::abcd, WordOrder::badc, WordOrder::dcba}) {
      std::uint16_t first = 0;
      std::uint16_t second = 0;
      split_words(bits, order, first, second);
      REQUIRE(join_words(first, second, order) == bits);
    }
  }
  CHECK(join_words(0x1122, 0x3344, WordOrder::abcd) == 0x11223344);
  CHECK(join_words(0x1122, 0x3344, WordOrder::cdab) == 0x33441122);
  CHECK(join_words(0x1122, 0x3344, WordOrder::badc) == 0x22114433);
  CHECK(join_words(0x1122, 0x3344, WordOrder::dcba) == 0x44332211);
}

TEST_CASE("an image decodes to the same values in the order it was written in", "[wire]") {
  for (const WordOrder order : {WordOrder::cdab, WordOrder::abcd, WordOrder::badc, WordOrder::dcba}) {
    std::array<std::uint16_t, 140> words{};
    put_f32(words, 1, -12.5f, order);
    put_f32(words, 27, 21773.948f, order);
    const Sample s = decode(image_of(words), {}, order);
    CHECK(s.at(field("x")).real == -12.5);
    CHECK(s.at(field("odo")).real == Approx(21773.948).epsilon(1e-6));
  }
}

TEST_CASE("the default plan is the vendor tool's requests", "[wire]") {
  CHECK(to_text(plan_ranges(false)) == "1-100,120-140");
  CHECK(to_text(plan_ranges(true)) == "1-80");
}

TEST_CASE("the fallback plan asks for documented addresses only", "[wire]") {
  CHECK(to_text(documented_runs(false)) == "1-13,15-62,64-66,69-73,79-84,89-98,120-131,135-136,139-140");
  CHECK(to_text(documented_runs(true)) == "1-17,19-35,60-75");
}

TEST_CASE("every value lies wholly inside one range of any plan", "[wire]") {
  for (const bool discrete : {false, true}) {
    for (std::uint16_t max_count = 2; max_count <= 125; ++max_count) {
      for (const std::uint16_t max_gap : std::initializer_list<std::uint16_t>{0, 1, 2, 5, 13, 20, 21, 200}) {
        const std::vector<Range> ranges = plan_ranges(discrete, max_count, max_gap);
        int outside = 0;
        int oversized = 0;
        for (const Field& f : kFields) {
          if (f.reg.present() && f.reg.discrete == discrete) {
            outside +=
                std::count_if(ranges.begin(), ranges.end(),
                              [&](const Range& r) {
                                return f.reg.address >= r.first && f.reg.address + f.reg.words() <= r.first + r.count;
                              }) == 1
                    ? 0
                    : 1;
          }
        }
        for (std::size_t i = 0; i < ranges.size(); ++i) {
          oversized += ranges[i].count > max_count ? 1 : 0;
          oversized += i > 0 && ranges[i].first < ranges[i - 1].first + ranges[i - 1].count ? 1 : 0;
        }
        INFO((discrete ? "inputs" : "registers") << " max_count " << max_count << " max_gap " << max_gap);
        REQUIRE(outside == 0);
        REQUIRE(oversized == 0);
      }
    }
  }
}

TEST_CASE("an image read in several ranges decodes like one read at once", "[wire]") {
  std::array<std::uint16_t, 140> words{};
  std::copy(kWords20200407.begin(), kWords20200407.end(), words.begin());
  words[125] = 2026;
  const Sample whole = decode(image_of(words));
  for (const std::uint16_t max_count : std::initializer_list<std::uint16_t>{2, 7, 30, 100}) {
    std::string image;
    for (const Range range : plan_ranges(false, max_count, 3)) {
      append_words(image, range, std::span(words).subspan(range.first - 1u, range.count));
    }
    const Sample parts = decode(image);
    for (std::size_t i = 0; i < kFieldCount; ++i) {
      INFO(kFields[i].name);
      CHECK(parts.cells[i].state == whole.cells[i].state);
      CHECK(parts.cells[i].real == whole.cells[i].real);
      CHECK(parts.cells[i].integer == whole.cells[i].integer);
    }
  }
}

TEST_CASE("bits survive an image for every count", "[wire]") {
  std::mt19937 random(2);
  for (std::uint16_t count = 1; count <= 80; ++count) {
    std::vector<std::uint8_t> bits(count);
    for (std::uint8_t& bit : bits) {
      bit = random() % 2;
    }
    std::string image;
    append_bits(image, {1, count}, bits);
    REQUIRE(image.size() == 4 + (count + 7u) / 8u);
    Gates gates;
    Sample sample;
    decode_inputs(image, kAll, gates, sample);
    REQUIRE(sample.decodable);
    for (const Field& f : kFields) {
      if (f.reg.discrete) {
        const Cell& cell = sample.at(find_field(f.name));
        REQUIRE(cell.has() == (f.reg.address <= count));
        REQUIRE((!cell.has() || cell.integer == bits[f.reg.address - 1u]));
      }
    }
  }
}

TEST_CASE("an image cut anywhere is undecodable or a whole number of ranges, never a crash", "[wire]") {
  std::array<std::uint16_t, 140> words{};
  std::string image;
  append_words(image, {1, 100}, std::span(words).first(100));
  append_words(image, {120, 21}, std::span(words).subspan(119));
  for (std::size_t length = 0; length <= image.size(); ++length) {
    const bool whole = length == 204 || length == image.size();
    Sample sample;
    decode_registers(std::string_view(image).substr(0, length), WordOrder::cdab, {}, kAll, sample);
    CHECK(sample.decodable == whole);
    CHECK(sample.at(field("x")).has() == whole);
    Gates gates;
    decode_inputs(std::string_view(image).substr(0, length), kAll, gates, sample);
  }
}

TEST_CASE("an image with an impossible range is undecodable", "[wire]") {
  const std::array<std::uint16_t, 2> words{1, 2};
  for (const Range range : {Range{0, 2}, Range{0xFFFF, 2}}) {
    std::string image;
    append_words(image, range, words);
    CHECK_FALSE(decode(image).decodable);
  }
  CHECK_FALSE(decode(std::string("\x00\x01\x00\x00", 4)).decodable);
}

TEST_CASE("real snapshots are most plausible low word first", "[wire]") {
  const auto best = [](const std::string& image) {
    const double cdab = plausibility(image, WordOrder::cdab);
    CHECK(cdab == 1.0);
    CHECK(plausibility(image, WordOrder::abcd) < cdab);
    CHECK(plausibility(image, WordOrder::badc) < cdab);
    CHECK(plausibility(image, WordOrder::dcba) < cdab);
  };
  best(image_of(kWords20200407));
  best(image_of(kWords20180925));
}

TEST_CASE("an image of zeros is evidence for no word order", "[wire]") {
  const std::array<std::uint16_t, 140> words{};
  CHECK(plausibility(image_of(words), WordOrder::cdab) == 0.0);
  CHECK(plausibility("", WordOrder::cdab) == 0.0);
}
