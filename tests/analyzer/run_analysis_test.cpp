#include "analyzer/analyses/incident.hpp"
#include "analyzer/analysis.hpp"
#include "analyzer/commands/fields.hpp"
#include "analyzer/commands/info.hpp"
#include "analyzer/report/csv.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/memory_log.hpp"

using namespace tacho;
using test::MemoryLog;

namespace {

/// Counts rows per source, sums a field, and notes the order of merges.
class Counter final : public Analysis {
 public:
  explicit Counter(const RobotContext& context) : robots_(context.robot.name) {}
  void fold(const Slice& slice) override {
    for (const Batch& batch : slice.batches) {
      rows_[static_cast<std::size_t>(batch.source)] += static_cast<std::int64_t>(batch.rows());
      if (const Column* x = batch.find(field("x"))) {
        for (std::size_t i = 0; i < batch.rows(); ++i) {
          sum_ += x->has(i) ? x->real[i] : 0.0;
        }
      }
    }
    events_ += static_cast<std::int64_t>(slice.events.size());
  }
  void merge(Analysis& other) override {
    auto& o = dynamic_cast<Counter&>(other);
    robots_ += "," + o.robots_;
    for (std::size_t s = 0; s < kSourceCount; ++s) {
      rows_[s] += o.rows_[s];
    }
    sum_ += o.sum_;
    events_ += o.events_;
  }
  Section finish() override {
    Section section;
    section.name = "counter";
    section.tables = {{"t", "", {}, {{robots_, rows_[0], rows_[2], sum_, events_}}, false}};
    return section;
  }

 private:
  std::string robots_;
  std::array<std::int64_t, kSourceCount> rows_{};
  double sum_ = 0.0;
  std::int64_t events_ = 0;
};

std::unique_ptr<Analysis> make(const RobotContext& context) { return std::make_unique<Counter>(context); }
std::vector<Need> position() { return {{field("x"), {Source::status, Source::registers}}}; }
std::vector<Need> voltage() { return {{field("voltage"), {Source::registers}}}; }

constexpr AnalysisSpec kPosition{"position", "?", &position, &make};
constexpr AnalysisSpec kVoltage{"voltage", "?", &voltage, &make};

MemoryLog two_robots() {
  MemoryLog log;
  const RobotId a = log.add_robot("a");
  const RobotId b = log.add_robot("b");
  for (int i = 0; i < 10; ++i) {
    MemoryLog::set(log.row(a, Source::status, i), "x", 1.0);
    MemoryLog::set(log.row(a, Source::registers, i + 0.5), "voltage", 50.0);
    MemoryLog::set(log.row(b, Source::registers, i), "x", 2.0);
  }
  return log;
}

const std::vector<Value>& row(const Section& section) { return section.tables[0].rows[0]; }

}  // namespace

TEST_CASE("a field is read from the best source that ever gave it") {
  MemoryLog log = two_robots();
  RobotContext context;
  for (const Coverage& c : log.coverage()) {
    if (c.robot == 1) {
      context.coverage.push_back(c);
    }
  }
  CHECK(context.choose({field("x"), {Source::registers, Source::status}}) == Source::status);
  CHECK(context.choose({field("voltage"), {Source::status, Source::registers}}) == Source::registers);
  CHECK_FALSE(context.choose({field("odo"), {Source::status, Source::registers}}));
  CHECK(context.find(Source::status)->stored == 10);
  CHECK(context.find(Source::io) == nullptr);
}

TEST_CASE("a source that has a field but never a value of it does not hide one that has") {
  RobotContext context;
  Coverage status;
  status.source = Source::status;
  status.stored = 10;
  status.seen.set(field("battery_temp")).set(field("voltage"));
  Coverage registers = status;
  registers.source = Source::registers;
  registers.valued.set(field("voltage"));
  context.coverage = {status, registers};
  const std::vector<Source> both{Source::status, Source::registers};
  CHECK(context.choose({field("voltage"), both}) == Source::registers);
  CHECK(context.choose({field("battery_temp"), both}) == Source::status);  // no source has a value: the best of them
  context.coverage[0].valued.set(field("voltage"));
  CHECK(context.choose({field("voltage"), both}) == Source::status);
}

TEST_CASE("info tells fields that were never there from fields that never had a value") {
  MemoryLog log;
  const RobotId robot = log.add_robot("a");
  Sample& row = log.row(robot, Source::status, 0);
  MemoryLog::set(row, "x", 1.0);
  MemoryLog::set_state(row, "battery_temp", State::null);
  MemoryLog::set_state(row, "block_reason", State::not_meaningful);
  const Section section = commands::info(log, {log.robots()});
  const auto table = std::find_if(section.tables.begin(), section.tables.end(),
                                  [](const DataTable& t) { return t.name == "never_seen"; });
  REQUIRE(table != section.tables.end());
  REQUIRE(table->rows.size() == 1);
  const auto text = [&](std::size_t column) { return std::get<std::string>(table->rows[0][column]); };
  CHECK(text(4).find("battery_temp") == std::string::npos);
  CHECK(text(4).find("voltage") != std::string::npos);
  CHECK(std::get<std::int64_t>(table->rows[0][5]) == 2);
  CHECK(text(6).find("battery_temp") != std::string::npos);
  CHECK(text(6).find("block_reason") != std::string::npos);
}

TEST_CASE("robots are folded apart and merged in the order of their ids") {
  MemoryLog log = two_robots();
  const Section section = run_analysis(kPosition, log, {}, {}, "UTC", {});
  CHECK(std::get<std::string>(row(section)[0]) == "a,b");
  CHECK(std::get<std::int64_t>(row(section)[1]) == 10);
  CHECK(std::get<std::int64_t>(row(section)[2]) == 10);
  CHECK(std::get<double>(row(section)[3]) == 30.0);
}

TEST_CASE("only the robots and the period asked for are read") {
  MemoryLog log = two_robots();
  const std::vector<RobotId> second{2};
  const Window window{MemoryLog::micros(2.0), MemoryLog::micros(5.0)};
  const Section section = run_analysis(kPosition, log, second, window, "UTC", {});
  CHECK(std::get<std::string>(row(section)[0]) == "b");
  CHECK(std::get<double>(row(section)[3]) == 6.0);
}

TEST_CASE("several analyses in one pass see what each would see alone") {
  MemoryLog log = two_robots();
  const std::vector<AnalysisSpec> specs{kPosition, kVoltage};
  const std::vector<Section> together = run_analyses(specs, log, {}, {}, "UTC", {});
  for (std::size_t i = 0; i < specs.size(); ++i) {
    const Section alone = run_analysis(specs[i], log, {}, {}, "UTC", {});
    INFO(specs[i].name);
    for (const std::size_t column : {1U, 2U}) {
      CHECK(std::get<std::int64_t>(row(together[i])[column]) == std::get<std::int64_t>(row(alone)[column]));
    }
  }
  CHECK(std::get<std::int64_t>(row(together[1])[1]) == 0);
}

TEST_CASE("cutting the log into other slices changes nothing") {
  for (const std::size_t rows : {0U, 1U, 3U, 7U}) {
    MemoryLog log = two_robots();
    log.slice_rows(rows);
    CHECK(std::get<double>(row(run_analysis(kPosition, log, {}, {}, "UTC", {}))[3]) == 30.0);
  }
}

TEST_CASE("a log without robots still gets an answer from every analysis") {
  MemoryLog log;
  const Section section = run_analysis(kPosition, log, {}, {}, "UTC", {});
  CHECK(section.name == "counter");
  CHECK(std::get<std::int64_t>(row(section)[1]) == 0);
  for (const AnalysisSpec& spec : analyses()) {
    INFO(spec.name);
    const Section empty = run_analysis(spec, log, {}, {}, "UTC", {});
    CHECK(empty.name == spec.name);
    for (const Finding& finding : empty.findings) {
      INFO(finding.id);
      CHECK((finding.verdict == Verdict::unknown || finding.verdict == Verdict::not_applicable));
    }
  }
}

namespace {

/// 26 hours in which something of everything happens: a stale alarm, a flood, a block, a charge, a jump.
MemoryLog eventful_robot() {
  MemoryLog log;
  const RobotId robot = log.add_robot("a");
  log.period(robot, Source::status, 60.0);
  for (int i = 0; i < 26 * 60; ++i) {
    Sample& s = log.row(robot, Source::status, 60.0 * i);
    const bool blocked = i >= 200 && i < 203;
    const bool charging = i % 480 >= 300 && i % 480 < 420;
    MemoryLog::no_alarms(s);
    MemoryLog::set(s, "x", (i < 500 ? 0.0 : 3.0) + 0.1 * (i % 60));
    MemoryLog::set(s, "y", 0.0);
    MemoryLog::set(s, "angle", 0.0);
    MemoryLog::set(s, "vx", blocked ? 0.0 : 0.5);
    MemoryLog::set(s, "vy", 0.0);
    MemoryLog::set(s, "w", 0.0);
    MemoryLog::set(s, "odo", 100.0 + 6.0 * i);
    MemoryLog::set(s, "confidence", 0.9);
    MemoryLog::set(s, "uptime", 60.0 * i);
    MemoryLog::set(s, "battery_level", charging ? 0.3 + 0.005 * (i % 480 - 300) : 0.9 - 0.002 * (i % 480));
    MemoryLog::set(s, "current", charging ? 20.0 : -5.0);
    MemoryLog::set(s, "voltage", 50.0);
    MemoryLog::set_int(s, "charging", charging ? 1 : 0);
    MemoryLog::set_int(s, "blocked", blocked ? 1 : 0);
    MemoryLog::set_int(s, "task_status", 2);
    MemoryLog::set_text(s, "current_map", "hall");
    if (i >= 10) {
      MemoryLog::alarm(s, AlarmLevel::warning, 54001, 0);
    }
    for (int code = 0; i >= 100 && i < 103 && code < 20; ++code) {
      MemoryLog::alarm(s, AlarmLevel::error, 52000 + code, 0);
    }
  }
  return log;
}

}  // namespace

TEST_CASE("every column that holds times says so, so that a table without rows has the same header") {
  MemoryLog log = eventful_robot();
  std::vector<std::string> filled;
  for (const AnalysisSpec& spec : analyses()) {
    for (const DataTable& table : run_analysis(spec, log, {}, {}, "UTC", {}).tables) {
      for (const std::vector<Value>& row : table.rows) {
        for (std::size_t c = 0; c < row.size(); ++c) {
          if (std::holds_alternative<Time>(row[c])) {
            INFO(spec.name << " " << table.name << " " << table.columns[c].name);
            REQUIRE(table.columns[c].time);
            filled.push_back(table.name);
          }
        }
      }
    }
  }
  for (const char* name : {"floods", "standing", "intervals", "episodes", "charge_sessions", "equivalent_full_cycles",
                           "battery_fields", "segments"}) {
    INFO(name);
    CHECK(std::find(filled.begin(), filled.end(), name) != filled.end());
  }
}

TEST_CASE("every cell is of the type that its column says") {
  const auto fits = [](const ColumnSpec& column, const Value& value) {
    const auto* q = std::get_if<Quantity>(&value);
    const bool integer = std::holds_alternative<std::int64_t>(value);
    if (std::holds_alternative<Missing>(value)) {
      return true;
    }
    if (q != nullptr && ((q->lo && !column.interval) ||
                         (!q->unit.empty() && column.unit.empty() && column.type != ColumnType::own_units))) {
      return false;
    }
    const bool number = integer || q != nullptr || std::holds_alternative<double>(value);
    switch (column.type) {
      case ColumnType::integer:
        return integer;
      case ColumnType::flag:
        return std::holds_alternative<bool>(value);
      case ColumnType::number:
      case ColumnType::exact:
      case ColumnType::own_units:
        return number;
      case ColumnType::plain:
        break;
    }
    if (column.time) {
      return std::holds_alternative<Time>(value);
    }
    return column.interval || !column.unit.empty() ? number : std::holds_alternative<std::string>(value);
  };
  MemoryLog log = eventful_robot();
  std::vector<Section> sections = run_analyses(analyses(), log, {}, {}, "UTC", {});
  sections.push_back(commands::info(log, {log.robots()}));
  sections.push_back(commands::fields());
  sections.push_back(commands::settings());
  IncidentQuery query;
  query.at_us = MemoryLog::micros(12'000.0);
  query.before_us = query.after_us = 600'000'000;
  sections.push_back(incident(log, {}, query, {}));
  for (const Section& section : sections) {
    std::vector<DataTable> tables{report::findings_table(section), report::evidence_table(section)};
    tables.insert(tables.end(), section.tables.begin(), section.tables.end());
    for (const DataTable& table : tables) {
      for (const std::vector<Value>& row : table.rows) {
        for (std::size_t c = 0; c < row.size(); ++c) {
          INFO(section.name << " " << table.name << " " << table.columns[c].name);
          CHECK(fits(table.columns[c], row[c]));
        }
      }
    }
  }
}
