// Speed of SQL over a log: one JSON object per line. Usage: sql_bench [HOURS]
//
// Six columns of `status` of one simulated robot at 1 Hz: read as the analyses read them, by a statement, and by the
// same statement over batches that are in memory already, which leaves the virtual table and SQLite alone.

#include <fmt/format.h>
#include <stdlib.h>

#include <chrono>
#include <filesystem>
#include <string>
#include <vector>

#include "samples/simulator/write.hpp"
#include "schema/log.hpp"
#include "schema/store/sql/sql_session.hpp"
#include "schema/store/sql/sqlite_export.hpp"

namespace {

using namespace tacho;
namespace fs = std::filesystem;

constexpr const char* kStatement =
    "select sum(x), sum(y), sum(vx), avg(battery_level), avg(current), sum(blocked) from status";

/// A log whose slices are in memory. Statements only: no answers as stored.
class Loaded final : public RowSource {
 public:
  Loaded(RowSource& log, const Selection& selection) : log_(&log) {
    for (const Robot& robot : log.robots()) {
      log.read(robot.id, {}, selection, [&](const Slice& slice) { slices_.push_back(slice); });
    }
  }
  [[nodiscard]] std::vector<Robot> robots() const override { return log_->robots(); }
  [[nodiscard]] std::vector<Session> sessions() const override { return log_->sessions(); }
  [[nodiscard]] std::vector<Stream> streams() const override { return log_->streams(); }
  [[nodiscard]] std::vector<Coverage> coverage() const override { return log_->coverage(); }
  [[nodiscard]] std::vector<UnknownKey> unknown_keys() const override { return {}; }
  [[nodiscard]] std::vector<ReadProblem> problems() const override { return {}; }
  /// Whole slices: the reader of rows leaves out what is outside of its window.
  void read(RobotId robot, Window window, const Selection&, const std::function<void(const Slice&)>& yield) override {
    for (const Slice& slice : slices_) {
      const Batch* batch = slice.find(Source::status);
      if (slice.robot == robot && batch != nullptr && batch->t_send_us.front() < window.to_us &&
          batch->t_send_us.back() >= window.from_us) {
        yield(slice);
      }
    }
  }
  void read_raw(RobotId, Source, Window, const std::function<void(const Answer&)>&) override {}

 private:
  RowSource* log_;
  std::vector<Slice> slices_;
};

void print(const char* name, double value, const char* unit) {
  fmt::print("{{\"name\":\"sql/{}\",\"value\":{:.6g},\"unit\":\"{}\"}}\n", name, value, unit);
}

template <class Work>
double seconds(Work work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

void run(RowSource& log, const std::string& sql) {
  store::sql::SqlSession session(log);
  session.run(
      sql, [](const std::vector<std::string>&) {}, [](std::span<const store::sql::SqlValue>) {});
}

void measure(const fs::path& folder, double hours) {
  sim::WriteOptions options;
  options.duration_us = static_cast<Micros>(hours * 3.6e9);
  sim::write_log({sim::busy_day(1)}, options, folder / "log");
  const std::vector<fs::path> paths{folder / "log"};
  const auto log = open_log(paths);
  const double rows = static_cast<double>(log->coverage().front().stored);

  Selection selection;
  for (const FieldIndex f :
       {field("x"), field("y"), field("vx"), field("battery_level"), field("current"), field("blocked")}) {
    selection.add(Source::status, f);
  }
  print("read_six_columns", rows / seconds([&] { log->read(1, {}, selection, [](const Slice&) {}); }), "rows/s");
  print("select_six_columns", rows / seconds([&] { run(*log, kStatement); }), "rows/s");
  print("select_first_ten", 1e3 * seconds([&] { run(*log, "select time, x, y from status limit 10"); }), "ms");
  print("select_one_minute",
        1e3 * seconds([&] {
          run(*log, "select x, y from status where time between '2026-01-01 00:30' and '2026-01-01 00:31'");
        }),
        "ms");
  Loaded loaded(*log, selection);
  print("select_six_columns_in_memory", rows / seconds([&] { run(loaded, kStatement); }), "rows/s");
  store::sql::SqliteExport what;
  what.robots = log->robots();
  what.sources = {Source::status};
  what.fields.set();
  print("export_sqlite_all_columns", rows / seconds([&] { store::sql::export_sqlite(*log, what, folder / "out.db"); }),
        "rows/s");
  print("export_sqlite_size", static_cast<double>(fs::file_size(folder / "out.db")) / rows, "B/row");
}

}  // namespace

int main(int argc, char** argv) {
  std::string folder = (fs::temp_directory_path() / "tacho-sql-bench-XXXXXX").string();
  if (mkdtemp(folder.data()) == nullptr) {
    return 1;
  }
  measure(folder, argc > 1 ? std::atof(argv[1]) : 12.0);
  fs::remove_all(folder);
  return 0;
}
