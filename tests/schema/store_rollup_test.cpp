// One-minute rollups say what the rows say, each answer once, whatever happened to the writer.

#include <limits>
#include <map>
#include <tuple>

#include "samples/simulator/answers.hpp"
#include "schema/log.hpp"
#include "schema/store/rollup.hpp"
#include "schema/store/rows.hpp"
#include "schema/store/schema_sql.hpp"
#include "schema/store/sqlite.hpp"
#include "schema/survey.hpp"
#include "schema/wire/registers.hpp"
#include "tests/schema/store_fixture.hpp"

using namespace tacho;
using namespace tacho::test;
namespace fs = std::filesystem;

namespace {

using Key = std::tuple<Source, std::int64_t, FieldIndex>;
using Table = std::map<Key, Rollup>;

void put(Table& table, const Rollup& row) {
  const auto [known, fresh] = table.try_emplace({row.source, row.minute, row.field}, row);
  if (!fresh) {
    known->second.add(row);
  }
}

/// As the log has them.
Table rollups_of(RowSource& log, RobotId robot) {
  Table table;
  for (std::size_t portion = 0; portion < log.rollup_portions(); ++portion) {
    for (const Rollup& row : log.rollups(robot, portion)) {
      put(table, row);
    }
  }
  return table;
}

/// Made of the rows, by another way: whole columns of slices.
Table from_rows(RowSource& log, RobotId robot, const std::vector<Source>& sources) {
  Table table;
  Selection selection;
  for (const Source source : sources) {
    selection.fields[static_cast<std::size_t>(source)] = store::rollup_fields();
    selection.rows[static_cast<std::size_t>(source)] = true;
  }
  log.read(robot, Window{}, selection, [&](const Slice& slice) {
    for (const Batch& batch : slice.batches) {
      for (FieldIndex f = 0; f < kFieldCount; ++f) {
        const Column* column = store::rollup_fields()[f] ? batch.find(f) : nullptr;
        for (std::size_t row = 0; column != nullptr && row < batch.rows(); ++row) {
          if (column->state[row] == State::present) {
            const double value =
                field_at(f).kind == Kind::real ? column->real[row] : static_cast<double>(column->integer[row]);
            const std::int64_t minute = batch.t_mid_us(row) / 60'000'000;
            put(table, {robot, batch.source, minute, f, 1, value, value, value, value});
          }
        }
      }
    }
  });
  return table;
}

void check_same(const Table& told, const Table& expected) {
  REQUIRE(told.size() == expected.size());
  for (const auto& [key, row] : expected) {
    const auto found = told.find(key);
    REQUIRE(found != told.end());
    INFO(source_name(row.source) << " " << field_at(row.field).name << " minute " << row.minute);
    CHECK(found->second.rows == row.rows);
    CHECK(found->second.min == row.min);
    CHECK(found->second.max == row.max);
    CHECK(found->second.last == row.last);
    CHECK(found->second.sum == Approx(row.sum).epsilon(1e-12).margin(1e-12));
  }
}

/// Two simulated robots: the first with status, registers and inputs, the second with registers and inputs only.
class TwoRobots {
 public:
  explicit TwoRobots(const fs::path& folder, std::uint64_t part_bytes) : folder_(folder), part_bytes_(part_bytes) {}

  /// Records on, in a session of its own, and stops as a kill would when not `clean`.
  void session(int seconds, bool clean) {
    store::WriterOptions options;
    options.part_bytes = part_bytes_;
    options.durable = false;
    options.decode = answer_decode();
    store::LogWriter writer(folder_, options);
    Session start;
    start.t_start_us = now_us_;
    const SessionId session = writer.begin_session(start);
    Ingest ingest(writer, [] { return Micros{0}; });
    for (const RobotId robot : {writer.robot("both", "a"), writer.robot("registers", "b")}) {
      for (const Source source : {Source::status, Source::registers, Source::inputs}) {
        if (robot == 1 || source != Source::status) {
          ingest.declare(stream_of(session, robot, source));
        }
      }
    }
    for (int second = 0; second < seconds; ++second, now_us_ += kSecond) {
      const auto seq = static_cast<std::uint64_t>(second);
      ingest.append(answer_of(session, 1, Source::status, seq, now_us_, one_.status(first_.at(now_us_))));
      modbus(ingest, session, 1, seq);
      modbus(ingest, session, 2, seq);
      if (second % 7 == 6) {
        writer.commit();
      }
    }
    if (clean) {
      writer.end_session(now_us_, true);
    } else {
      writer.commit();
      copy_as_killed(folder_, folder_.parent_path() / "killed");
    }
  }
  static constexpr Micros kStart = kT0 + 23 * kSecond;

 private:
  fs::path folder_;
  std::uint64_t part_bytes_;
  Micros now_us_ = kStart;
  sim::Robot first_{sim::busy_day(1), kStart};
  sim::Robot second_{sim::busy_day(2), kStart};
  sim::AnswerMaker one_{sim::busy_day(1)};
  sim::AnswerMaker two_{sim::busy_day(2)};

  void modbus(Ingest& ingest, SessionId session, RobotId robot, std::uint64_t seq) {
    const sim::RobotState& state = robot == 1 ? first_.at(now_us_) : second_.at(now_us_);
    sim::AnswerMaker& maker = robot == 1 ? one_ : two_;
    std::string bits;
    wire::append_bits(bits, {1, 80}, maker.inputs(state));
    ingest.append(answer_of(session, robot, Source::inputs, seq, now_us_, bits));
    std::string image;
    const auto words = maker.registers(state);
    wire::append_words(image, {1, 100}, std::span(words).subspan(0, 100));
    ingest.append(answer_of(session, robot, Source::registers, seq, now_us_, image));
  }
};

void check_log(const fs::path& folder) {
  const std::vector<fs::path> paths{folder};
  const auto log = open_log(paths);
  check_same(rollups_of(*log, 1), from_rows(*log, 1, {Source::status}));
  check_same(rollups_of(*log, 2), from_rows(*log, 2, {Source::registers, Source::inputs}));
  CHECK(log->problems().empty());
}

/// Bodies are {"x":<number>...}: told as the odometer.
void decode_odo(const Answer& answer, const Stream&, const FieldSet& wanted, Gates&, Sample& out) {
  out.clear();
  CHECK(wanted == store::rollup_fields());
  Cell& cell = out.cells[field("odo")];
  cell.state = State::present;
  cell.real = std::stod(answer.body.substr(5));
  out.cells[field("voltage")].state = State::not_supplied;
  out.cells[field("vx")].state = State::not_meaningful;
  out.cells[field("w")].state = State::present;
  out.cells[field("w")].real = std::numeric_limits<double>::quiet_NaN();
}

store::WriterOptions with_odo() {
  store::WriterOptions options;
  options.decode = decode_odo;
  options.durable = false;
  return options;
}

std::int64_t integer(const fs::path& part, const std::string& sql) {
  return store::Connection(part, store::OpenMode::read).integer(sql);
}

constexpr std::uint64_t kEnough = 1850;  // rows a second apart that make a block

}  // namespace

TEST_CASE("rollups of a closed log are what its rows give: over parts, sessions and minutes cut in two") {
  TempDir dir;
  TwoRobots robots(dir / "log", 200'000);
  robots.session(400, true);
  robots.session(170, false);
  robots.session(200, true);
  REQUIRE(part_files(dir / "log").size() > 2);
  check_log(dir / "log");
  store::WriterOptions options;
  options.decode = answer_decode();
  { store::LogWriter after_kill(dir / "killed", options); }
  check_log(dir / "killed");
}

TEST_CASE("a field that status gives is not rolled up from registers") {
  TempDir dir;
  TwoRobots(dir / "log", 256 << 20).session(130, true);
  const fs::path part = part_files(dir / "log")[0];
  CHECK(integer(part, "SELECT count(DISTINCT source) FROM rollup WHERE robot = 1") == 1);
  CHECK(integer(part, "SELECT count(DISTINCT source) FROM rollup WHERE robot = 2") == 2);
}

TEST_CASE("an answer is in its block and its rollup, or in neither, whenever the writer dies") {
  TempDir dir;
  Recording recording(dir / "log", with_odo());
  std::int64_t moved = 0;
  for (int step = 0; step < 30; ++step) {
    recording.polls(kEnough / 10);
    recording.writer.commit();
    const fs::path copy = dir / ("copy" + std::to_string(step));
    copy_as_killed(dir / "log", copy);
    const fs::path part = part_files(copy)[0];
    const std::int64_t in_blocks = integer(part, "SELECT ifnull(sum(rows), 0) FROM block");
    CHECK(integer(part, "SELECT ifnull(sum(rows), 0) FROM rollup") == in_blocks);
    moved = in_blocks;
    if (step % 10 == 9) {
      { store::LogWriter repaired(copy, with_odo()); }
      CHECK(integer(part, "SELECT sum(rows) FROM rollup") == static_cast<std::int64_t>(recording.next));
    }
  }
  CHECK(moved > 0);
}

TEST_CASE("only values that are present and finite are rolled up") {
  TempDir dir;
  {
    Recording recording(dir.path(), with_odo());
    recording.polls(90);
    recording.end();
  }
  const fs::path part = part_files(dir.path())[0];
  CHECK(integer(part, "SELECT count(*) FROM rollup") == 2);
  CHECK(integer(part, "SELECT count(*) FROM rollup JOIN field ON field.id = rollup.field WHERE field.name = 'odo'") ==
        2);
  CHECK(integer(part, "SELECT rows FROM rollup WHERE minute = (SELECT min(minute) FROM rollup)") == 60);
}

TEST_CASE("a rollup that was changed, or is gone, is named") {
  TempDir dir;
  {
    Recording recording(dir.path(), with_odo());
    recording.polls(600);
    recording.end();
  }
  const fs::path part = part_files(dir.path())[0];
  const auto damage = [&](const std::string& sql) {
    { store::Connection(part, store::OpenMode::write).exec(sql); }
    store::LogReader log = open_reader(dir.path());
    std::size_t rows = log.rollups(1, 0).size();
    REQUIRE_FALSE(log.problems().empty());
    return std::to_string(rows) + ": " + log.problems().back().what;
  };
  CHECK(damage("UPDATE rollup SET max = 1e9 WHERE minute % 10 = 3") ==
        "9: 1 rows of table rollup are damaged and left out");
  CHECK(damage("DELETE FROM rollup WHERE minute % 10 = 3") == "9: 9 rows of table rollup were read, but it had 10");
}

TEST_CASE("rollups of closed parts are made again by verify, which names one that says otherwise though it is sound") {
  TempDir dir;
  TwoRobots robots(dir / "log", 200'000);
  robots.session(400, true);
  robots.session(170, false);
  robots.session(200, true);
  const std::vector<fs::path> paths{dir / "log"};
  const auto verified = [&] {
    const auto log = open_log(paths);
    Survey found = survey(dynamic_cast<store::LogReader&>(*log));
    CHECK(log->problems().empty());
    return found;
  };
  CHECK(verified().first_rollups == std::vector<std::string>());
  {
    store::Connection part(part_files(dir / "log")[0], store::OpenMode::write);
    store::Statement row(part, store::select_sql("rollup") + " WHERE robot = 1 LIMIT 1");
    REQUIRE(row.step());
    Rollup changed = *store::read_rollup(row, store::own_vocabulary());
    row.reset();
    changed.max += 1;
    store::Statement replace(part, store::insert_sql("rollup", "OR REPLACE"));
    store::write(replace, changed, static_cast<std::int64_t>(changed.source), changed.field);
  }
  const Survey found = verified();
  CHECK(found.wrong_rollups == 1);
  REQUIRE(found.first_rollups.size() == 1);
  CHECK_THAT(found.first_rollups[0], Catch::Contains("rollup of robot 1 status"));
}

TEST_CASE("without a decoder there are no rollups, and everything else is as ever") {
  TempDir dir;
  {
    Recording recording(dir.path());
    recording.polls(90);
    recording.end();
  }
  store::LogReader log = open_reader(dir.path());
  CHECK(log.rollups(1, 0).empty());
  CHECK(stored(log).size() == 90);
  CHECK(log.problems().empty());
}
