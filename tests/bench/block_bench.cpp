// Size and speed of column blocks: one JSON object per line. Usage: block_bench [ANSWERS]
//
// Data is profile S (schema/README.md): status answers of a simulated robot on a busy day at 1 Hz, register sweeps of
// the same robot at 5 Hz, once as its controller rounds them and once with noise in every bit of the floats; then the
// log of a whole day as the writer makes it, for both. With a file only the status figures, of the answers in it, one
// per line, taken as a second apart: what real_body.sh makes of one real answer, or `tacho-analyzer export --raw`.

#include <fmt/format.h>
#include <zstd.h>

#include <algorithm>
#include <bit>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <vector>

#include "samples/simulator/answers.hpp"
#include "samples/simulator/robot.hpp"
#include "samples/simulator/write.hpp"
#include "schema/store/block/block_decoder.hpp"
#include "schema/store/block/block_encoder.hpp"
#include "schema/store/sqlite.hpp"
#include "schema/wire/registers.hpp"
#include "tests/support/temp_dir.hpp"

namespace {

using namespace tacho;
using store::BlockDecoder;
using store::BlockEncoder;

constexpr Micros kT0 = 1'767'225'600'000'000;
/// Goals are those of this length: the one the log writer makes at 1 Hz.
constexpr std::size_t kDefault = store::BlockOptions{}.rows;
constexpr double kScanGoal = 20;
constexpr std::size_t kLengths[] = {60, 600, kDefault};

/// Of this process; other programs do not count.
double cpu_seconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

void print(const std::string& name, double value, const char* unit) {
  fmt::print("{{\"name\":\"blocks/{}\",\"value\":{:.6g},\"unit\":\"{}\"}}\n", name, value, unit);
}

constexpr double kNoGoal = 0;

/// A figure with a goal; `better` is "lower" or "higher".
void print(const std::string& name, double value, const char* unit, double limit, const char* better) {
  if (limit == kNoGoal) {
    print(name, value, unit);
    return;
  }
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

std::vector<Answer> answers_in(const std::string& file) {
  std::ifstream in(file);
  Clock clock(1'000'000);
  std::vector<Answer> answers;
  for (std::string line; std::getline(in, line);) {
    Answer& answer = answers.emplace_back();
    answer.meta = clock.next(Source::status);
    answer.body = line;
  }
  return answers;
}

sim::Scenario profile(bool rounded) {
  sim::Scenario scenario = sim::busy_day(1);
  scenario.registers_rounded = rounded;
  return scenario;
}

std::vector<Answer> sweeps(std::size_t rows, bool rounded) {
  const sim::Scenario scenario = profile(rounded);
  sim::Robot robot(scenario, kT0);
  sim::AnswerMaker maker(scenario);
  Clock clock(200'000);
  std::vector<Answer> answers;
  for (std::size_t i = 0; i < rows; ++i) {
    Answer& answer = answers.emplace_back();
    answer.meta = clock.next(Source::registers);
    const std::array<std::uint16_t, 140> words = maker.registers(robot.at(answer.meta.t_send_us));
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

/// Full-precision readings of a block: columns, and parts of columns, that are stored as bits.
struct Reals {
  std::size_t doubles = 0;
  std::size_t floats = 0;
  double double_bytes = 0;
  double float_bytes = 0;

  void add(const store::ColumnEntry& entry) {
    if (entry.form == store::ColumnForm::numbers && entry.style.kind == store::NumberKind::real64) {
      ++doubles;
      double_bytes += static_cast<double>(entry.length);
    } else if (entry.form == store::ColumnForm::numbers && entry.style.kind == store::NumberKind::real32) {
      ++floats;
      float_bytes += static_cast<double>(entry.length);
    }
    for (const store::ColumnEntry& child : entry.children) {
      add(child);
    }
  }
};

/// Of all blocks; the counts are those of the block that has most.
Reals reals_of(const Encoded& encoded) {
  Reals all;
  for (const std::string& block : encoded.blocks) {
    store::BlockHead head;
    store::BlockDirectory directory;
    Reals reals;
    store::WholeBlock bytes(block);
    if (store::read_block(bytes, head, directory).empty()) {
      for (const store::ColumnEntry& entry : directory.entries) {
        reals.add(entry);
      }
    }
    all.doubles = std::max(all.doubles, reals.doubles);
    all.floats = std::max(all.floats, reals.floats);
    all.double_bytes += reals.double_bytes;
    all.float_bytes += reals.float_bytes;
  }
  return all;
}

/// The goal for an answer: 50 B, and 6.5 B per full-precision reading.
void print_status_size(const Encoded& encoded, const std::string& length, double rows, bool goals) {
  constexpr double kPerReal = 6.5;
  constexpr double kRest = 50;
  const Reals reals = reals_of(encoded);
  const auto count = static_cast<double>(reals.doubles + reals.floats);
  print("status" + length, encoded.bytes / rows, "B/row", goals ? kRest + kPerReal * count : kNoGoal, "lower");
  print("status_doubles" + length, static_cast<double>(reals.doubles), "columns");
  print("status_floats" + length, static_cast<double>(reals.floats), "columns");
  if (reals.doubles > 0) {
    print("double" + length, reals.double_bytes / rows / static_cast<double>(reals.doubles), "B",
          goals ? kPerReal : kNoGoal, "lower");
  }
  print("status_rest" + length, (encoded.bytes - reals.double_bytes - reals.float_bytes) / rows, "B/row",
        goals ? kRest : kNoGoal, "lower");
}

/// Values of six numeric paths of all blocks, until it has taken long enough to be measured.
void scan(const Encoded& encoded, const std::vector<std::string>& paths, const std::string& name, double goal) {
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
  print(name, rows / (cpu_seconds() - start) / 1e6, "Mrows/s", goal, "higher");
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
    const bool goals = n == kDefault;
    print_status_size(encoded, length, rows, goals);
    print("status_to_lines" + length, encoded.bytes / lines, "1", goals ? 0.6 : kNoGoal, "lower");
    print("status_encode" + length, rows / encoded.seconds, "rows/s");
    read_all(encoded, "status_read_all" + length);
    scan(encoded, {"x", "y", "angle", "vx", "w", "battery_level"}, "status_scan_six" + length,
         goals ? kScanGoal : kNoGoal);
  }
}

void bench_registers(bool rounded) {
  constexpr std::size_t kRows = 18'000;
  const std::vector<Answer> answers = sweeps(kRows, rounded);
  const auto fields = static_cast<double>(std::count_if(
      kFields.begin(), kFields.end(), [](const Field& field) { return field.reg.present() && !field.reg.discrete; }));
  const std::string name = rounded ? "registers_rounded" : "registers_noisy";
  constexpr std::size_t kHalfHour = 9000;
  for (const std::size_t n : {std::size_t{600}, kHalfHour}) {
    const std::string length = fmt::format("_{}", n);
    const Encoded encoded = encode(answers, n);
    print(name + length, encoded.bytes / kRows, "B/row");
    const bool goals = n == kHalfHour;
    print(name + "_field" + length, encoded.bytes / kRows / fields, "B",
          !goals    ? kNoGoal
          : rounded ? 0.2
                    : 0.5,
          "lower");
    print(name + "_encode" + length, kRows / encoded.seconds, "rows/s");
    scan(encoded, {"3x1-2", "3x3-4", "3x5-6", "3x51-52", "3x55-56", "3x11-12"}, name + "_scan_six" + length,
         goals ? kScanGoal : kNoGoal);
  }
}

/// Bytes of numbers, times and places of the rows in all blocks.
double stamp_bytes(store::Connection& part) {
  double bytes = 0;
  store::Statement row(part, "SELECT data FROM block");
  for (row.query(); row.step();) {
    store::BlockHead head;
    store::BlockDirectory directory;
    store::WholeBlock block(row.bytes(0));
    if (store::read_block(block, head, directory).empty()) {
      for (const store::ColumnEntry& entry : directory.entries) {
        const bool stamp = entry.position == store::kSeqColumn || entry.position == store::kSendColumn ||
                           entry.position == store::kRoundTripColumn || entry.position == store::kPlaceColumn;
        bytes += stamp ? static_cast<double>(entry.length) : 0;
      }
    }
  }
  return bytes;
}

/// Profile S for a day, through the writer: the closed part as it lies on the disk.
void bench_day(bool rounded) {
  const test::TempDir dir;
  const sim::Scenario scenario = profile(rounded);
  sim::WriteOptions options;
  options.duration_us = 86'400'000'000;
  options.io_period_us = 500'000;
  options.registers_period_us = 200'000;
  options.inputs_period_us = 200'000;
  const double start = cpu_seconds();
  sim::write_log({scenario}, options, dir.path());
  const std::string name = rounded ? "day" : "day_noisy_registers";
  print(name + "_cpu", cpu_seconds() - start, "s");
  double total = 0;
  for (const auto& file : std::filesystem::directory_iterator(dir.path())) {
    if (file.path().extension() != ".db") {
      continue;
    }
    total += static_cast<double>(file.file_size());
    store::Connection part(file.path(), store::OpenMode::read);
    constexpr double kMegabyte = 1e6;
    const auto print_bytes = [&](const std::string& what, double bytes) {
      print(name + "_" + what, bytes / kMegabyte, "MB/robot-day");
    };
    for (std::size_t s = 0; s < kSourceCount; ++s) {
      const std::string source(source_name(static_cast<Source>(s)));
      print_bytes(source, static_cast<double>(part.integer(
                              fmt::format("SELECT ifnull(sum(length(data)), 0) FROM block WHERE source = {}", s))));
    }
    print_bytes("stamps_of_these", stamp_bytes(part));
    for (const char* table : {"event", "rollup", "clock"}) {
      print_bytes(table, static_cast<double>(part.integer(
                             fmt::format("SELECT ifnull(sum(pgsize), 0) FROM dbstat WHERE name = '{}'", table))));
    }
  }
  print(name, total / 1e6, "MB/robot-day", rounded ? 32 : kNoGoal, "lower");
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1) {
    const std::vector<Answer> answers = answers_in(argv[1]);
    if (answers.empty()) {
      fmt::print(stderr, "block_bench: {}: no answers; give a file with one JSON answer per line\n", argv[1]);
      return 1;
    }
    bench_status(answers);
    return 0;
  }
  constexpr std::size_t kRows = 7200;
  bench_status(simulated_status(kRows));
  for (const bool rounded : {true, false}) {
    bench_registers(rounded);
  }
  for (const bool rounded : {true, false}) {
    bench_day(rounded);
  }
}
