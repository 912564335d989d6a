// Logs that the simulator writes directly.

#include "samples/simulator/write.hpp"

#include <map>
#include <nlohmann/json.hpp>

#include "schema/log.hpp"
#include "schema/wire/registers.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/golden.hpp"
#include "tests/support/temp_dir.hpp"

namespace sim = tacho::sim;
using tacho::Answer;
using tacho::Micros;
using tacho::RobotId;
using tacho::Source;

namespace {

constexpr Micros kSecond = 1'000'000;

sim::WriteOptions ten_minutes() {
  sim::WriteOptions options;
  options.duration_us = 600 * kSecond;
  options.status_period_us = kSecond;
  options.io_period_us = 2 * kSecond;
  options.registers_period_us = 3 * kSecond;
  options.inputs_period_us = 5 * kSecond;
  return options;
}

std::vector<Answer> answers(tacho::RowSource& log, RobotId robot, Source source) {
  std::vector<Answer> all;
  log.read_raw(robot, source, {}, [&](const Answer& answer) { all.push_back(answer); });
  return all;
}

std::unique_ptr<tacho::RowSource> open(const std::filesystem::path& folder) {
  return tacho::open_log(std::array{folder});
}

}  // namespace

TEST_CASE("a written log holds every planned poll of every source") {
  const tacho::test::TempDir dir;
  const auto truths = sim::write_log({sim::busy_day(1), sim::busy_day(2)}, ten_minutes(), dir / "log");
  REQUIRE(truths.size() == 2);
  const auto log = open(dir / "log");
  REQUIRE(log->robots().size() == 2);
  CHECK(log->problems().empty());
  CHECK(log->unknown_keys().empty());
  const std::map<Source, std::uint64_t> planned{
      {Source::status, 600}, {Source::io, 300}, {Source::registers, 200}, {Source::inputs, 120}};
  REQUIRE(log->coverage().size() == 8);
  for (const auto& coverage : log->coverage()) {
    INFO(tacho::source_name(coverage.source));
    CHECK(coverage.planned == planned.at(coverage.source));
    CHECK(coverage.stored == coverage.planned);
    CHECK(coverage.missed == 0);
    CHECK(coverage.undecodable == 0);
  }
  for (const auto& session : log->sessions()) {
    CHECK(session.clean);
  }
  const auto json = nlohmann::json::parse(tacho::test::read_file(dir / "log" / "truth.json"));
  CHECK(json[0]["path_m"] == truths[0].path_m);
  CHECK(json[1]["t1_us"] == truths[1].t1_us);
}

TEST_CASE("answers are asked near their time and answered within the round trip") {
  const tacho::test::TempDir dir;
  const sim::WriteOptions options = ten_minutes();
  sim::write_log({sim::busy_day(1)}, options, dir / "log");
  const auto log = open(dir / "log");
  std::uint64_t seq = 0;
  for (const Answer& answer : answers(*log, 1, Source::status)) {
    REQUIRE(answer.meta.seq == seq);
    const Micros due = options.t0_us + static_cast<Micros>(seq) * kSecond;
    REQUIRE(answer.meta.t_send_us >= due);
    REQUIRE(answer.meta.t_send_us <= due + options.jitter_us);
    REQUIRE(answer.meta.t_recv_us >= answer.meta.t_send_us + options.rtt_us);
    ++seq;
  }
  CHECK(seq == 600);
}

TEST_CASE("planned gaps become gap rows and use up numbers") {
  const tacho::test::TempDir dir;
  sim::WriteOptions options = ten_minutes();
  tacho::Gap gap;
  gap.robot = 2;
  gap.source = Source::status;
  gap.cause = tacho::Cause::connect_refused;
  gap.detail = "switched off";
  gap.t_from_us = options.t0_us + 100 * kSecond;
  gap.t_to_us = options.t0_us + 130 * kSecond;
  options.gaps.push_back(gap);
  gap.t_from_us = options.t0_us + 590 * kSecond;  // until the end
  gap.t_to_us = options.t0_us + 700 * kSecond;
  options.gaps.push_back(gap);
  sim::write_log({sim::busy_day(1), sim::busy_day(2)}, options, dir / "log");
  const auto log = open(dir / "log");
  for (const auto& coverage : log->coverage()) {
    const bool gappy = coverage.robot == 2 && coverage.source == Source::status;
    CHECK(coverage.missed == (gappy ? 40 : 0));
    CHECK(coverage.stored + coverage.missed == coverage.planned);
  }
  std::vector<tacho::Gap> gaps;
  tacho::Selection selection;
  selection.rows[0] = true;
  log->read(2, {}, selection,
            [&](const tacho::Slice& slice) { gaps.insert(gaps.end(), slice.gaps.begin(), slice.gaps.end()); });
  REQUIRE(gaps.size() == 2);
  CHECK(gaps[0].seq_from == 100);
  CHECK(gaps[0].seq_count == 30);
  CHECK(gaps[0].cause == tacho::Cause::connect_refused);
  CHECK(gaps[0].detail == "switched off");
  CHECK(gaps[0].t_from_us < options.t0_us + 100 * kSecond);
  CHECK(gaps[0].t_to_us > options.t0_us + 130 * kSecond);
  CHECK(gaps[1].seq_count == 10);
  CHECK(gaps[1].t_to_us == options.t0_us + 599 * kSecond);
}

TEST_CASE("the same scenarios give the same bytes again") {
  const tacho::test::TempDir dir;
  sim::write_log({sim::busy_day(3)}, ten_minutes(), dir / "a");
  sim::write_log({sim::busy_day(3)}, ten_minutes(), dir / "b");
  const auto a = open(dir / "a");
  const auto b = open(dir / "b");
  for (const Source source : {Source::status, Source::io, Source::registers, Source::inputs}) {
    const auto first = answers(*a, 1, source);
    const auto second = answers(*b, 1, source);
    REQUIRE(first.size() == second.size());
    for (std::size_t i = 0; i < first.size(); ++i) {
      REQUIRE(first[i].body == second[i].body);
      REQUIRE(first[i].meta.t_recv_us == second[i].meta.t_recv_us);
    }
  }
}

TEST_CASE("a rate of zero writes no source, progress ends at one") {
  const tacho::test::TempDir dir;
  sim::WriteOptions options;
  options.duration_us = 2 * 86'400 * kSecond;
  options.status_period_us = 600 * kSecond;
  double last = 0;
  options.progress = [&last](double share) {
    CHECK(share >= last);
    last = share;
  };
  sim::write_log({sim::busy_day(1)}, options, dir / "log");
  CHECK(last == 1.0);
  const auto log = open(dir / "log");
  REQUIRE(log->coverage().size() == 1);
  CHECK(log->coverage()[0].stored == 288);
}
