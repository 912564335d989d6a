#include "schema/batch_builder.hpp"

#include "tests/support/catch.hpp"
#include "tests/support/memory_log.hpp"

using namespace tacho;
using test::MemoryLog;

TEST_CASE("texts are interned once and survive any number of others") {
  TextPool pool;
  std::vector<std::uint32_t> ids;
  for (int i = 0; i < 5000; ++i) {
    ids.push_back(pool.intern("station " + std::to_string(i)));
  }
  for (int i = 0; i < 5000; ++i) {
    CHECK(pool.intern("station " + std::to_string(i)) == ids[static_cast<std::size_t>(i)]);
    CHECK(pool.at(ids[static_cast<std::size_t>(i)]) == "station " + std::to_string(i));
  }
  CHECK(pool.intern("") == 0);
}

TEST_CASE("a batch keeps the five ways of having no value apart, and zero") {
  MemoryLog log;
  const RobotId robot = log.add_robot("A");
  for (const State state :
       {State::absent, State::null, State::not_meaningful, State::not_supplied, State::wrong_type, State::present}) {
    log.set_state(log.row(robot, Source::status, 1.0), "block_reason", state);
  }
  Selection selection;
  selection.add(Source::status, field("block_reason"));
  log.read(robot, {}, selection, [&](const Slice& slice) {
    const Column& column = *slice.find(Source::status)->find(field("block_reason"));
    REQUIRE(column.state.size() == 6);
    for (std::size_t i = 0; i < 6; ++i) {
      CHECK(column.state[i] == static_cast<State>(i));
    }
    CHECK(column.has(5));
    CHECK(column.integer[5] == 0);
  });
}

TEST_CASE("of all states only present counts as having a value") {
  MemoryLog log;
  const RobotId robot = log.add_robot("A");
  for (const State state : {State::null, State::not_meaningful, State::not_supplied, State::wrong_type}) {
    log.set_state(log.row(robot, Source::status, 1.0), "block_reason", state);
  }
  CHECK(log.coverage().at(0).seen.test(field("block_reason")));
  CHECK(log.coverage().at(0).valued.none());
  log.set_state(log.row(robot, Source::status, 2.0), "block_reason", State::present);
  CHECK(log.coverage().at(0).valued.test(field("block_reason")));
}

TEST_CASE("rows, texts and alarms come out of a batch as they went in, however it is cut into slices") {
  for (const std::size_t slice_rows : {0u, 1u, 3u, 7u}) {
    MemoryLog log;
    log.slice_rows(slice_rows);
    const RobotId robot = log.add_robot("A");
    for (int i = 0; i < 20; ++i) {
      Sample& row = log.row(robot, Source::status, i);
      MemoryLog::set(row, "x", i * 0.5);
      MemoryLog::set_text(row, "current_station", "LM" + std::to_string(i % 3));
      MemoryLog::no_alarms(row);
      for (int k = 0; k < i % 4; ++k) {
        MemoryLog::alarm(row, AlarmLevel::error, 52000 + k, 100 + i);
      }
      row.alarms_incomplete.set(static_cast<std::size_t>(AlarmLevel::warning), i % 5 == 0);
    }
    Selection selection;
    for (const FieldIndex f : {field("x"), field("current_station"), field("errors")}) {
      selection.add(Source::status, f);
    }
    std::size_t n = 0;
    log.read(robot, {}, selection, [&](const Slice& slice) {
      const Batch& batch = *slice.find(Source::status);
      for (std::size_t i = 0; i < batch.rows(); ++i, ++n) {
        CHECK(batch.seq[i] == n);
        CHECK(batch.find(field("x"))->real[i] == static_cast<double>(n) * 0.5);
        CHECK(batch.text(*batch.find(field("current_station")), i) == "LM" + std::to_string(n % 3));
        const auto alarms = batch.alarms_of(i);
        REQUIRE(alarms.size() == n % 4);
        CHECK(batch.incomplete(i, AlarmLevel::warning) == (n % 5 == 0));
        CHECK_FALSE(batch.incomplete(i, AlarmLevel::error));
        for (std::size_t k = 0; k < alarms.size(); ++k) {
          CHECK(alarms[k].code == static_cast<std::int64_t>(52000 + k));
        }
      }
    });
    CHECK(n == 20);
  }
}
