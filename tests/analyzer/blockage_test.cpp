#include <algorithm>

#include "analyzer/analyses/analyses.hpp"
#include "tests/analyzer/section_text.hpp"
#include "tests/analyzer/simulated_log.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/memory_log.hpp"

using namespace tacho;
using test::MemoryLog;

namespace {

const Settings kSettings;

Section run(RowSource& log) { return run_analysis(kBlockage, log, {}, Window{}, "UTC", kSettings); }

double num(const Value& value) { return test::number(value); }

double sum(const GridLayer& layer) {
  double total = 0.0;
  for (const double v : layer.value) {
    total += std::isnan(v) ? 0.0 : v;
  }
  return total;
}

/// Many blockages at three spots, far enough apart that no two episodes are joined.
sim::Scenario hot_hall(std::uint64_t seed) {
  sim::Scenario s;
  s.name = "amr-" + std::to_string(seed);
  s.seed = seed;
  s.wait_s = 3.0;
  s.slowed_per_km = 5.0;
  s.hot_spots = {{12.0, 2.0, 0.5, 0.7, 14.0, 1}, {38.0, 10.0, 0.5, 0.6, 9.0, 6}, {20.0, 18.0, 0.5, 0.5, 6.0, 0}};
  return s;
}

/// Truth against the list: each long episode once, bounds hold the truth, nothing is invented.
std::size_t check_truth(const DataTable& episodes, const std::vector<sim::TrueEpisode>& truth, double period_s) {
  std::size_t matched = 0;
  std::vector<bool> used(episodes.rows.size(), false);
  for (const sim::TrueEpisode& e : truth) {
    std::size_t hits = 0;
    for (std::size_t r = 0; r < episodes.rows.size(); ++r) {
      const Micros onset_lo = test::time(test::cell(episodes, r, "onset_lo")).value_or(0);
      const Micros onset_hi = test::time(test::cell(episodes, r, "onset_hi")).value();
      const Micros end_lo = test::time(test::cell(episodes, r, "end_lo")).value();
      const std::optional<Micros> end_hi = test::time(test::cell(episodes, r, "end_hi"));
      if (e.from_us >= onset_lo && e.from_us <= onset_hi && e.to_us >= end_lo && (!end_hi || e.to_us <= *end_hi)) {
        ++hits;
        used[r] = true;
        CHECK(std::get<std::string>(test::cell(episodes, r, "reason")) ==
              code_name(field_at(field("block_reason")), e.reason));
        CHECK(std::hypot(num(test::cell(episodes, r, "x_m")) - e.x_m, num(test::cell(episodes, r, "y_m")) - e.y_m) <
              0.1);
      }
    }
    if (static_cast<double>(e.to_us - e.from_us) * 1e-6 > 2.0 * period_s) {
      CHECK(hits == 1);
      ++matched;
    } else {
      CHECK(hits <= 1);
    }
  }
  CHECK(std::count(used.begin(), used.end(), false) == 0);
  return matched;
}

}  // namespace

TEST_CASE(
    "on a simulated log every blocked episode longer than two periods is listed once, its truth inside its bounds") {
  for (const double period_s : {0.5, 1.0, 2.5}) {
    CAPTURE(period_s);
    test::SimulatedLog log(hot_hall(3), 7'200.0, {{Source::status, period_s}});
    const Section section = run(log);
    CHECK(check_truth(test::table(section, "episodes"), log.truth().blocked, period_s) > 30);
  }
}

TEST_CASE("a robot read by Modbus only gives the same episodes from inputs and registers") {
  test::SimulatedLog log(hot_hall(4), 3'600.0, {{Source::registers, 0.5}, {Source::inputs, 0.5}});
  const Section section = run(log);
  CHECK(check_truth(test::table(section, "episodes"), log.truth().blocked, 0.5) > 15);
  CHECK(section.grids.size() == 1);
}

TEST_CASE("the layers add up: metres to the path, seconds to the time, episodes to the list, lost time to its sum") {
  test::SimulatedLog log(hot_hall(5), 7'200.0, {{Source::status, 1.0}});
  log.lose(2'000.0, 2'300.0);
  const Section section = run(log);
  const Grid& grid = test::grid(section);
  const DataTable& robots = test::table(section, "by_robot");
  const DataTable& episodes = test::table(section, "episodes");
  const double path_m = num(test::cell(robots, 0, "distance")) * 1'000.0;
  const double time_s = num(test::cell(robots, 0, "observed")) * 3'600.0;
  CHECK(std::abs(sum(test::layer(grid, "metres")) - path_m) < 1e-9 * path_m);
  CHECK(std::abs(sum(test::layer(grid, "seconds")) - time_s) < 1e-9 * time_s);
  CHECK(time_s == Approx(7'199.0 - 301.0).epsilon(1e-9));
  CHECK(sum(test::layer(grid, "episodes")) == static_cast<double>(episodes.rows.size()));
  double lost_s = 0.0;
  for (std::size_t r = 0; r < episodes.rows.size(); ++r) {
    lost_s += num(test::cell(episodes, r, "lost"));
  }
  CHECK(std::abs(sum(test::layer(grid, "lost_s")) - lost_s) < 1e-9 * lost_s);
  double by_reason = 0.0;
  for (const GridLayer& layer : grid.layers) {
    by_reason += layer.name.rfind("episodes_", 0) == 0 ? sum(layer) : 0.0;
  }
  CHECK(by_reason == sum(test::layer(grid, "episodes")));
  CHECK(path_m == Approx(log.truth().path_m).epsilon(0.05));
  for (const GridLayer& layer : grid.layers) {
    CHECK(layer.value.size() == grid.width * grid.height);
  }
  REQUIRE(grid.pictures.size() >= 4);
  CHECK(grid.pictures.front() == "lost_s");
  for (const std::string& picture : grid.pictures) {
    CHECK_NOTHROW(test::layer(grid, picture));
  }
}

TEST_CASE("the places blocked most per pass are the hot spots, and lost time is concentrated there") {
  test::SimulatedLog log(hot_hall(6), 4 * 3'600.0, {{Source::status, 1.0}});
  const Section section = run(log);
  const DataTable& top = test::table(section, "top_cells");
  REQUIRE(top.rows.size() >= 3);
  const auto spots = hot_hall(6).hot_spots;
  for (std::size_t r = 0; r < 3; ++r) {
    const double x = num(test::cell(top, r, "x_m"));
    const double y = num(test::cell(top, r, "y_m"));
    CHECK(std::any_of(spots.begin(), spots.end(),
                      [&](const sim::HotSpot& s) { return std::hypot(s.x_m - x, s.y_m - y) < s.radius_m + 0.4; }));
    const auto& rate = std::get<Quantity>(test::cell(top, r, "rate"));
    CHECK(rate.lo.value() <= rate.value.value());
    CHECK(rate.value.value() <= rate.hi.value());
    CHECK(num(test::cell(top, r, "q_value")) < 0.05);
  }
  const DataTable& lorenz = test::table(section, "concentration");
  REQUIRE(lorenz.rows.size() == 3);
  CHECK(num(test::cell(lorenz, 0, "cells_of_visited_pct")) < 5.0);
  CHECK(num(test::cell(lorenz, 0, "cells")) <= num(test::cell(lorenz, 1, "cells")));
}

TEST_CASE("lost time and its share agree with the simulated truth within their limits") {
  test::SimulatedLog log(hot_hall(7), 4 * 3'600.0, {{Source::status, 1.0}});
  const Section section = run(log);
  double blocked_s = 0.0;
  for (const sim::TrueEpisode& e : log.truth().blocked) {
    blocked_s += static_cast<double>(e.to_us - e.from_us) * 1e-6;
  }
  const auto& lost = std::get<Quantity>(test::cell(test::table(section, "by_robot"), 0, "lost"));
  CHECK(lost.lo.value() <= blocked_s);
  CHECK(blocked_s <= lost.hi.value());
  CHECK(lost.value.value() == Approx(blocked_s).epsilon(0.03));
  const Finding& finding = test::finding(section, "BLK-01", "amr-7");
  CHECK(finding.verdict == Verdict::fail);  // a spot that stops seven of ten passes costs more than 5 %
  CHECK(finding.value.lo.value() < finding.value.value.value());
  CHECK(finding.value.value.value() < finding.value.hi.value());
  CHECK_FALSE(finding.evidence.empty());
}

TEST_CASE("lost time is never longer than blocked time, nor its upper limit, whatever gaps and ends hide") {
  struct Stretch {
    int from_s, to_s;
  };
  const Stretch kWholeRecord{0, 2'000};
  // Blocked from the first poll into a gap, through a gap, out of a gap to the last poll.
  for (const Stretch blocked : {Stretch{0, 1'000}, Stretch{900, 1'100}, Stretch{1'000, 2'000}, kWholeRecord}) {
    MemoryLog log;
    const RobotId robot = log.add_robot("amr-1");
    log.period(robot, Source::status, 1.0);
    for (int k = 0; k < 2'000; ++k) {
      Sample& row = log.row(robot, Source::status, k < 1'000 ? k : k + 10'000);
      MemoryLog::set(row, "x", 5.0);
      MemoryLog::set(row, "y", 5.0);
      MemoryLog::set_int(row, "task_status", 2);
      MemoryLog::set_int(row, "blocked", k >= blocked.from_s && k < blocked.to_s ? 1 : 0);
    }
    const Section section = run(log);
    for (const char* table : {"by_robot", "by_reason"}) {
      CAPTURE(blocked.from_s, blocked.to_s, table);
      const auto stood = std::get<Quantity>(test::cell(test::table(section, table), 0, "blocked"));
      const auto lost = std::get<Quantity>(test::cell(test::table(section, table), 0, "lost"));
      CHECK(stood.value.value() == Approx(blocked.to_s - blocked.from_s).margin(3.0));
      CHECK(lost.value.value() <= stood.value.value());
      CHECK(lost.lo.value() <= stood.lo.value());
      CHECK(lost.hi.value() <= stood.hi.value());
      CHECK(stood.hi.value() == Approx(blocked.to_s - blocked.from_s + 10'000.0).margin(3.0));
    }
  }
}

TEST_CASE("episodes per hour of a robot and per hour spent in a cell are two figures with two names") {
  test::SimulatedLog log(hot_hall(5), 3'600.0, {{Source::status, 1.0}});
  const Section section = run(log);
  const auto per_hour = std::get<Quantity>(test::cell(test::table(section, "by_robot"), 0, "per_hour"));
  const double observed_h = num(test::cell(test::table(section, "by_robot"), 0, "observed"));
  CHECK(per_hour.value.value() * observed_h ==
        Approx(num(test::cell(test::table(section, "by_robot"), 0, "episodes"))));
  const Grid& grid = test::grid(section);
  const auto named_per_hour = [](const GridLayer& layer) { return layer.name.ends_with("per_hour"); };
  CHECK(std::none_of(grid.layers.begin(), grid.layers.end(), named_per_hour));
  CHECK_NOTHROW(test::layer(grid, "rate_per_cell_hour"));
  CHECK(test::has_note(section, "rate_per_cell_hour"));
}

TEST_CASE("shares of lost time are percent everywhere, and the name says of what") {
  test::SimulatedLog log(hot_hall(6), 2 * 3'600.0, {{Source::status, 1.0}});
  const Section section = run(log);
  for (const DataTable& table : section.tables) {
    for (const ColumnSpec& column : table.columns) {
      INFO(table.name << " " << column.name);
      CHECK(column.name.find("share") == std::string::npos);
      CHECK(column.name.ends_with("_pct") == (column.unit == "%"));
    }
  }
  const DataTable& reasons = test::table(section, "by_reason");
  double all = 0.0;
  for (std::size_t r = 0; r < reasons.rows.size(); ++r) {
    all += num(test::cell(reasons, r, "lost_of_all_lost_pct"));
  }
  CHECK(all == Approx(100.0));
  CHECK(num(test::cell(test::table(section, "concentration"), 0, "lost_of_all_lost_pct")) == 50.0);
  const auto& robots = test::table(section, "by_robot");
  CHECK(num(test::cell(robots, 0, "lost_of_task_pct")) ==
        Approx(test::finding(section, "BLK-01", "amr-6").value.value.value()));
}

TEST_CASE("how rows are cut into slices does not change a byte of the result") {
  const auto text = [](std::size_t rows) {
    test::SimulatedLog log(hot_hall(8), 900.0, {{Source::registers, 1.0}, {Source::inputs, 0.5}});
    log.lose(300.0, 350.0);
    log.slice_rows(rows);
    return test::text(run(log));
  };
  const std::string whole = text(1'000'000);
  CHECK(whole == text(1));
  CHECK(whole == text(41));
  CHECK(whole.size() > 10'000);
}

TEST_CASE("block_x and block_reason of a robot that is not blocked are never used") {
  MemoryLog log;
  const RobotId robot = log.add_robot("amr-1");
  for (int k = 0; k < 100; ++k) {
    Sample& row = log.row(robot, Source::status, k);
    MemoryLog::set(row, "x", 0.1 * k);
    MemoryLog::set(row, "y", 0.0);
    MemoryLog::set_int(row, "blocked", k >= 50 && k < 60 ? 1 : 0);
    MemoryLog::set_text(row, "current_map", "hall");
    if (k >= 50 && k < 60) {
      MemoryLog::set(row, "block_x", 7.0);
      MemoryLog::set(row, "block_y", 0.0);
    } else {
      MemoryLog::set_state(row, "block_x", State::not_meaningful);
      MemoryLog::set_int(row, "block_reason", 1);
      MemoryLog::set_state(row, "block_reason", State::not_meaningful);
    }
  }
  const Section section = run(log);
  const DataTable& episodes = test::table(section, "episodes");
  REQUIRE(episodes.rows.size() == 1);
  CHECK(std::get<std::string>(test::cell(episodes, 0, "reason")) == "not given");
  CHECK(std::holds_alternative<Missing>(test::cell(episodes, 0, "obstacle_x_m")));  // one episode cannot tell the frame
  // 0.9 m while blocked, as fast as always: the clock ran 10 s, the way alone would have taken 9.
  CHECK(num(test::cell(episodes, 0, "lost")) < 2.0);
}

TEST_CASE("two robots on one map make one site map and keep their own rows") {
  MemoryLog log;
  for (int n = 0; n < 2; ++n) {
    const RobotId robot = log.add_robot("amr-" + std::to_string(n + 1));
    log.period(robot, Source::status, 1.0);
    for (int k = 0; k < 1'000; ++k) {
      Sample& row = log.row(robot, Source::status, k);
      const int phase = k % 40;
      MemoryLog::set(row, "x", 0.5 * (phase < 20 ? phase : 40 - phase));
      MemoryLog::set(row, "y", 1.0);
      MemoryLog::set_text(row, "current_map", "hall");
      MemoryLog::set_int(row, "blocked", phase == 10 && k % 80 == 10 ? 1 : 0);
      MemoryLog::set_int(row, "block_reason", 1);
      MemoryLog::set_int(row, "task_status", 2);
    }
  }
  const Section section = run(log);
  CHECK(section.grids.size() == 1);
  CHECK(test::table(section, "by_robot").rows.size() == 2);
  CHECK(num(test::cell(test::table(section, "by_robot"), 0, "episodes")) == 13);
  CHECK(sum(test::layer(test::grid(section), "episodes")) == 26);
  CHECK(num(test::cell(test::table(section, "top_cells"), 0, "robots")) == 2);
  CHECK(test::finding(section, "BLK-01", "").value.n.value() == 26);
  CHECK(test::finding(section, "BLK-01", "amr-2").value.n.value() == 13);
}

TEST_CASE("a slow poll says that the way between poses is a guess, and a wild pose does not tear the map open") {
  MemoryLog log;
  const RobotId robot = log.add_robot("amr-1");
  log.period(robot, Source::status, 10.0);
  for (int k = 0; k < 400; ++k) {
    Sample& row = log.row(robot, Source::status, 10.0 * k);
    const bool wild = k >= 200 && k < 204;  // localised at the end of the world for half a minute
    MemoryLog::set(row, "x", wild ? 9e5 : 2.0 * (k % 10));
    MemoryLog::set(row, "y", wild ? -9e5 : 0.0);
    MemoryLog::set_int(row, "blocked", 0);
  }
  const Section section = run(log);
  CHECK(test::has_note(section, "guessed to be straight"));
  REQUIRE(section.grids.size() == 1);
  CHECK(section.grids[0].width * section.grids[0].height < 100'000);
  CHECK(test::has_note(section, "leaves out"));
  const Quantity share = test::finding(section, "BLK-01", "amr-1").value;
  CHECK(share.value.value() == 0.0);
  CHECK(share.hi.value() > 0.0);
}

TEST_CASE("what the log cannot tell is unknown, with the reason") {
  MemoryLog empty;
  CHECK(test::finding(run(empty), "BLK-01", "").verdict == Verdict::unknown);
  CHECK(test::finding(run(empty), "BLK-01", "").value.reason.find("no robot") != std::string::npos);

  MemoryLog without;
  const RobotId robot = without.add_robot("amr-1");
  for (int k = 0; k < 50; ++k) {
    MemoryLog::set(without.row(robot, Source::status, k), "x", 1.0);
  }
  Section section = run(without);
  CHECK(test::finding(section, "BLK-01", "amr-1").verdict == Verdict::unknown);
  CHECK(test::finding(section, "BLK-01", "amr-1").value.reason.find("blocked") != std::string::npos);
  CHECK(section.grids.empty());

  MemoryLog one;
  const RobotId single = one.add_robot("amr-1");
  Sample& row = one.row(single, Source::status, 0);
  MemoryLog::set_int(row, "blocked", 1);
  MemoryLog::set(row, "x", 1.0);
  MemoryLog::set(row, "y", 1.0);
  section = run(one);
  CHECK(test::finding(section, "BLK-01", "amr-1").verdict == Verdict::unknown);
  CHECK(test::table(section, "episodes").rows.size() == 1);

  MemoryLog no_pose;
  const RobotId blind = no_pose.add_robot("amr-1");
  for (int k = 0; k < 50; ++k) {
    MemoryLog::set_int(no_pose.row(blind, Source::inputs, k), "blocked", k > 20 && k < 30 ? 1 : 0);
  }
  section = run(no_pose);
  CHECK(test::table(section, "episodes").rows.size() == 1);
  CHECK(section.grids.empty());
  CHECK(test::has_note(section, "no poses"));
}

namespace {

/// Episodes of `length_s` on task, one per `every_s`, at one poll per `period_s`.
Finding lost_share_of(double period_s, double every_s, double length_s, double hours) {
  MemoryLog log;
  const RobotId robot = log.add_robot("amr-1");
  log.period(robot, Source::status, period_s);
  for (double t = 0.0; t < hours * 3'600.0; t += period_s) {
    Sample& row = log.row(robot, Source::status, t);
    MemoryLog::set_int(row, "blocked", std::fmod(t, every_s) < length_s ? 1 : 0);
    MemoryLog::set_int(row, "task_status", 2);
  }
  return test::finding(run(log), "BLK-01", "amr-1");
}

}  // namespace

TEST_CASE("a share of lost time that slow polls blur asks for faster polls, one of few episodes for more hours") {
  const Finding slow = lost_share_of(10.0, 600.0, 10.0, 200.0);
  CHECK(slow.verdict == Verdict::unknown);
  CHECK(slow.advice.find("poll status at 1 Hz") != std::string::npos);
  CHECK(slow.advice.find("record longer") == std::string::npos);
  const Finding few = lost_share_of(1.0, 3'600.0, 60.0, 2.0);
  CHECK(few.verdict == Verdict::unknown);
  CHECK(few.advice.find("record longer") != std::string::npos);
}

TEST_CASE("cells with fewer passes than a rate needs are on the map as such") {
  test::SimulatedLog log(hot_hall(3), 3'600.0, {{Source::status, 1.0}});
  const Section section = run(log);
  REQUIRE(section.grids.size() == 1);
  const auto layer = [&](std::string_view name) -> const GridLayer& {
    const auto& layers = section.grids[0].layers;
    const auto at = std::find_if(layers.begin(), layers.end(), [&](const GridLayer& l) { return l.name == name; });
    REQUIRE(at != layers.end());
    return *at;
  };
  CHECK(layer("too_few").title.starts_with("fewer than "));
  std::size_t few = 0;
  for (std::size_t k = 0; k < layer("rate").value.size(); ++k) {
    const bool marked = std::isfinite(layer("too_few").value[k]);
    few += marked ? 1U : 0U;
    CHECK_FALSE((marked && std::isfinite(layer("rate").value[k])));
    CHECK((marked || std::isfinite(layer("rate").value[k]) || !std::isfinite(layer("passes").value[k])));
  }
  CHECK(few > 0);
}
