#include <limits>

#include "analyzer/analyses/odometry_counter.hpp"
#include "analyzer/analyses/odometry_segments.hpp"
#include "analyzer/analyses/odometry_standstill.hpp"
#include "tests/analyzer/odometry_support.hpp"

using namespace tacho;
using namespace tacho::odometry;

namespace {

Config config() { return Config::load(Settings{}, ""); }

RawRow row(double t_s) {
  RawRow r;
  r.t_us = static_cast<Micros>(t_s * 1e6);
  r.session = 1;
  r.uptime_s = 100.0 + t_s;
  r.x = r.y = r.angle = 0.0;
  r.vx = 0.5;
  r.vy = r.w = 0.0;
  r.odo = 1000.0 + 0.5 * t_s;
  r.reloc = 1;
  r.map = 7;
  return r;
}

const PlannedPeriod kEverySecond(1'000'000, Source::status);

/// Ten good rows at 1 Hz, then `next`; the cut it makes, or nothing when it is joined.
std::optional<Cut> cut_by(RawRow next) {
  Preparation preparation(config(), kEverySecond);
  Prepared out;
  for (int t = 0; t < 10; ++t) {
    REQUIRE(preparation.step(row(t), out));
    CHECK(out.joined == (t > 0));
  }
  REQUIRE(preparation.step(next, out));
  return out.joined ? std::nullopt : std::optional(out.cut);
}

}  // namespace

TEST_CASE("each reason for a new segment is found and named") {
  CHECK_FALSE(cut_by(row(10)).has_value());
  RawRow r = row(10);
  r.session = 2;
  CHECK(cut_by(r) == Cut::session);
  r = row(10);
  r.t_us = row(8.5).t_us;
  CHECK(cut_by(r) == Cut::clock);
  r = row(10);
  r.uptime_s = 3.0;
  CHECK(cut_by(r) == Cut::reboot);
  CHECK_FALSE(cut_by(row(11.5)).has_value());
  CHECK(cut_by(row(12.5)) == Cut::gap);
  r = row(10);
  r.map = 8;
  CHECK(cut_by(r) == Cut::map);
  r = row(10);
  r.reloc = 3;  // done, waiting for confirmation: not confirmed
  CHECK(cut_by(r) == Cut::localisation);
  r = row(10);
  r.odo = 12.0;
  CHECK(cut_by(r) == Cut::counter);
  r = row(10);
  r.x = kNone;
  CHECK(cut_by(r) == Cut::pose);
}

TEST_CASE("a field that one answer leaves out cuts nothing and hides nothing") {
  RawRow r = row(10);
  r.map = 0;
  r.uptime_s = kNone;
  CHECK_FALSE(cut_by(r).has_value());
  Preparation preparation(config(), kEverySecond);
  Prepared out;
  CHECK(preparation.step(row(0), out));
  CHECK(preparation.step(r, out));
  RawRow other = row(11);
  other.map = 9;
  CHECK(preparation.step(other, out));
  CHECK(out.cut == Cut::map);  // against the map of row 0, not against the answer without one
}

TEST_CASE("an answer with the uptime of the one before is one sample") {
  Preparation preparation(config(), kEverySecond);
  Prepared out;
  CHECK(preparation.step(row(0), out));
  RawRow again = row(1);
  again.uptime_s = row(0).uptime_s;
  CHECK_FALSE(preparation.step(again, out));
  CHECK(preparation.duplicates() == 1);
  CHECK(preparation.step(row(2), out));
  CHECK(out.dt_s == Approx(2.0));
  CHECK(out.joined);
}

TEST_CASE("the gap rule follows a changed polling rate") {
  Preparation preparation(config(), kEverySecond);
  Prepared out;
  double t = 0.0;
  for (int i = 0; i < 40; ++i, t += 10.0) {
    preparation.step(row(t), out);
  }
  CHECK(out.joined);  // planned 1 s, but 10 s is what this session does
}

TEST_CASE("a standing robot that is asked less often makes no gap, and does not count as slow polling") {
  Preparation preparation(config(), kEverySecond);
  Track track(config());
  Prepared out;
  double t = 0.0;
  std::uint64_t seq = 0;
  std::size_t cuts = 0;
  const auto rows = [&](int count, double period) {
    for (int i = 0; i < count; ++i, t += period, ++seq) {
      RawRow r = row(t);
      r.session = 1;
      r.seq = seq;
      preparation.step(r, out);
      cuts += out.joined ? 0U : 1U;
      track.push(out);
    }
  };
  const auto rate = [&](const std::string& period, const std::string& doing) {
    Slice slice;
    slice.session = 1;
    Event& event = slice.events.emplace_back();
    event.kind = EventKind::rate;
    event.seq = seq;
    event.subject = doing;
    event.new_value = period;
    preparation.open(slice);
  };
  rows(20, 1.0);
  rate("10.0 s", "idle");
  t += 9.0;
  rows(100, 10.0);
  rate("1.0 s", "moving");
  rows(20, 1.0);
  CHECK(cuts == 1);  // the first row of all
  CHECK(track.period_s() == Approx(1.0));
  t += 9.0;  // at the fast rate again a hole is a hole
  seq += 9;
  rows(1, 1.0);
  CHECK(out.cut == Cut::gap);
}

TEST_CASE("minus zero is zero, and a confidence of 0 is no estimate") {
  Preparation preparation(config(), kEverySecond);
  Prepared out;
  RawRow r = row(0);
  r.vx = -0.0;
  r.confidence_sentinel = true;
  preparation.step(r, out);
  CHECK_FALSE(std::signbit(out.row.vx));
  CHECK(out.row.all(kNoEstimate));
  CHECK(out.row.confidence < 0.0F);
}

TEST_CASE("a track drops rows of a standstill but keeps its ends and every metre") {
  Preparation preparation(config(), kEverySecond);
  Track track(config());
  Prepared out;
  double odo = 0.0;
  for (int t = 0; t < 1000; ++t) {
    RawRow r = row(t);
    const bool drives = t < 20 || t >= 980;
    odo += drives ? 0.5 : 0.0;
    r.vx = drives ? 0.5 : 0.0;
    r.odo = odo;
    preparation.step(r, out);
    track.push(out);
  }
  track.close();
  CHECK(track.total_rows() == 1000);
  CHECK(track.rows().size() < 50);
  CHECK(track.driven_m() == Approx(odo - 0.5));
  CHECK(track.period_s() == Approx(1.0));
  double metres = 0.0;
  for (std::size_t k = 1; k < track.rows().size(); ++k) {
    metres += interval_of(track.rows()[k - 1], track.rows()[k], config()).metres;
  }
  CHECK(metres == Approx(19.0 * 0.5 + 0.25 + 19.0 * 0.5 + 0.25));
}

TEST_CASE("a localisation jump at standstill is kept in the track") {
  Preparation preparation(config(), kEverySecond);
  Track track(config());
  Prepared out;
  for (int t = 0; t < 100; ++t) {
    RawRow r = row(t);
    r.vx = 0.0;
    r.odo = 5.0;
    r.x = t < 50 ? 0.0 : 0.4;
    preparation.step(r, out);
    track.push(out);
  }
  track.close();
  bool found = false;
  for (std::size_t k = 1; k < track.rows().size(); ++k) {
    const Row& a = track.rows()[k - 1];
    const Row& b = track.rows()[k];
    found = found || (b.x - a.x == 0.4 && b.t_us - a.t_us == 1'000'000);
  }
  CHECK(found);
}

TEST_CASE("the quantum of a counter is found") {
  const auto find = [](const std::function<double(int)>& value) {
    QuantumFinder finder;
    for (int i = 0; i < 3000; ++i) {
      finder.add(value(i));
    }
    return std::pair(finder.quantum(), finder.kind());
  };
  CHECK(find([](int i) { return std::round((134766.944 + 0.0137 * i) * 1e3) / 1e3; }) ==
        std::pair(std::optional(1e-3), std::string("decimal number")));
  CHECK(find([](int i) { return static_cast<double>(static_cast<float>(134766.944 + 0.0137 * i)); }) ==
        std::pair(std::optional(0.015625), std::string("float32")));
  CHECK(find([](int i) { return 100.0 + 0.1 * i * std::sqrt(2.0); }) ==
        std::pair(std::optional(0.0), std::string("continuous")));
  QuantumFinder parked;
  for (int i = 0; i < 100; ++i) {
    parked.add(21773.5);
  }
  CHECK_FALSE(parked.quantum().has_value());
  CHECK(float32_step(134766.9375) == 0.015625);
  CHECK(float32_step(262145.0) == 0.03125);
}

TEST_CASE("pose noise comes from fresh poses only, whatever the pose creeps") {
  StandstillFold fold(config());
  Preparation preparation(config(), kEverySecond);
  Prepared out;
  SplitMix random(4);
  double x = 0.0;
  for (int t = 0; t < 4000; ++t) {
    RawRow r = row(t);
    r.vx = 0.0;
    r.odo = 5.0;
    if (t % 2 == 0) {  // localisation at half the polling rate
      double gauss = -6.0;
      for (int k = 0; k < 12; ++k) {
        gauss += random.uniform();
      }
      x = 1e-5 * t + 0.005 * gauss;
    }
    r.x = x;
    preparation.step(r, out);
    fold.add(out);
  }
  const StandstillResult result = fold.finish(1e-3);
  // y never moves: half of the pooled differences are exactly 0, so only x speaks.
  REQUIRE(result.sigma_p.value.has_value());
  CHECK(result.frozen_runs == 0);
  CHECK(result.counting_runs == 0);
  CHECK(result.seconds > 3900.0);
}
