// Speed of reading a log as columns: one JSON object per line. Usage: scan_bench [DAYS [FOLDER]]
// With FOLDER the log and the tables stay there, and serve the next run: a month takes a while to write.
// scan_bench status|registers LOG reads six columns of a log 40 times, for a profiler.
//
// One simulated robot, status at 1 Hz, registers at 5 Hz; the peer is the plain wide SQLite table that `export --format
// sqlite` writes, read by SQLite itself. Times are medians of interleaved rounds of CPU time,
// everything warm.

#include <fmt/format.h>
#include <stdlib.h>
#include <time.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include "analyzer/commands/info.hpp"
#include "samples/simulator/write.hpp"
#include "schema/log.hpp"
#include "schema/store/sql/sqlite_export.hpp"
#include "schema/store/sqlite.hpp"
#include "tests/support/measure.hpp"

namespace {

using namespace tacho;
namespace fs = std::filesystem;

constexpr int kRounds = 7;

struct Scan {
  Source source;
  std::vector<FieldIndex> fields;
  const char* sql;
};

const Scan kStatus{Source::status,
                   {field("x"), field("y"), field("vx"), field("battery_level"), field("current"), field("blocked")},
                   "select sum(x), sum(y), sum(vx), sum(battery_level), sum(current), sum(blocked) from status"};
const Scan kRegisters{Source::registers,
                      {field("x"), field("y"), field("vx"), field("battery_level"), field("current"), field("odo")},
                      "select sum(x), sum(y), sum(vx), sum(battery_level), sum(current), sum(odo) from registers"};

void print(const std::string& name, double value, const char* unit, double limit = 0, const char* better = "") {
  fmt::print("{{\"name\":\"scan/{}\",\"value\":{:.6g},\"unit\":\"{}\"", name, value, unit);
  if (limit != 0) {
    fmt::print(",\"limit\":{:g},\"better\":\"{}\"", limit, better);
  }
  fmt::print("}}\n");
}

double cpu_seconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

/// Of this thread, system calls included: what else runs on the machine does not count.
template <class Work>
double seconds(Work work) {
  const double start = cpu_seconds();
  work();
  return cpu_seconds() - start;
}

Selection selection_of(const Scan& scan) {
  Selection selection;
  selection.records = false;
  for (const FieldIndex f : scan.fields) {
    selection.add(scan.source, f);
  }
  return selection;
}

/// Of the values that are there. Four sums at once, or the additions wait for each other longer than reading takes.
template <class T>
double sum(const std::vector<T>& values, const std::vector<State>& states) {
  constexpr std::size_t kSums = 4;
  std::array<double, kSums> sums{};
  const auto at = [&](std::size_t i) { return states[i] == State::present ? static_cast<double>(values[i]) : 0.0; };
  std::size_t i = 0;
  for (; i + kSums <= values.size(); i += kSums) {
    for (std::size_t k = 0; k < kSums; ++k) {
      sums[k] += at(i + k);
    }
  }
  for (; i < values.size(); ++i) {
    sums[0] += at(i);
  }
  return sums[0] + sums[1] + sums[2] + sums[3];
}

/// What the reader is read for: a sum of every column.
double sum_columns(RowSource& log, const Selection& selection, Window window = {}) {
  double total = 0;
  log.read(1, window, selection, [&](const Slice& slice) {
    for (const Batch& batch : slice.batches) {
      for (const Column& column : batch.columns) {
        total += sum(column.real, column.state) + sum(column.integer, column.state);
      }
    }
  });
  return total;
}

double sum_sql(store::Connection& wide, const char* sql) {
  store::Statement statement(wide, sql);
  statement.query();
  double sum = 0;
  while (statement.step()) {
    for (int i = 0; i < 6; ++i) {
      sum += statement.real(i);
    }
  }
  return sum;
}

void export_table(RowSource& log, Source source, const fs::path& path) {
  store::sql::SqliteExport what;
  what.robots = log.robots();
  what.sources = {source};
  what.fields.set();
  store::sql::export_sqlite(log, what, path);
}

void against_wide_table(const std::string& name, RowSource& log, const Scan& scan, const fs::path& folder) {
  const Selection selection = selection_of(scan);
  const fs::path table_file = folder / (name + ".db");
  if (!fs::exists(table_file)) {
    export_table(log, scan.source, table_file);
  }
  store::Connection wide(table_file, store::OpenMode::read);
  double rows = 0;
  for (const Coverage& coverage : log.coverage()) {
    rows = coverage.source == scan.source ? static_cast<double>(coverage.stored) : rows;
  }
  std::vector<double> columns;
  std::vector<double> table;
  double mine = 0;
  double theirs = 0;
  for (int round = 0; round < kRounds; ++round) {
    columns.push_back(seconds([&] { mine = sum_columns(log, selection); }));
    table.push_back(seconds([&] { theirs = sum_sql(wide, scan.sql); }));
  }
  if (std::abs(mine - theirs) > 1e-6 * std::abs(theirs)) {
    fmt::print(stderr, "{}: sums differ: {} and {}\n", name, mine, theirs);
    std::exit(1);
  }
  print(name + "/six_columns", rows / test::median(columns), "rows/s", 20e6, "higher");
  print(name + "/six_columns_wide_table", rows / test::median(table), "rows/s");
  print(name + "/faster_than_wide_table", test::median(table) / test::median(columns), "x", 10, "higher");
}

void measure(const fs::path& folder, double days) {
  sim::WriteOptions options;
  options.duration_us = static_cast<Micros>(days * 86'400e6);
  options.status_period_us = 1'000'000;
  options.registers_period_us = 200'000;
  if (!fs::exists(folder / "log")) {
    sim::write_log({sim::busy_day(1)}, options, folder / "log");
  }
  const std::vector<fs::path> paths{folder / "log"};
  const auto log = open_log_fast(paths);
  against_wide_table("status", *log, kStatus, folder);
  against_wide_table("registers", *log, kRegisters, folder);

  Selection one;
  one.records = false;
  one.add(Source::status, field("battery_level"));
  const Micros from = options.t0_us + options.duration_us / 2;
  std::vector<double> hour;
  for (int round = 0; round < 10 * kRounds; ++round) {
    hour.push_back(seconds([&] { sum_columns(*log, one, {from, from + 3'600'000'000}); }));
  }
  print("one_hour_of_one_column", 1e3 * test::median(hour), "ms", 1, "lower");
}

/// 30 parts, one a day: opened alone, and with all that `info` tells of them.
void measure_opening(const fs::path& folder) {
  sim::WriteOptions options;
  options.duration_us = 30 * 86'400'000'000;
  options.status_period_us = 30'000'000;
  options.registers_period_us = 60'000'000;
  if (!fs::exists(folder / "month")) {
    sim::write_log({sim::busy_day(1)}, options, folder / "month");
  }
  const std::vector<fs::path> paths{folder / "month"};
  std::vector<double> opening;
  std::vector<double> telling;
  for (int round = 0; round < 3 * kRounds; ++round) {
    opening.push_back(seconds([&] {
      const auto log = open_log_fast(paths);
      if (log->coverage().empty() || log->robots().empty()) {
        std::exit(1);
      }
    }));
    telling.push_back(seconds([&] {
      const auto log = open_log_fast(paths);
      const auto* parts = dynamic_cast<const store::LogReader*>(log.get());
      if (commands::info(*log, log->robots(), parts, {}).tables.empty() || parts->parts().size() < 30) {
        std::exit(1);
      }
    }));
  }
  print("open_30_parts", 1e3 * test::median(opening), "ms", 10, "lower");
  print("open_and_info_30_parts", 1e3 * test::median(telling), "ms", 10, "lower");
}

}  // namespace

int main(int argc, char** argv) {
  const std::string first = argc > 1 ? argv[1] : "1";
  if (argc > 2 && (first == "status" || first == "registers")) {
    const std::vector<fs::path> paths{argv[2]};
    const auto log = open_log_fast(paths);
    for (int i = 0; i < 40; ++i) {
      sum_columns(*log, selection_of(first == "status" ? kStatus : kRegisters));
    }
    return 0;
  }
  std::string made = (fs::temp_directory_path() / "tacho-scan-bench-XXXXXX").string();
  if (argc < 3 && mkdtemp(made.data()) == nullptr) {
    return 1;
  }
  const fs::path folder = argc > 2 ? argv[2] : made;
  fs::create_directories(folder);
  measure(folder, std::stod(first));
  measure_opening(folder);
  if (argc < 3) {
    fs::remove_all(folder);
  }
  return 0;
}
