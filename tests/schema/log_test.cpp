#include "schema/log.hpp"

#include <bit>

#include "schema/time.hpp"
#include "schema/wire/registers.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/temp_dir.hpp"

using namespace tacho;

namespace {

constexpr Micros kStart = 1'767'225'600'000'000;  // 2026-01-01T00:00:00Z
constexpr Micros kSecond = 1'000'000;

/// A log of one robot, written through Ingest with a clock of its own.
class Recording {
 public:
  Recording() : writer_(dir_ / "log", options()), ingest(writer_, [this] { return wall_minus_mono; }) {
    session_.t_start_us = kStart;
    session_id_ = writer_.begin_session(session_);
    robot = writer_.robot("amb", "127.0.0.1:19204:502");
    for (const Source source : {Source::status, Source::io, Source::registers, Source::inputs}) {
      Stream stream;
      stream.session = session_id_;
      stream.robot = robot;
      stream.source = source;
      stream.period_us = kSecond;
      ingest.declare(stream);
    }
  }

  void append(Source source, double t_s, std::string body) {
    Answer answer;
    answer.meta.robot = robot;
    answer.meta.source = source;
    answer.meta.session = session_id_;
    answer.meta.seq = seq_[static_cast<std::size_t>(source)]++;
    answer.meta.t_send_us = kStart + static_cast<Micros>(t_s * 1e6);
    answer.meta.t_recv_us = answer.meta.t_send_us + 4000;
    answer.body = std::move(body);
    ingest.append(answer);
  }
  void status(double t_s, std::string body) { append(Source::status, t_s, std::move(body)); }
  void blocked_input(double t_s, bool blocked) {
    std::array<std::uint8_t, 80> bits{};
    bits[1] = blocked ? 1 : 0;
    std::string image;
    wire::append_bits(image, {1, 80}, bits);
    append(Source::inputs, t_s, image);
  }
  void registers(double t_s, std::uint16_t battery_percent, WordOrder order = WordOrder::cdab) {
    std::array<std::uint16_t, 140> words{};
    words[12] = battery_percent;
    words[36] = 3;
    words[37] = 4;
    words[38] = 7;
    words[43] = 1;
    wire::split_words(std::bit_cast<std::uint32_t>(52.5f), order, words[16], words[17]);
    std::string image;
    wire::append_words(image, {1, 140}, words);
    append(Source::registers, t_s, image);
  }
  /// Ends the session and opens the log for reading.
  std::unique_ptr<RowSource> read() {
    writer_.end_session(kStart + 3600 * kSecond, true);
    const std::filesystem::path folder = dir_ / "log";
    return open_log(std::span(&folder, 1));
  }

  Micros wall_minus_mono = kStart - 5 * kSecond;
  RobotId robot = 0;

 private:
  static store::WriterOptions options() {
    store::WriterOptions options;
    options.durable = false;
    return options;
  }
  test::TempDir dir_;
  store::LogWriter writer_;
  Session session_;
  SessionId session_id_ = 0;
  std::array<std::uint64_t, kSourceCount> seq_{};

 public:
  Ingest ingest;
};

struct Everything {
  std::vector<Event> events;
  std::vector<ClockPoint> clock;
};

Everything rows_of(RowSource& log, RobotId robot) {
  Selection selection;
  selection.add(Source::status, field("x"));
  Everything all;
  log.read(robot, {}, selection, [&](const Slice& slice) {
    all.events.insert(all.events.end(), slice.events.begin(), slice.events.end());
    all.clock.insert(all.clock.end(), slice.clock.begin(), slice.clock.end());
  });
  return all;
}

std::vector<Event> of_kind(const std::vector<Event>& events, EventKind kind) {
  std::vector<Event> found;
  std::copy_if(events.begin(), events.end(), std::back_inserter(found), [&](const Event& e) { return e.kind == kind; });
  return found;
}

/// State of one field of `source`, row by row.
std::vector<State> states(RowSource& log, RobotId robot, Source source, FieldIndex f) {
  Selection selection;
  selection.add(source, f);
  std::vector<State> found;
  log.read(robot, {}, selection, [&](const Slice& slice) {
    if (const Batch* const batch = slice.find(source)) {
      const Column* const column = batch->find(f);
      found.insert(found.end(), column->state.begin(), column->state.end());
    }
  });
  return found;
}

std::string create_on(double t_s) {
  return R"({"create_on":")" + iso_utc(kStart + static_cast<Micros>(t_s * 1e6)) + "\"}";
}

}  // namespace

TEST_CASE("what goes in comes out byte for byte, readable or not", "[log]") {
  Recording rec;
  const std::vector<std::string> bodies{R"({"x":1.50,"unheard_of":[1, 2]})", "", std::string("\x1F\x8B\x00\xFF", 4),
                                        R"({"x":2})"};
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    rec.status(static_cast<double>(i), bodies[i]);
  }
  CHECK(rec.ingest.last().at(field("x")).real == 2.0);
  const auto log = rec.read();
  std::vector<std::string> read;
  log->read_raw(rec.robot, Source::status, {}, [&](const Answer& answer) { read.push_back(answer.body); });
  CHECK(read == bodies);
  CHECK(states(*log, rec.robot, Source::status, field("x")) ==
        std::vector<State>{State::present, State::absent, State::absent, State::present});
  REQUIRE(log->unknown_keys().size() == 1);
  CHECK(log->unknown_keys()[0].key == "unheard_of");
  for (const Coverage& coverage : log->coverage()) {
    if (coverage.source == Source::status) {
      CHECK(coverage.stored == 4);
      CHECK(coverage.undecodable == 2);
      CHECK(coverage.seen.test(field("x")));
      CHECK_FALSE(coverage.seen.test(field("y")));
      CHECK(coverage.valued.test(field("x")));
    }
  }
  const std::vector<Event> events = rows_of(*log, rec.robot).events;
  CHECK(of_kind(events, EventKind::unknown_key).size() == 1);
  CHECK(of_kind(events, EventKind::undecodable).size() == 2);  // once when it starts, once when it ends
}

TEST_CASE("edges become events of the log", "[log]") {
  Recording rec;
  rec.status(0, R"({"blocked":false,"errors":[]})");
  rec.status(1, R"({"blocked":true,"errors":[{"52201":7,"desc":"no path","times":1}]})");
  rec.status(2, R"({"blocked":true,"errors":[]})");
  const auto log = rec.read();
  const std::vector<Event> events = rows_of(*log, rec.robot).events;
  REQUIRE(events.size() == 3);
  CHECK(events[0].kind == EventKind::blocked);
  CHECK(events[1].subject == "error 52201");
  CHECK(events[1].detail == "no path");
  CHECK(events[1].t_from_us == kStart);
  CHECK(events[2].kind == EventKind::alarm_cleared);
}

TEST_CASE("the robot is who its answers say it is", "[log]") {
  Recording rec;
  rec.status(0, R"({"vehicle_id":"AMB-01","MAC":"020000A1B2C3","model_md5":""})");
  rec.registers(0.5, 80);
  rec.status(1, R"({"vehicle_id":"AMB-01","MAC":"","model_md5":"775743e8"})");
  const auto log = rec.read();
  REQUIRE(log->robots().size() == 1);
  const Robot robot = log->robots()[0];
  CHECK(robot.vehicle_id == "AMB-01");
  CHECK(robot.mac == "020000A1B2C3");
  CHECK(robot.model_md5 == "775743e8");
  CHECK(robot.firmware == "3.4.7.0");
}

TEST_CASE("registers mean what the inputs beside them allow", "[log]") {
  Recording rec;
  rec.registers(0.0, 80);  // nobody has told whether it is blocked
  rec.blocked_input(0.5, false);
  rec.registers(1.0, 80);
  rec.blocked_input(1.5, true);
  rec.registers(2.0, 80);
  const auto log = rec.read();
  CHECK(states(*log, rec.robot, Source::registers, field("block_reason")) ==
        std::vector<State>{State::not_meaningful, State::not_meaningful, State::present});
  CHECK(states(*log, rec.robot, Source::registers, field("battery_level")) == std::vector<State>(3, State::present));
}

TEST_CASE("the word order found at the start is the one the log is read with", "[log]") {
  Recording rec;
  rec.ingest.set_word_order(rec.robot, Source::registers, WordOrder::abcd);
  rec.registers(0, 80, WordOrder::abcd);
  CHECK(rec.ingest.last().at(field("voltage")).real == 52.5);
  const auto log = rec.read();
  Selection selection;
  selection.add(Source::registers, field("voltage"));
  int rows = 0;
  log->read(rec.robot, {}, selection, [&](const Slice& slice) {
    const Batch* const batch = slice.find(Source::registers);
    REQUIRE(batch != nullptr);
    CHECK(batch->columns[0].real[0] == 52.5);
    ++rows;
  });
  CHECK(rows == 1);
}

TEST_CASE("the robot's clock is noted about once a minute, at the middle of the request", "[log]") {
  Recording rec;
  for (int t = 0; t < 200; ++t) {
    rec.status(t, create_on(t + 2.5));
    rec.registers(t + 0.5, 80);
  }
  const auto log = rec.read();
  const std::vector<ClockPoint> clock = rows_of(*log, rec.robot).clock;
  REQUIRE(clock.size() == 4);
  for (std::size_t i = 0; i < clock.size(); ++i) {
    CHECK(clock[i].robot == rec.robot);
    CHECK(clock[i].wall_us == kStart + static_cast<Micros>(i) * 60 * kSecond + 2000);
    CHECK(clock[i].mono_us == clock[i].wall_us - rec.wall_minus_mono);
    REQUIRE(clock[i].robot_us.has_value());
    CHECK(*clock[i].robot_us - clock[i].wall_us == 2'498'000);
  }
}

TEST_CASE("a robot that never tells its time has points of the host clocks", "[log]") {
  Recording rec;
  for (int t = 0; t < 200; ++t) {
    rec.registers(t, 80);
  }
  const auto log = rec.read();
  const std::vector<ClockPoint> clock = rows_of(*log, rec.robot).clock;
  REQUIRE(clock.size() == 3);  // after 10 s, then every 70 s
  CHECK_FALSE(clock[0].robot_us.has_value());
}

TEST_CASE("a step of the wall clock is a point and an event, slewing is not", "[log]") {
  Recording rec;
  rec.status(0, create_on(0));
  rec.wall_minus_mono += 30'000;  // slewed
  rec.status(1, create_on(1));
  rec.wall_minus_mono += 3600 * kSecond;  // stepped, and the answer's time with it
  rec.status(3602, create_on(3602));
  rec.status(3603, create_on(3603));
  const auto log = rec.read();
  const Everything all = rows_of(*log, rec.robot);
  CHECK(all.clock.size() == 2);
  REQUIRE(of_kind(all.events, EventKind::clock_step).size() == 1);
  CHECK(of_kind(all.events, EventKind::clock_step)[0].new_value == "+3600.030 s");
}

TEST_CASE("a time the robot cannot mean is no time", "[log]") {
  for (const char* const text : {"", "yesterday", "2026-13-45T99:99:99Z", "2026-01-01T00:00:00.000Mars/Olympus"}) {
    Recording rec;
    rec.status(0, std::string(R"({"create_on":")") + text + "\"}");
    rec.status(15, std::string(R"({"create_on":")") + text + "\"}");
    const auto log = rec.read();
    const std::vector<ClockPoint> clock = rows_of(*log, rec.robot).clock;
    INFO(text);
    REQUIRE(clock.size() == 1);
    CHECK_FALSE(clock[0].robot_us.has_value());
  }
}

TEST_CASE("the host's clocks differ by a constant", "[log]") {
  CHECK(std::abs(host_wall_minus_mono() - host_wall_minus_mono()) < 500'000);
}
