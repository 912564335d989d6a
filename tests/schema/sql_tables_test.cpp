// The tables of a log in SQL: what they hold is what the reader gives, whatever a statement asks for.

#include <set>

#include "schema/json_text.hpp"
#include "schema/store/sql/row_columns.hpp"
#include "schema/store/sql/row_scan.hpp"
#include "schema/store/sql/shared_log.hpp"
#include "schema/store/sql/time_text.hpp"
#include "schema/time.hpp"
#include "tests/schema/sql_fixture.hpp"
#include "tests/support/memory_log.hpp"

using namespace tacho;
using namespace tacho::test;
using namespace tacho::store::sql;

namespace {

constexpr std::array<Source, 4> kSources{Source::status, Source::io, Source::registers, Source::inputs};

/// What SQL should say of a field, written down independently of the tables.
SqlValue expected(const Batch& batch, std::size_t row, FieldIndex f) {
  const Column* column = batch.find(f);
  if (column == nullptr || !column->has(row)) {
    return {};
  }
  const Field& field = kFields[f];
  switch (field.kind) {
    case Kind::real:
      return column->real[row];
    case Kind::text:
    case Kind::list:
    case Kind::structured:
      return std::string(batch.text(*column, row));
    case Kind::alarms:
      return alarms_json(batch, row, field.name);
    case Kind::points:
      return points_json(batch, row, field.name == "do");
    default:
      return column->integer[row];
  }
}

/// All rows and all fields of a source in one piece, as the analyses get them.
std::vector<SqlRow> read_whole(RowSource& log, Source source) {
  Selection selection;
  selection.fields[static_cast<std::size_t>(source)].set();
  std::vector<SqlRow> rows;
  for (const Robot& robot : log.robots()) {
    log.read(robot.id, {}, selection, [&](const Slice& slice) {
      const Batch* batch = slice.find(source);
      for (std::size_t i = 0; batch != nullptr && i < batch->rows(); ++i) {
        SqlRow row{robot.name,          std::int64_t{slice.session}, static_cast<std::int64_t>(batch->seq[i]),
                   batch->t_send_us[i], batch->t_recv_us[i],         iso_utc(batch->t_send_us[i])};
        for (std::size_t f = 0; f < kFieldCount; ++f) {
          if (source_has(source, static_cast<FieldIndex>(f))) {
            row.push_back(expected(*batch, i, static_cast<FieldIndex>(f)));
          } else {
            const Column* column = batch->find(static_cast<FieldIndex>(f));
            CHECK((column == nullptr || column->state[i] == State::absent));
          }
        }
        rows.push_back(std::move(row));
      }
    });
  }
  return rows;
}

/// Remembers what was asked of a log.
class Spy final : public RowSource {
 public:
  explicit Spy(RowSource& log) : log_(&log) {}
  struct Read {
    RobotId robot;
    Window window;
    Selection selection;
  };
  std::vector<Read> reads;

  [[nodiscard]] std::vector<Robot> robots() const override { return log_->robots(); }
  [[nodiscard]] std::vector<Session> sessions() const override { return log_->sessions(); }
  [[nodiscard]] std::vector<Stream> streams() const override { return log_->streams(); }
  [[nodiscard]] std::vector<Coverage> coverage() const override { return log_->coverage(); }
  [[nodiscard]] std::vector<UnknownKey> unknown_keys() const override { return log_->unknown_keys(); }
  [[nodiscard]] std::vector<ReadProblem> problems() const override { return log_->problems(); }
  void read(RobotId robot, Window window, const Selection& selection,
            const std::function<void(const Slice&)>& yield) override {
    reads.push_back({robot, window, selection});
    log_->read(robot, window, selection, yield);
  }
  void read_raw(RobotId robot, Source source, Window window, const std::function<void(const Answer&)>& yield) override {
    log_->read_raw(robot, source, window, yield);
  }

 private:
  RowSource* log_;
};

}  // namespace

TEST_CASE("every column of every row is what the reader gives, read in one piece") {
  const auto log = open_sql_log();
  SqlSession session(*log);
  for (const Source source : kSources) {
    const std::string name(source_name(source));
    INFO(name);
    const std::vector<SqlRow> whole = read_whole(*log, source);
    REQUIRE(whole.size() > 400);
    const std::vector<SqlRow> rows = rows_of(session, "select * from " + name);
    REQUIRE(rows.size() == whole.size());
    for (std::size_t i = 0; i < rows.size(); ++i) {
      if (rows[i].size() != whole[i].size() || as_text({rows[i]}) != as_text({whole[i]})) {
        CHECK(as_text({rows[i]}) == as_text({whole[i]}));
        break;
      }
    }
  }
}

TEST_CASE("a column is a field that answers of the source can have, and its name needs no quotes") {
  const auto log = open_sql_log();
  SqlSession session(*log);
  for (const Source source : kSources) {
    std::set<std::string> names;
    for (const RowColumn& column : row_columns(source)) {
      INFO(source_name(source) << "." << column.name);
      CHECK(names.insert(column.name).second);  // SQL takes X for x: fields are in lower case
      CHECK(std::none_of(column.name.begin(), column.name.end(), [](char c) { return c >= 'A' && c <= 'Z'; }));
      CHECK_NOTHROW(rows_of(
          session, "select " + column.name + " from " + std::string(source_name(source)) + " where robot = 'nobody'"));
    }
  }
  CHECK(columns_of(session, "select * from io limit 1").front() == "robot");
}

TEST_CASE("columns past the 63 that SQLite tells apart are the same alone as all together") {
  const auto log = open_sql_log();
  SqlSession session(*log);
  const std::vector<RowColumn>& columns = row_columns(Source::status);
  const std::vector<SqlRow> all = rows_of(session, "select * from status where robot = 'amb-02'");
  std::size_t checked = 0;
  for (std::size_t c = 60; c < columns.size() && !columns[c].hidden; c += 11) {
    const std::vector<SqlRow> two =
        rows_of(session, "select x, " + columns[c].name + " from status where robot = 'amb-02'");
    REQUIRE(two.size() == all.size());
    for (std::size_t i = 0; i < two.size(); ++i) {
      REQUIRE(as_text(two[i][1]) == as_text(all[i][c]));
    }
    ++checked;
  }
  CHECK(checked > 5);
}

TEST_CASE("conditions that are pushed down give the rows of a full scan") {
  const auto log = open_sql_log();
  SqlSession session(*log);
  const std::string middle = std::to_string(kT0 + 600'000'000);
  const std::string later = std::to_string(kT0 + 700'500'000);
  // A unary plus keeps SQLite from pushing a condition down.
  const std::vector<std::pair<std::string, std::string>> conditions{
      {"robot", " = 'amb-02'"},
      {"robot", " in ('amb-02', 'amb-01', 'nobody')"},
      {"robot", " = 'AMB-02' collate nocase"},
      {"robot_id", " = 2"},
      {"t_send_us", " between " + middle + " and " + later},
      {"t_send_us", " >= " + middle + ".5"},
      {"t_send_us", " < " + middle},
      {"t_send_us", " = (select t_send_us from registers where seq = 77 and robot_id = 2)"},
      {"t_send_us", " > 'text'"},
      {"t_send_us", " < 'text'"},
      {"t_send_us", " > null"},
      {"t_send_us", " > 9.3e18"},
      {"t_send_us", " <= 9223372036854775807"},
      {"t_send_us", " >= -9223372036854775808"},
      {"time", " >= '2026-01-01 00:10'"},
      {"time", " > '2026-01-01T00:10:00.500Z'"},
      {"time", " <= '2026-01-01 00:10:00.501'"},
      {"time", " < '2026-01-01T00:10'"},
      {"time", " between '2026-01-01 00:08' and '2026-01-01 00:09'"},
      {"time", " = (select time from registers where seq = 77 and robot_id = 2)"},
      {"time", " >= '2026'"},
      {"time", " < 'yesterday'"},
      {"time", " > '2026-01-01T00:12:00Z' collate binary"},
  };
  for (const char* table : {"status", "registers"}) {
    for (const auto& [column, rest] : conditions) {
      const std::string figures =
          " count(*), min(t_send_us), max(t_send_us), sum(seq), sum(x), count(block_reason), sum(robot_id) from ";
      const std::string head = "select" + figures + table + " where ";
      INFO(head + column + rest);
      // The plus takes the collation of the column away as well.
      const bool own = column == "time" && rest.find("collate") == std::string::npos;
      const std::string plain = own ? "+" + column + rest + " collate tacho_time" : "+" + column + rest;
      CHECK(as_text(rows_of(session, head + column + rest)) == as_text(rows_of(session, head + plain)));
    }
  }
  CHECK(integer(session, "select count(*) from registers where time >= '2026-01-01 00:10'") > 1000);
  CHECK(integer(session, "select count(*) from status where robot_id = '1'") ==
        integer(session, "select count(*) from status where robot_id = 1"));
}

TEST_CASE("conditions joined by or give each row once") {
  const auto log = open_sql_log();
  SqlSession session(*log);
  const std::string t = std::to_string(kT0 + 600'000'000);
  for (const std::string table : {"status", "registers"}) {
    const std::string head = "select count(*), count(distinct rowid), sum(seq), sum(x) from " + table + " where ";
    const std::string pushed = "robot = 'amb-01' and t_send_us < " + t + " or robot = 'amb-02' and t_send_us > " + t +
                               " or t_send_us < " + t + " - 100000000";
    const std::string plain = "+robot = 'amb-01' and +t_send_us < " + t + " or +robot = 'amb-02' and +t_send_us > " +
                              t + " or +t_send_us < " + t + " - 100000000";
    CHECK(as_text(rows_of(session, head + pushed)) == as_text(rows_of(session, head + plain)));
    CHECK(integer(session, "select count(*) - count(distinct rowid) from " + table) == 0);
  }
  CHECK(integer(session, "select count(*) - count(distinct rowid) from event") == 0);
  CHECK(integer(session, "select count(*) from event where robot = 'amb-01' or robot_id = 2 and kind = 'station'") ==
        integer(session, "select count(*) from event where +robot = 'amb-01' or +robot_id = 2 and +kind = 'station'"));
}

TEST_CASE("a statement reads only its columns, its robot and its time") {
  const auto log = open_sql_log();
  Spy spy(*log);
  SqlSession session(spy);
  rows_of(session,
          "select x, y from status where robot = 'amb-02' and time >= '2026-01-01 00:10' and time < "
          "'2026-01-01 00:11'");
  REQUIRE(spy.reads.size() == 1);
  FieldSet both;
  both.set(field("x")).set(field("y"));
  CHECK(spy.reads[0].robot == 2);
  CHECK(spy.reads[0].selection.fields[static_cast<std::size_t>(Source::status)] == both);
  CHECK(spy.reads[0].selection.fields[static_cast<std::size_t>(Source::registers)].none());
  CHECK(spy.reads[0].window.from_us >= kT0 + 599'000'000);
  CHECK(spy.reads[0].window.to_us <= kT0 + 661'000'000);

  spy.reads.clear();
  CHECK(rows_of(session, "select time from registers limit 3").size() == 3);
  CHECK(spy.reads.size() == 1);  // the first stretch is enough

  spy.reads.clear();
  CHECK(rows_of(session, "select x from status where robot = 'nobody'").empty());
  CHECK(rows_of(session, "select x from status where t_send_us > null").empty());
  CHECK(rows_of(session, "select x from status where time < '2025-12-31'").empty());
  CHECK(spy.reads.empty());
}

TEST_CASE("codes have their words and missing values their reasons in hidden columns") {
  const auto log = open_sql_log();
  SqlSession session(*log);
  CHECK(integer(session, "select count(*) from registers where block_reason is not null") > 0);
  CHECK(integer(session,
                "select count(*) from registers r where block_reason is not null and block_reason_name is not "
                "(select name from code where list = (select code_list from field where name = "
                "'block_reason') and value = r.block_reason)") == 0);
  CHECK(integer(session,
                "select count(*) from registers where block_reason is null and "
                "json_extract(states, '$.block_reason') is not 'not_meaningful'") == 0);
  CHECK(integer(session,
                "select count(*) from registers where block_reason is not null and "
                "json_extract(states, '$.block_reason') is not null") == 0);
  CHECK(integer(session,
                "select count(*) from status where json_valid(fatals) and json_valid(di) and "
                "json_valid(states)") == integer(session, "select count(*) from status"));
}

TEST_CASE("a register means the same in a narrow window: the inputs before it are known") {
  const auto log = open_sql_log();
  SqlSession session(*log);
  const std::vector<SqlRow> blocked =
      rows_of(session, "select t_send_us, block_reason, block_x from registers where block_reason is not null");
  REQUIRE(blocked.size() > 10);
  for (std::size_t i = 0; i < blocked.size(); i += blocked.size() / 10) {
    CHECK(as_text(rows_of(session, "select t_send_us, block_reason, block_x from registers where t_send_us = " +
                                       as_text(blocked[i][0]))) == as_text({blocked[i]}));
  }
}

TEST_CASE("the plain tables are those of the whole log") {
  const auto log = open_sql_log();
  SqlSession session(*log);
  CHECK(integer(session, "select count(*) from robot") == 2);
  CHECK(integer(session, "select count(*) from stream") == 8);
  CHECK(integer(session, "select sum(planned = stored + missed) from coverage") == 8);
  for (const char* name : {"status", "io", "registers", "inputs"}) {
    CHECK(integer(session, "select count(*) from " + std::string(name)) ==
          integer(session, "select sum(stored) from coverage where source = '" + std::string(name) + "'"));
  }
  std::size_t events = 0;
  std::size_t gaps = 0;
  std::size_t points = 0;
  for (const Robot& robot : log->robots()) {
    log->read(robot.id, {}, {}, [&](const Slice& slice) {
      events += slice.events.size();
      gaps += slice.gaps.size();
      points += slice.clock.size();
    });
  }
  REQUIRE(gaps == 1);
  CHECK(integer(session, "select count(*) from event") == static_cast<std::int64_t>(events));
  CHECK(integer(session,
                "select sum(n) from (select robot, count(*) n from event e where robot in ('amb-01', 'amb-02') group "
                "by 1)") == static_cast<std::int64_t>(events));
  CHECK(integer(session, "select count(*) from clock") == static_cast<std::int64_t>(points));
  CHECK(as_text(rows_of(session, "select robot, source, cause, t_to_us - t_from_us from gap"))
            .find("'amb-01'|'inputs'|'timeout'|") == 0);
  CHECK(integer(session, "select count(*) from status s join robot r on r.id = s.robot_id where r.name = s.robot") ==
        integer(session, "select count(*) from status"));
  CHECK(integer(session, "select count(*) from field") == static_cast<std::int64_t>(kFieldCount));
  CHECK(integer(session, "select count(*) from problem") == 0);
}

TEST_CASE("robot is a name in every table, and robot_id its number beside it") {
  const auto log = open_sql_log();
  SqlSession session(*log);
  std::size_t with_robot = 0;
  for (const char* table : {"status", "io", "registers", "inputs", "stream", "coverage", "gap", "event", "clock",
                            "rollup", "unknown_key"}) {
    INFO(table);
    const std::string from = " from " + std::string(table);
    const auto count = [&](const std::string& rest) { return integer(session, "select count(*)" + from + rest); };
    CHECK(count(" where typeof(robot) not in ('text', 'null')") == 0);
    CHECK(count(" t where (robot is null) <> (robot_id = 0)") == 0);
    CHECK(count(" t join robot r on r.id = t.robot_id and r.name = t.robot") == count(" where robot is not null"));
    for (const char* name : {"amb-01", "amb-02", "none"}) {  // pushed down, and looked at row by row
      const std::string quoted = "'" + std::string(name) + "'";
      CHECK(count(" where robot = " + quoted) == count(" where +robot = " + quoted));
      CHECK(count(" where robot = upper(" + quoted + ") collate nocase") == count(" where robot = " + quoted));
      with_robot += count(" where robot = " + quoted) > 0 ? 1U : 0U;
    }
    for (const char* id : {"0", "1", "2", "7", "null"}) {
      CHECK(count(" where robot_id = " + std::string(id)) == count(" where +robot_id = " + std::string(id)));
    }
  }
  CHECK(with_robot >= 18);
  CHECK(columns_of(session, "select * from gap").front() == "robot");
  CHECK(columns_of(session, "select * from gap").back() == "detail");
}

TEST_CASE("rows around events: the inner table is read for the times of the outer one only") {
  const auto log = open_sql_log();
  SqlSession session(*log);
  const std::string join =
      "from event e cross join status s on s.robot = e.robot and s.t_send_us between e.t_us - 5000000 and e.t_us";
  const std::string plain =
      "from event e cross join status s on +s.robot = e.robot and +s.t_send_us between e.t_us - 5000000 and e.t_us";
  const std::string where = " where e.kind = 'blocked' and e.source = 'status' and e.robot = 'amb-01'";
  CHECK(integer(session, "select count(*) " + join + where) > 0);
  CHECK(integer(session, "select count(*) " + join + where) == integer(session, "select count(*) " + plain + where));
}

TEST_CASE("times compare as times, however they are written") {
  CHECK(time_key("2026-01-12T14:30:00.000Z") == time_key("2026-01-12 14:30"));
  CHECK(time_key("2026") == time_key("2026-01-01T00:00:00Z"));
  CHECK(time_key("2026-01-12 14:30") < time_key("2026-01-12T14:30:00.001Z"));
  CHECK(time_key("2026-01-12T14:30:00.001Z") < time_key("2026-01-12 14:31"));
  CHECK(time_of_key(time_key("2026-01-01")) == kT0);
  CHECK_FALSE(time_of_key(time_key("yesterday")));
  CHECK_FALSE(time_of_key(time_key("2026-01-12T14:30:00+02:00 and more")));
}

TEST_CASE("a robot that was away for a year costs few reads, and none of its rows") {
  MemoryLog memory;
  const RobotId id = memory.add_robot("amb-01");
  memory.period(id, Source::status, 1.0);
  constexpr double kYear = 365.0 * 86'400.0;
  for (int i = 0; i < 3000; ++i) {
    MemoryLog::set(memory.row(id, Source::status, i), "x", i);
  }
  for (int i = 0; i < 3000; ++i) {
    MemoryLog::set(memory.row(id, Source::status, kYear + i), "x", i);
  }
  Spy spy(memory);
  RowScan::Query query;
  query.robots = memory.robots();
  query.fields.set(field("x"));
  RowScan scan(spy, query);
  std::size_t rows = 0;
  double sum = 0;
  while (scan.next()) {
    ++rows;
    sum += scan.column(field("x"))->real[scan.row()];
  }
  CHECK(rows == 6000);
  CHECK(sum == 2 * 3000 * 2999 / 2);
  CHECK(spy.reads.size() < 40);
  for (std::size_t i = 1; i < spy.reads.size(); ++i) {
    CHECK(spy.reads[i].window.from_us == spy.reads[i - 1].window.to_us);
  }
}

TEST_CASE("a log that has grown is opened again by the next statement, not under one that is reading") {
  TempDir dir;
  const auto add_session = [&] {
    store::LogWriter writer(dir / "log");
    Session session;
    session.t_start_us = kT0;
    session.software = "test";
    writer.begin_session(session);
    writer.end_session(kT0 + 1'000'000, true);
  };
  add_session();
  SharedLog shared(open_log, {dir / "log"});
  std::shared_ptr<void> reading = shared.use();
  CHECK(shared.get().sessions().size() == 1);
  add_session();
  CHECK(shared.use() == reading);
  CHECK(shared.get().sessions().size() == 1);
  reading.reset();
  reading = shared.use();
  CHECK(shared.get().sessions().size() == 2);
  const RowSource* opened = &shared.get();
  reading.reset();
  reading = shared.use();
  CHECK(&shared.get() == opened);  // nothing new: nothing to do
}
