// Size and speed of column blocks: one JSON object per line. Usage: block_bench [ANSWER.json]
//
// Status answers are those of a simulated robot on a busy day at 1 Hz, register sweeps the same robot's at 5 Hz, once
// as its controller rounds them and once with noise in every bit of the floats that change. With a file, the answer in
// it is used instead: every number of 13 or more digits is moved a little in each row.

#include <fmt/format.h>
#include <zstd.h>

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <ctime>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

#include "samples/simulator/answers.hpp"
#include "samples/simulator/robot.hpp"
#include "schema/store/block/block_decoder.hpp"
#include "schema/store/block/block_encoder.hpp"
#include "schema/wire/registers.hpp"

namespace {

using namespace tacho;
using store::BlockDecoder;
using store::BlockEncoder;

constexpr Micros kT0 = 1'767'225'600'000'000;
constexpr std::size_t kLengths[] = {60, 300, 600, 3000};

/// Of this process; other programs do not count.
double cpu_seconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

void print(const std::string& name, double value, const char* unit) {
  fmt::print("{{\"name\":\"blocks/{}\",\"value\":{:.6g},\"unit\":\"{}\"}}\n", name, value, unit);
}

/// A figure with a goal; `better` is "lower" or "higher".
void print(const std::string& name, double value, const char* unit, double limit, const char* better) {
  fmt::print("{{\"name\":\"blocks/{}\",\"value\":{:.6g},\"unit\":\"{}\",\"limit\":{:g},\"better\":\"{}\"}}\n", name,
             value, unit, limit, better);
}

/// Polls at a steady rate, with the jitter of a network.
class Clock {
 public:
  explicit Clock(Micros period_us) : period_us_(period_us) {}
  AnswerMeta next(Source source) {
    AnswerMeta meta{1, source, 1, seq_, kT0 + static_cast<Micros>(seq_) * period_us_ + late_(random_), 0};
    meta.t_recv_us = meta.t_send_us + 3000 + late_(random_) * 10;
    ++seq_;
    return meta;
  }

 private:
  Micros period_us_;
  std::uint64_t seq_ = 0;
  std::mt19937_64 random_{7};
  std::uniform_int_distribution<Micros> late_{20, 120};
};

std::vector<Answer> simulated_status(std::size_t rows) {
  sim::Robot robot(sim::busy_day(1), kT0);
  sim::AnswerMaker maker(robot.scenario());
  Clock clock(1'000'000);
  std::vector<Answer> answers;
  for (std::size_t i = 0; i < rows; ++i) {
    Answer& answer = answers.emplace_back();
    answer.meta = clock.next(Source::status);
    answer.body = maker.status(robot.at(answer.meta.t_send_us));
  }
  return answers;
}

/// A number of the answer that moves.
struct Moving {
  std::size_t begin = 0;
  std::size_t end = 0;
  double value = 0;
  bool single = false;
};

std::vector<Moving> moving_numbers(const std::string& body) {
  std::vector<Moving> numbers;
  constexpr std::string_view kDigits = "0123456789.-+e";
  constexpr std::size_t kFull = 13;
  bool quoted = false;
  for (std::size_t at = 0; at < body.size(); ++at) {
    quoted = body[at] == '"' && body[at - 1] != '\\' ? !quoted : quoted;
    if (quoted || (body[at] != '-' && (body[at] < '0' || body[at] > '9'))) {
      continue;
    }
    const std::size_t end = std::min(body.find_first_not_of(kDigits, at), body.size());
    double value = 0;
    std::from_chars(body.data() + at, body.data() + end, value);
    if (end - at > kFull && value != std::floor(value)) {
      numbers.push_back({at, end, value, static_cast<double>(static_cast<float>(value)) == value});
    }
    at = end - 1;
  }
  return numbers;
}

std::vector<Answer> jittered(const std::string& file, std::size_t rows) {
  std::ifstream in(file);
  const std::string body{std::istreambuf_iterator<char>(in), {}};
  const std::vector<Moving> numbers = moving_numbers(body);
  print("moving_numbers", static_cast<double>(numbers.size()), "1");
  std::mt19937_64 random(3);
  std::normal_distribution<double> noise;
  Clock clock(1'000'000);
  std::vector<Answer> answers(rows);
  for (Answer& answer : answers) {
    answer.meta = clock.next(Source::status);
    std::size_t from = 0;
    for (const Moving& number : numbers) {
      answer.body.append(body, from, number.begin - from);
      const double moved = number.value * (1 + 1e-3 * noise(random));
      answer.body += fmt::format("{}", number.single ? static_cast<double>(static_cast<float>(moved)) : moved);
      from = number.end;
    }
    answer.body.append(body, from);
  }
  return answers;
}

/// `rounded`: floats to three decimals, as JSON answers have them; else as the controller computes them, noise in all
/// bits.
std::vector<Answer> sweeps(std::size_t rows, bool rounded) {
  sim::Robot robot(sim::busy_day(1), kT0);
  sim::AnswerMaker maker(robot.scenario());
  Clock clock(200'000);
  std::vector<Answer> answers;
  for (std::size_t i = 0; i < rows; ++i) {
    Answer& answer = answers.emplace_back();
    answer.meta = clock.next(Source::registers);
    std::array<std::uint16_t, 140> words = maker.registers(robot.at(answer.meta.t_send_us));
    for (const Field& field : kFields) {
      if (!rounded || field.reg.discrete || field.reg.type != RegisterType::f32) {
        continue;
      }
      std::uint16_t& first = words[field.reg.address - 1U];
      std::uint16_t& second = words[field.reg.address];
      const auto value = std::bit_cast<float>(wire::join_words(first, second, WordOrder::cdab));
      constexpr double kUnit = 1000;
      const auto near = static_cast<float>(std::round(static_cast<double>(value) * kUnit) / kUnit);
      wire::split_words(std::bit_cast<std::uint32_t>(near), WordOrder::cdab, first, second);
    }
    wire::append_words(answer.body, {1, 100}, std::span(words).subspan(0, 100));
    wire::append_words(answer.body, {120, 21}, std::span(words).subspan(119, 21));
  }
  return answers;
}

struct Encoded {
  std::vector<std::string> blocks;
  double bytes = 0;
  double seconds = 0;
};

Encoded encode(const std::vector<Answer>& answers, std::size_t length) {
  Encoded result;
  BlockEncoder encoder({length, 3, WordOrder::cdab});
  const double start = cpu_seconds();
  const auto finish = [&] {
    result.blocks.push_back(encoder.finish());
    result.bytes += static_cast<double>(result.blocks.back().size());
    if (encoder.stats().unlike_rows > 0) {
      fmt::print(stderr, "block_bench: {} answers did not fit their columns\n", encoder.stats().unlike_rows);
    }
  };
  for (const Answer& answer : answers) {
    if (!encoder.add(answer)) {
      finish();
      if (!encoder.add(answer)) {
        return result;
      }
    }
  }
  finish();
  result.seconds = (cpu_seconds() - start);
  return result;
}

/// The bodies as lines, zstd level 3, 1 MiB of text per frame.
double lines_bytes(const std::vector<Answer>& answers) {
  constexpr std::size_t kFrame = std::size_t{1} << 20U;
  std::string text;
  std::string packed;
  double bytes = 0;
  const auto flush = [&] {
    packed.resize(ZSTD_compressBound(text.size()));
    bytes += static_cast<double>(ZSTD_compress(packed.data(), packed.size(), text.data(), text.size(), 3));
    text.clear();
  };
  for (const Answer& answer : answers) {
    text += answer.body + "\n";
    if (text.size() >= kFrame) {
      flush();
    }
  }
  flush();
  return bytes;
}

/// Average size of a full-precision reading that is a column of its own.
void print_doubles(const Encoded& encoded, const std::string& length, double rows) {
  double bytes = 0;
  std::size_t doubles = 0;
  BlockDecoder decoder;
  for (const std::string& block : encoded.blocks) {
    if (!decoder.open(block).empty()) {
      return;
    }
    doubles = 0;
    for (const store::ColumnInfo& column : decoder.columns()) {
      const bool real = column.form == store::ColumnForm::numbers && column.style.kind == store::NumberKind::real64;
      bytes += real ? static_cast<double>(column.bytes) : 0;
      doubles += real ? 1 : 0;
    }
  }
  print("doubles" + length, static_cast<double>(doubles), "columns");
  constexpr double kGoal = 6.5;
  print("double" + length, bytes / rows / static_cast<double>(std::max<std::size_t>(doubles, 1)), "B", kGoal, "lower");
}

/// Values of six numeric paths of all blocks, until it has taken long enough to be measured.
void scan(const Encoded& encoded, const std::vector<std::string>& paths, const std::string& name) {
  BlockDecoder decoder;
  TextPool pool;
  store::ColumnValues values;
  double rows = 0;
  double sum = 0;
  const double start = cpu_seconds();
  constexpr double kLongEnough = 0.5;
  while ((cpu_seconds() - start) < kLongEnough) {
    for (const std::string& block : encoded.blocks) {
      if (!decoder.open(block).empty()) {
        return;
      }
      for (const std::string& path : paths) {
        if (!decoder.read(path, {true, false, false}, pool, values).empty() || values.real.empty()) {
          return;
        }
        sum += values.real.back();
      }
      rows += decoder.head().rows;
    }
  }
  constexpr double kGoal = 20;
  print(name, rows / (cpu_seconds() - start) / 1e6, "Mrows/s", kGoal, "higher");
  if (sum == 0) {
    fmt::print(stderr, "block_bench: nothing was read\n");
  }
}

void read_all(const Encoded& encoded, const std::string& name) {
  BlockDecoder decoder;
  double rows = 0;
  const double start = cpu_seconds();
  for (const std::string& block : encoded.blocks) {
    if (!decoder.open(block).empty() ||
        !decoder.answers([&](std::size_t, const Answer& answer) { rows += answer.body.empty() ? 0 : 1; }).empty()) {
      return;
    }
  }
  print(name, rows / (cpu_seconds() - start), "rows/s");
}

void bench_status(const std::vector<Answer>& answers) {
  const auto rows = static_cast<double>(answers.size());
  print("status_body", static_cast<double>(answers.front().body.size()), "B");
  const double lines = lines_bytes(answers);
  print("status_zstd_lines", lines / rows, "B/row");
  for (const std::size_t n : kLengths) {
    const std::string length = fmt::format("_{}", n);
    const Encoded encoded = encode(answers, n);
    print("status" + length, encoded.bytes / rows, "B/row");
    print("status_to_lines" + length, encoded.bytes / lines, "1");
    print_doubles(encoded, length, rows);
    print("status_encode" + length, rows / encoded.seconds, "rows/s");
    read_all(encoded, "status_read_all" + length);
    scan(encoded, {"x", "y", "angle", "vx", "w", "battery_level"}, "status_scan_six" + length);
  }
}

void bench_registers(bool rounded) {
  constexpr std::size_t kRows = 12'000;
  const std::vector<Answer> answers = sweeps(kRows, rounded);
  const auto fields = static_cast<double>(std::count_if(
      kFields.begin(), kFields.end(), [](const Field& field) { return field.reg.present() && !field.reg.discrete; }));
  const std::string name = rounded ? "registers_rounded" : "registers_noisy";
  for (const std::size_t n : kLengths) {
    const std::string length = fmt::format("_{}", n);
    const Encoded encoded = encode(answers, n);
    print(name + length, encoded.bytes / kRows, "B/row");
    print(name + "_field" + length, encoded.bytes / kRows / fields, "B", rounded ? 0.2 : 0.5, "lower");
    print(name + "_encode" + length, kRows / encoded.seconds, "rows/s");
    scan(encoded, {"3x1-2", "3x3-4", "3x5-6", "3x51-52", "3x55-56", "3x11-12"}, name + "_scan_six" + length);
  }
}

}  // namespace

int main(int argc, char** argv) {
  constexpr std::size_t kRows = 6000;
  bench_status(argc > 1 ? jittered(argv[1], kRows) : simulated_status(kRows));
  bench_registers(true);
  bench_registers(false);
}
