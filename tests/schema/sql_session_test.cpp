// What SQL over a log refuses and how it says so, and the export to plain tables.

#include "schema/store/log_writer.hpp"
#include "schema/store/sql/row_columns.hpp"
#include "schema/store/sql/sqlite_export.hpp"
#include "schema/store/sqlite.hpp"
#include "tests/schema/sql_fixture.hpp"

using namespace tacho;
using namespace tacho::test;
using namespace tacho::store::sql;

namespace {

std::string refusal(SqlSession& session, const std::string& sql) {
  try {
    rows_of(session, sql);
  } catch (const StatementError& error) {
    return error.what();
  }
  return "not refused";
}

SqliteExport everything(const RowSource& log) {
  SqliteExport what;
  what.robots = log.robots();
  what.sources = {Source::status, Source::io, Source::registers, Source::inputs};
  what.fields.set();
  return what;
}

/// A statement that gives each row of `sql` as one text that tells types and NULL apart.
std::string quoted(const std::string& sql, std::size_t columns) {
  std::string text;
  std::string names;
  for (std::size_t i = 0; i < columns; ++i) {
    text += (i > 0 ? "||'|'||quote(c" : "quote(c") + std::to_string(i) + ")";
    names += (i > 0 ? ", c" : "c") + std::to_string(i);
  }
  return "with r(" + names + ") as (" + sql + ") select " + text + " from r";
}

/// Rows of a plain database file as text.
std::string plain_rows(const std::filesystem::path& file, const std::string& sql, std::size_t columns) {
  store::Connection connection(file, store::OpenMode::read);
  store::Statement rows(connection, quoted(sql, columns));
  std::string out;
  while (rows.step()) {
    out += rows.text(0) + "\n";
  }
  return out;
}

std::string virtual_rows(SqlSession& session, const std::string& sql, std::size_t columns) {
  std::string out;
  for (const SqlRow& row : rows_of(session, quoted(sql, columns))) {
    out += std::get<std::string>(row[0]) + "\n";
  }
  return out;
}

}  // namespace

TEST_CASE("a statement that would change anything is refused") {
  const auto log = open_sql_log();
  SqlSession session(*log);
  for (const char* sql : {"delete from status",
                          "insert into gap(robot) values(1)",
                          "update event set kind = 'x'",
                          "drop table status",
                          "create table x(a)",
                          "create temp table x(a)",
                          "create view v as select 1",
                          "attach ':memory:' as other",
                          "detach temp",
                          "pragma journal_mode = wal",
                          "pragma writable_schema = 1",
                          "begin",
                          "commit",
                          "vacuum",
                          "vacuum into '/tmp/copy.db'",
                          "delete from field",
                          "insert into code values('a', 1, 'b', 'c')",
                          "reindex",
                          "analyze",
                          "alter table field rename to f",
                          "select load_extension('x')",
                          "create virtual table temp.z using tacho_status('/')",
                          "savepoint s"}) {
    INFO(sql);
    const std::string words = refusal(session, sql);
    CHECK(words.find("a log is only read") != std::string::npos);
    CHECK(words.find("write a SELECT") != std::string::npos);
  }
  CHECK(integer(session, "select count(*) from robot") == 2);  // and goes on
}

TEST_CASE("a mistake in a statement is named with its cause and what to do") {
  const auto log = open_sql_log();
  SqlSession session(*log);
  const std::vector<std::pair<std::string, std::string>> mistakes{
      {"select batery_level from status", "batery_level: no such column; did you mean 'battery_level'?"},
      {"select s.block_reson from status s", "s.block_reson: no such column; did you mean 'block_reason'?"},
      {"select t_sendus from status", "did you mean 't_send_us'?"},
      {"select * from statsu", "statsu: no such table; did you mean 'status'?"},
      {"select * from nonsense", "tables: status, io, registers, inputs, pose, push, ring, robot"},
      {"selec 1", "syntax error at 'selec 1'"},
      {"select 1; select 2", "more than one statement"},
      {"  ;", "there is no statement"},
      {"", "there is no statement"},
      {"select ?", "parameter"},
      {"select nofunction(1)", "no such function: nofunction"},
  };
  for (const auto& [sql, words] : mistakes) {
    INFO(sql << ": " << refusal(session, sql));
    CHECK(refusal(session, sql).find(words) != std::string::npos);
  }
  CHECK(rows_of(session, "select 1; -- with a remark").size() == 1);
}

TEST_CASE("values keep their types on the way out") {
  const auto log = open_sql_log();
  SqlSession session(*log);
  const std::vector<SqlRow> rows = rows_of(session, "select 1, 1.5, 'a', '', null, x'00ff', 9223372036854775807");
  REQUIRE(rows.size() == 1);
  CHECK(std::get<std::int64_t>(rows[0][0]) == 1);
  CHECK(std::get<double>(rows[0][1]) == 1.5);
  CHECK(std::get<std::string>(rows[0][2]) == "a");
  CHECK(std::get<std::string>(rows[0][3]).empty());
  CHECK(std::holds_alternative<std::monostate>(rows[0][4]));
  CHECK(std::get<store::sql::SqlBlob>(rows[0][5]).bytes == std::string("\x00\xff", 2));
  CHECK(std::get<std::int64_t>(rows[0][6]) == std::numeric_limits<std::int64_t>::max());
}

TEST_CASE("an export to SQLite holds the rows of the virtual tables") {
  const auto log = open_sql_log();
  TempDir dir;
  const std::filesystem::path file = dir / "out.db";
  const std::uint64_t rows = export_sqlite(*log, everything(*log), file);
  SqlSession session(*log);
  std::int64_t expected_rows = 0;
  for (const Source source : {Source::status, Source::io, Source::registers, Source::inputs}) {
    const std::string name(source_name(source));
    INFO(name);
    expected_rows += integer(session, "select count(*) from " + name);
    std::string columns;
    std::size_t count = 0;
    for (const RowColumn& column : row_columns(source)) {
      if (!column.hidden) {
        columns += (count++ > 0 ? ", " : "") + column.name;
      }
    }
    const std::string sql = "select " + columns + " from " + name + " order by robot, session, seq";
    const std::string plain = plain_rows(file, sql, count);
    CHECK(plain.size() > 10'000);
    CHECK((plain == virtual_rows(session, sql, count)));  // in brackets: megabytes are no message
  }
  CHECK(static_cast<std::int64_t>(rows) == expected_rows);
  for (const char* sql : {"select id, name, address, mac, firmware from robot order by id",
                          "select id, t_start_us, t_end_us, clean, software from session",
                          "select robot, robot_id, seq_from, t_from_us, cause from gap order by 1, 4",
                          "select robot, kind, t_us, subject, new_value from event order by 3, 1, 2, 4",
                          "select robot, robot_id, wall_us, mono_us, robot_us from clock order by 3, 2",
                          "select id, name, unit, kind, meaning from field order by 1",
                          "select list, value, name, meaning, 1 from code order by 1, 2"}) {
    INFO(sql);
    CHECK(plain_rows(file, sql, 5) == virtual_rows(session, sql, 5));
  }
  store::Connection connection(file, store::OpenMode::read);
  CHECK(connection.scalar("pragma integrity_check") == "ok");
  store::Statement plan(connection, "explain query plan select x from status where robot = 'amb-01' and t_send_us > 5");
  REQUIRE(plan.step());
  CHECK(plan.text(3).find("status_time") != std::string::npos);
}

TEST_CASE("what belongs to no robot is exported, once") {
  TempDir dir;
  std::filesystem::copy(sql_log(), dir / "log", std::filesystem::copy_options::recursive);
  {
    store::LogWriter writer(dir / "log");
    Session session;
    session.t_start_us = kT0 + 86'400'000'000;
    Event changed;
    changed.session = writer.begin_session(session);
    changed.kind = EventKind::config_changed;
    changed.t_us = changed.t_from_us = session.t_start_us;
    writer.add(changed);
    writer.add(ClockPoint{0, changed.session, session.t_start_us, 1, {}});
    writer.end_session(session.t_start_us, true);
  }
  const std::vector<std::filesystem::path> paths{dir / "log"};
  const auto log = open_log(paths);
  export_sqlite(*log, everything(*log), dir / "out.db");
  store::Connection connection(dir / "out.db", store::OpenMode::read);
  CHECK(connection.integer("select count(*) from event where kind = 'config_changed' and robot is null") == 1);
  CHECK(connection.integer("select count(*) from event where robot = 'amb-01'") > 0);
  CHECK(connection.integer("select count(*) from clock where mono_us = 1") == 1);
}

TEST_CASE("an export takes the robots, the time and the fields it is asked for") {
  const auto log = open_sql_log();
  TempDir dir;
  SqliteExport what = everything(*log);
  std::erase_if(what.robots, [](const Robot& r) { return r.id != 2; });
  what.window = {kT0 + 600'000'000, kT0 + 660'000'000};
  what.sources = {Source::status};
  what.fields.reset();
  what.fields.set(field("x"));
  export_sqlite(*log, what, dir / "out.db");
  store::Connection connection(dir / "out.db", store::OpenMode::read);
  CHECK(connection.integer("select count(*) from status") == 30);
  CHECK(connection.integer("select count(*) from pragma_table_info('status')") == 6);
  CHECK(connection.scalar("select min(robot) || max(robot) from status") == "amb-02amb-02");
  CHECK(connection.integer("select count(*) from sqlite_schema where name in ('io', 'registers', 'inputs')") == 0);
}

TEST_CASE("an export writes over nothing and leaves nothing half done") {
  const auto log = open_sql_log();
  TempDir dir;
  std::ofstream(dir / "out.db") << "mine";
  CHECK_THROWS_WITH(export_sqlite(*log, everything(*log), dir / "out.db"),
                    Catch::Matchers::Contains("exists already") && Catch::Matchers::Contains("another name"));
  CHECK_THROWS_AS(export_sqlite(*log, everything(*log), dir / "none" / "out.db"), Error);
  CHECK(std::distance(std::filesystem::directory_iterator(dir.path()), {}) == 1);
}
