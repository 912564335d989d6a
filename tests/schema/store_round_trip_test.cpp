// Whatever goes into a log comes out again, byte for byte and in order.

#include <random>

#include "tests/schema/store_fixture.hpp"

using namespace tacho;
using namespace tacho::test;

namespace {

std::string random_bytes(std::size_t size, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::string bytes(size, '\0');
  for (char& c : bytes) {
    c = static_cast<char>(random());
  }
  return bytes;
}

}  // namespace

TEST_CASE("any bytes come back as they were") {
  std::string zeros(100'000, '\0');
  const std::vector<std::string> bodies{"",
                                        "{}",
                                        std::string("a\0b\0", 4),
                                        "\xC3\x28\xFF\xFE not UTF-8",
                                        random_bytes(1, 1),
                                        random_bytes(300, 2),
                                        random_bytes(300, 2),
                                        "",
                                        "",
                                        random_bytes(5000, 3),
                                        zeros,
                                        zeros + "1",
                                        std::string("\x28\xB5\x2F\xFD", 4),
                                        body_of(1),
                                        body_of(2)};
  for (const int keyframe_every : {0, 1, 3, 60}) {
    TempDir dir;
    store::WriterOptions options;
    options.keyframe_every = keyframe_every;
    {
      Recording recording(dir.path(), options);
      for (const std::string& body : bodies) {
        recording.poll(body);
      }
      recording.end();
    }
    store::LogReader log = open_reader(dir.path());
    const std::vector<Stored> out = stored(log);
    REQUIRE(out.size() == bodies.size());
    for (std::size_t i = 0; i < bodies.size(); ++i) {
      INFO("keyframe every " << keyframe_every << ", body " << i);
      CHECK(out[i].body == bodies[i]);
      CHECK(out[i].seq == i);
    }
    CHECK(log.problems().empty());
  }
}

TEST_CASE("a body of 16 MiB comes back as it was") {
  TempDir dir;
  std::string big = random_bytes(16U << 20U, 7);
  {
    Recording recording(dir.path());
    recording.poll(big);
    big[12345] ^= 1;
    recording.poll(big);
    recording.end();
  }
  store::LogReader log = open_reader(dir.path());
  const std::vector<Stored> out = stored(log);
  REQUIRE(out.size() == 2);
  CHECK(out[1].body == big);
  big[12345] ^= 1;
  CHECK(out[0].body == big);
}

TEST_CASE("random series of bodies come back for any mix of lengths and repetitions") {
  std::mt19937_64 random(42);
  for (int round = 0; round < 5; ++round) {
    TempDir dir;
    store::WriterOptions options;
    options.keyframe_every = static_cast<int>(random() % 8);
    options.durable = false;
    std::vector<std::string> bodies;
    {
      Recording recording(dir.path(), options);
      std::string body = random_bytes(200, random());
      for (int i = 0; i < 300; ++i) {
        switch (random() % 5) {
          case 0:
            break;  // the same again
          case 1:
            body = random_bytes(random() % 700, random());
            break;
          default:
            if (!body.empty()) {
              body[random() % body.size()] ^= static_cast<char>(random());
            }
        }
        bodies.push_back(body);
        recording.poll(body);
        if (random() % 20 == 0) {
          recording.writer.commit();
        }
      }
      recording.end();
    }
    store::LogReader log = open_reader(dir.path());
    const std::vector<Stored> out = stored(log);
    REQUIRE(out.size() == bodies.size());
    bool same = true;
    for (std::size_t i = 0; i < bodies.size(); ++i) {
      same = same && out[i].body == bodies[i];
    }
    CHECK(same);
  }
}

TEST_CASE("times, headers and numbers come back as they were") {
  TempDir dir;
  const std::string header("\x5A\x01\x00\x07\x00\x00\x00\x02\x2A\xF8\x04\x4C\x00\x00\x01\x00", 16);
  {
    Recording recording(dir.path());
    Answer answer = answer_of(recording.session, recording.robot, Source::status, 7, kT0 + 5, "ab");
    answer.meta.t_recv_us = kT0 - 3;  // the clock was set back meanwhile
    answer.header = header;
    recording.writer.append(answer);
    recording.end();
  }
  store::LogReader log = open_reader(dir.path());
  int rows = 0;
  log.read_raw(1, Source::status, Window{}, [&](const Answer& a) {
    ++rows;
    CHECK(a.meta.robot == 1);
    CHECK(a.meta.session == 1);
    CHECK(a.meta.seq == 7);
    CHECK(a.meta.t_send_us == kT0 + 5);
    CHECK(a.meta.t_recv_us == kT0 - 3);
    CHECK(a.header == header);
    CHECK(a.body == "ab");
  });
  CHECK(rows == 1);
}

TEST_CASE("records come back as they were") {
  TempDir dir;
  Robot identity;
  identity.vehicle_id = "AMB-01";
  identity.mac = "020000A1B2C3";
  identity.model_md5 = "d41d8";
  identity.firmware = "3.4.6.18";
  Event event;
  event.kind = EventKind::alarm_raised;
  event.seq = 3;
  event.t_from_us = kT0 + 1;
  event.t_us = kT0 + 2;
  event.subject = "error 52201";
  event.old_value = "";
  event.new_value = "1";
  event.detail = "robot is \"out of path\", \xE5\x81\x8F";
  ClockPoint point;
  point.wall_us = kT0 + 3;
  point.mono_us = 77;
  point.robot_us = kT0 - 3'600'000'000;
  Gap gap;
  {
    Recording recording(dir.path());
    recording.writer.identify(recording.robot, identity);
    recording.writer.set_word_order(recording.robot, Source::status, WordOrder::abcd);
    event.robot = point.robot = recording.robot;
    event.session = point.session = recording.session;
    recording.writer.add(event);
    recording.writer.add(point);
    point.robot = 0;
    point.robot_us.reset();
    recording.writer.add(point);
    gap = gap_of(recording.session, recording.robot, Source::status, 0, 4, kT0);
    gap.cause = Cause::modbus_exception;
    gap.partial = true;
    gap.detail = "120-140: exception 2";
    recording.writer.add(gap);
    recording.end();
  }
  store::LogReader log = open_reader(dir.path());
  const Robot robot = log.robots().at(0);
  CHECK(robot.name == "amr-1");
  CHECK(robot.address == "127.0.0.1:19204:502");
  CHECK(robot.vehicle_id == identity.vehicle_id);
  CHECK(robot.mac == identity.mac);
  CHECK(robot.model_md5 == identity.model_md5);
  CHECK(robot.firmware == identity.firmware);
  CHECK(log.streams().at(0).word_order == WordOrder::abcd);
  CHECK(log.sessions().at(0).clean);

  const std::vector<Slice> out = slices(log);
  REQUIRE(out.size() == 1);
  REQUIRE(out[0].events.size() == 1);
  const Event& e = out[0].events[0];
  CHECK(e.kind == event.kind);
  CHECK(e.seq == event.seq);
  CHECK(e.t_from_us == event.t_from_us);
  CHECK(e.t_us == event.t_us);
  CHECK(e.subject == event.subject);
  CHECK(e.old_value == event.old_value);
  CHECK(e.new_value == event.new_value);
  CHECK(e.detail == event.detail);
  REQUIRE(out[0].clock.size() == 2);
  CHECK(out[0].clock[0].robot_us == kT0 - 3'600'000'000);
  CHECK(out[0].clock[0].mono_us == 77);
  CHECK(out[0].clock[1].robot == 0);
  CHECK_FALSE(out[0].clock[1].robot_us.has_value());
  REQUIRE(out[0].gaps.size() == 1);
  CHECK(out[0].gaps[0].cause == Cause::modbus_exception);
  CHECK(out[0].gaps[0].partial);
  CHECK(out[0].gaps[0].detail == gap.detail);
  const Coverage coverage = coverage_of(log);
  CHECK(coverage.partial == 4);
  CHECK(coverage.missed == 0);
}

TEST_CASE("an empty log opens and holds nothing") {
  TempDir dir;
  { store::LogWriter writer(dir.path()); }
  store::LogReader log = open_reader(dir.path());
  CHECK(log.robots().empty());
  CHECK(log.coverage().empty());
  CHECK(slices(log).empty());
  CHECK(log.problems().empty());
}

TEST_CASE("a log of one snapshot is one slice of one row") {
  TempDir dir;
  {
    Recording recording(dir.path());
    recording.polls(1);
    recording.end();
  }
  store::LogReader log = open_reader(dir.path());
  const std::vector<Slice> out = slices(log);
  REQUIRE(out.size() == 1);
  const Batch* batch = out[0].find(Source::status);
  REQUIRE(batch != nullptr);
  CHECK(batch->rows() == 1);
  CHECK(coverage_of(log).stored == 1);
  CHECK(coverage_of(log).planned == 1);
}

TEST_CASE("sources and robots do not disturb each other") {
  TempDir dir;
  {
    Recording recording(dir.path());
    store::LogWriter& w = recording.writer;
    const RobotId second = w.robot("amr-2", "127.0.0.2:19204:502");
    w.declare(stream_of(1, second, Source::status));
    w.declare(stream_of(1, recording.robot, Source::io));
    for (std::uint64_t i = 0; i < 200; ++i) {
      const Micros t = kT0 + static_cast<Micros>(i) * kSecond;
      w.append(answer_of(1, second, Source::status, i, t, "second " + std::to_string(i)));
      w.append(answer_of(1, recording.robot, Source::io, i, t, "io " + std::to_string(i / 10)));
      recording.polls(1);
    }
    recording.end();
  }
  store::LogReader log = open_reader(dir.path());
  const auto first = stored(log, 1, Source::status);
  const auto io = stored(log, 1, Source::io);
  const auto second = stored(log, 2, Source::status);
  REQUIRE(first.size() == 200);
  REQUIRE(io.size() == 200);
  REQUIRE(second.size() == 200);
  CHECK(first[150].body == body_of(150));
  CHECK(io[150].body == "io 15");
  CHECK(second[150].body == "second 150");
  CHECK(log.coverage().size() == 3);
}
