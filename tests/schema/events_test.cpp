#include "schema/events.hpp"

#include "schema/wire/registers.hpp"
#include "schema/wire/status_json.hpp"
#include "tests/support/catch.hpp"

using namespace tacho;

namespace {

constexpr Micros kRtt = 4000;
const FieldSet kAll = FieldSet().set();

/// Feeds answers to one machine; every call returns the events of that answer.
class Feed {
 public:
  std::vector<Event> json(double t_s, std::string_view body, Source source = Source::status) {
    wire::JsonDecoder decoder;
    start(t_s, source);
    decoder.decode(body, kAll, true, sample_);
    return step();
  }
  std::vector<Event> inputs(double t_s, std::initializer_list<std::size_t> set_addresses) {
    std::array<std::uint8_t, 80> bits{};
    for (const std::size_t address : set_addresses) {
      bits[address - 1] = 1;
    }
    std::string image;
    wire::append_bits(image, {1, 80}, bits);
    Gates gates;
    start(t_s, Source::inputs);
    wire::decode_inputs(image, kAll, gates, sample_);
    return step();
  }
  std::vector<Event> registers(double t_s, std::size_t address, std::uint16_t value) {
    std::array<std::uint16_t, 140> words{};
    words[address - 1] = value;
    std::string image;
    wire::append_words(image, {1, 140}, words);
    start(t_s, Source::registers);
    wire::decode_registers(image, WordOrder::cdab, {}, kAll, sample_);
    return step();
  }

  EventMachine machine;

 private:
  Sample sample_;
  std::uint64_t seq_ = 0;

  void start(double t_s, Source source) {
    sample_.meta = {};
    sample_.meta.robot = 3;
    sample_.meta.session = 2;
    sample_.meta.source = source;
    sample_.meta.seq = seq_++;
    sample_.meta.t_send_us = static_cast<Micros>(t_s * 1e6);
    sample_.meta.t_recv_us = sample_.meta.t_send_us + kRtt;
  }
  std::vector<Event> step() {
    std::vector<Event> events;
    machine.step(sample_, [&](const Event& event) { events.push_back(event); });
    return events;
  }
};

Micros sent(double t_s) { return static_cast<Micros>(t_s * 1e6); }
Micros received(double t_s) { return sent(t_s) + kRtt; }

std::string summary(const std::vector<Event>& events) {
  std::string text;
  for (const Event& e : events) {
    text += std::string(text.empty() ? "" : "; ") + std::string(event_kind_name(e.kind)) +
            (e.subject.empty() ? "" : " " + e.subject) + " " + e.old_value + "->" + e.new_value;
  }
  return text;
}

}  // namespace

TEST_CASE("the first answer sets the state without an event", "[events]") {
  Feed feed;
  CHECK(summary(feed.json(0, R"({"blocked":true,"emergency":true,"task_status":2,"current_station":"A","time":5,
      "current_lock":{"locked":true},"DI":[{"id":1,"status":true}],"errors":[]})"))
            .empty());
}

TEST_CASE("a flag's edge lies between the request before and the receipt after", "[events]") {
  Feed feed;
  feed.json(1, R"({"blocked":false})");
  feed.json(2, R"({"blocked":false})");
  const std::vector<Event> events = feed.json(3, R"({"blocked":true})");
  REQUIRE(summary(events) == "blocked false->true");
  const Event& e = events[0];
  CHECK(e.robot == 3);
  CHECK(e.session == 2);
  CHECK(e.seq == 2);
  CHECK(e.source == Source::status);
  CHECK(e.t_from_us == sent(2));
  CHECK(e.t_us == received(3));
  CHECK(summary(feed.json(4, R"({"blocked":true})")).empty());
  CHECK(summary(feed.json(5, R"({"blocked":false})")) == "blocked true->false");
}

TEST_CASE("every watched state makes its own kind of event", "[events]") {
  Feed feed;
  feed.json(1, R"({"slowed":false,"emergency":false,"soft_emc":false,"driver_emc":false,"charging":false,
      "task_status":2,"current_station":"","current_map":"a","current_map_md5":"1","reloc_status":1,
      "vehicle_id":"AMB-01","MAC":"02","model_md5":"m"})");
  CHECK(
      summary(feed.json(2, R"({"slowed":true,"emergency":true,"soft_emc":true,"driver_emc":true,"charging":true,
      "task_status":4,"current_station":"LM1","current_map":"b","current_map_md5":"2","reloc_status":2,
      "vehicle_id":"AMB-02","MAC":"03","model_md5":"n"})")) ==
      "identity vehicle_id AMB-01->AMB-02; identity mac 02->03; identity model_md5 m->n; map name a->b; map md5 1->2; "
      "localisation success->relocating; emergency false->true; emergency software false->true; "
      "driver_emergency false->true; slowed false->true; charging false->true; task running->completed; "
      "station current_station ->LM1");
}

TEST_CASE("a code without a name is told as a number", "[events]") {
  Feed feed;
  feed.json(1, R"({"task_status":2})");
  CHECK(summary(feed.json(2, R"({"task_status":77})")) == "task running->77");
}

TEST_CASE("silence about a state changes nothing", "[events]") {
  Feed feed;
  feed.json(1, R"({"blocked":true,"errors":[{"52201":10}]})");
  CHECK(summary(feed.json(2, R"({})")).empty());
  CHECK(summary(feed.json(3, R"({"blocked":null,"errors":null})")).empty());
  CHECK(summary(feed.json(4, R"({"blocked":"yes","errors":[{"desc":"no code"}]})")) == "unknown_key errors[] ->");
  const std::vector<Event> events = feed.json(5, R"({"blocked":false,"errors":[]})");
  CHECK(summary(events) == "blocked true->false; alarm_cleared error 52201 1->0");
  CHECK(events[0].t_from_us == sent(1));  // the whole silence is part of the edge
  CHECK(events[1].t_from_us == sent(1));
}

TEST_CASE("each source has its own edges, so a slow one does not undo a fast one", "[events]") {
  Feed feed;
  feed.json(1, R"({"blocked":false})");
  feed.inputs(1.1, {});
  CHECK(summary(feed.inputs(1.3, {2})) == "blocked false->true");
  CHECK(summary(feed.inputs(1.5, {2})).empty());
  CHECK(summary(feed.json(2, R"({"blocked":true})")) == "blocked false->true");
  CHECK(summary(feed.inputs(2.1, {2})).empty());
}

TEST_CASE("station names and station numbers are different things", "[events]") {
  Feed feed;
  feed.json(1, R"({"current_station":"LM1"})");
  feed.registers(1.1, 34, 1);
  CHECK(summary(feed.json(2, R"({"current_station":""})")) == "station current_station LM1->");
  CHECK(summary(feed.registers(2.1, 34, 0)) == "station current_station_id 1->0");
}

TEST_CASE("alarms standing at the start are raised with nothing known before", "[events]") {
  Feed feed;
  const std::vector<Event> events =
      feed.json(1, R"({"warnings":[{"54003":9}],"fatals":[{"50000":10,"desc":"boom","times":3}]})");
  REQUIRE(summary(events) == "alarm_raised fatal 50000 ->3; alarm_raised warning 54003 ->1");
  CHECK(events[0].detail == "boom");
  CHECK(events[0].t_from_us == events[0].t_us);
}

TEST_CASE("alarms are raised, repeated and cleared by level and code", "[events]") {
  Feed feed;
  feed.json(1, R"({"errors":[],"warnings":[]})");
  const std::vector<Event> raised =
      feed.json(2, R"({"errors":[{"52201":10,"desc":"no path","times":1}],"warnings":[{"52201":10}]})");
  CHECK(summary(raised) == "alarm_raised error 52201 0->1; alarm_raised warning 52201 0->1");
  CHECK(raised[0].t_from_us == sent(1));
  CHECK(raised[0].t_us == received(2));
  CHECK(raised[0].detail == "no path");
  CHECK(summary(feed.json(3, R"({"errors":[{"52201":10,"desc":"no path at all","times":1}]})")).empty());
  CHECK(summary(feed.json(4, R"({"errors":[{"52201":12,"times":4}]})")) == "alarm_repeated error 52201 1->4");
  CHECK(summary(feed.json(5, R"({"errors":[],"warnings":[]})")) ==
        "alarm_cleared error 52201 4->0; alarm_cleared warning 52201 1->0");
}

TEST_CASE("an alarm that starts again between two answers is cleared and raised", "[events]") {
  Feed feed;
  feed.json(1, R"({"errors":[{"52201":10,"times":5}]})");
  CHECK(summary(feed.json(2, R"({"errors":[{"52201":20,"times":1}]})")) ==
        "alarm_cleared error 52201 5->0; alarm_raised error 52201 0->1");
  CHECK(summary(feed.json(3, R"({"errors":[{"52201":30,"times":1}]})")) ==
        "alarm_cleared error 52201 1->0; alarm_raised error 52201 0->1");
}

TEST_CASE("the same alarm twice in one answer is one alarm", "[events]") {
  Feed feed;
  feed.json(1, R"({"errors":[]})");
  CHECK(summary(feed.json(2, R"({"errors":[{"52111":10,"times":1,"desc":"a"},{"52111":11,"times":2,"desc":"b"}]})")) ==
        "alarm_raised error 52111 0->2");
  CHECK(summary(feed.json(3, R"({"errors":[{"52111":10,"times":2,"desc":"a"}]})")).empty());
}

TEST_CASE("an alarm that cannot be read in one answer is not cleared by it", "[events]") {
  Feed feed;
  feed.json(1, R"({"errors":[{"52201":10},{"52202":10,"times":2}]})");
  CHECK(summary(feed.json(2, R"({"errors":[{"52202":10,"times":3},{"desc":"no code"}]})")) ==
        "unknown_key errors[] ->; alarm_repeated error 52202 2->3");
  CHECK(feed.json(3, R"({"errors":[{"52201":10},{"52202":10,"times":3}]})").empty());
  CHECK(feed.json(4, R"({"errors":[{"52202":10,"times":3},17]})").empty());
  const std::vector<Event> events = feed.json(5, R"({"errors":[]})");
  REQUIRE(summary(events) == "alarm_cleared error 52201 1->0; alarm_cleared error 52202 3->0");
  CHECK(events[0].t_from_us == sent(3));  // each since it was shown last
  CHECK(events[1].t_from_us == sent(4));
}

TEST_CASE("an alarm that comes after an answer with an odd element may have stood in it", "[events]") {
  Feed feed;
  feed.json(1, R"({"errors":[]})");
  CHECK(summary(feed.json(2, R"({"errors":[{"52201":10},{}]})")) ==
        "unknown_key errors[] ->; alarm_raised error 52201 0->1");
  const std::vector<Event> events = feed.json(3, R"({"errors":[{"52201":10},{"52202":10}]})");
  REQUIRE(summary(events) == "alarm_raised error 52202 0->1");
  CHECK(events[0].t_from_us == sent(1));
  Feed from_the_start;
  from_the_start.json(1, R"({"errors":[{"52201":10},{}]})");
  CHECK(summary(from_the_start.json(2, R"({"errors":[{"52201":10},{"52202":10}]})")) == "alarm_raised error 52202 ->1");
}

TEST_CASE("a robot that makes up alarms beside odd elements fills no memory", "[events]") {
  Feed feed;
  feed.json(0, R"({"errors":[]})");
  for (int i = 0; i < 3000; ++i) {
    feed.json(1 + i, R"({"errors":[{},{")" + std::to_string(50000 + i) + R"(":1}]})");
  }
  CHECK(feed.json(5000, R"({"errors":[]})").size() <= 1000);
}

TEST_CASE("an uptime that falls is a reboot, a gap is not", "[events]") {
  Feed feed;
  feed.json(1, R"({"time":5000000})");
  CHECK(summary(feed.json(500, R"({"time":5499000})")).empty());
  CHECK(summary(feed.json(501, R"({"time":5498900})")).empty());  // within the tolerance
  const std::vector<Event> events = feed.json(600, R"({"time":30000})");
  REQUIRE(summary(events) == "reboot 5498.900 s->30.000 s");
  CHECK(events[0].t_from_us == sent(501));
  CHECK(events[0].detail == "running since 1970-01-01T00:09:30.004Z");
}

TEST_CASE("an absurd uptime is no uptime", "[events]") {
  Feed feed;
  feed.json(1, R"({"time":5000})");
  CHECK(summary(feed.json(2, R"({"time":-1e300})")).empty());
  CHECK(summary(feed.json(3, R"({"time":1e300})")).empty());
  CHECK(summary(feed.json(4, R"({"time":8000})")).empty());
}

TEST_CASE("points make edges by number and kind", "[events]") {
  Feed feed;
  feed.json(
      1, R"({"DI":[{"id":3,"status":false},{"id":9,"source":"virtual","status":true}],"DO":[{"id":3,"status":true}]})");
  const std::vector<Event> events = feed.json(
      2,
      R"({"DI":[{"id":3,"status":true},{"id":9,"source":"virtual","status":false}],"DO":[{"id":3,"status":false}]})");
  CHECK(summary(events) ==
        "digital_input DI 3 false->true; digital_input DI 9 true->false; digital_output DO 3 true->false");
  CHECK(events[0].detail.empty());
  CHECK(events[1].detail == "virtual");
  CHECK(summary(feed.json(3, R"({"DI":[true,true,true,false]})")) == "digital_input DI 3 true->false");
}

TEST_CASE("an edge of a point seen by three sources is reported once, from the best of them", "[events]") {
  Feed feed;
  const auto point = [](bool on) { return std::string(R"({"DI":[{"id":3,"status":)") + (on ? "true}]}" : "false}]}"); };
  feed.json(1.0, point(false), Source::io);
  feed.inputs(1.1, {});
  feed.json(1.2, point(false));
  CHECK(feed.inputs(1.3, {23}).empty());  // [1x]23 is DI 3; io has told it a moment ago
  CHECK(feed.json(1.4, point(true)).empty());
  const std::vector<Event> events = feed.json(1.5, point(true), Source::io);
  REQUIRE(summary(events) == "digital_input DI 3 false->true");
  CHECK(events[0].source == Source::io);
  CHECK(events[0].t_from_us == sent(1.0));
}

TEST_CASE("when the best source of a point falls silent the next one takes over, without a false edge", "[events]") {
  Feed feed;
  feed.json(1.0, R"({"DI":[{"id":3,"status":true},{"id":20,"status":false}]})", Source::io);
  CHECK(feed.inputs(2.0, {}).empty());    // io is alive: its word counts
  CHECK(feed.inputs(9.0, {23}).empty());  // agrees with what io said last
  const std::vector<Event> events = feed.inputs(9.2, {});
  REQUIRE(summary(events) == "digital_input DI 3 true->false");
  CHECK(events[0].t_from_us == sent(9.0));
  CHECK(summary(feed.json(9.3, R"({"DI":[{"id":3,"status":true},{"id":20,"status":true}]})")) ==
        "digital_input DI 20 false->true");  // only status tells point 20 now
}

TEST_CASE("a point told twice in one answer makes no edges of its own", "[events]") {
  Feed feed;
  const char* const body = R"({"DI":[{"id":1,"status":true},{"id":1,"status":false}]})";
  feed.json(1, body);
  CHECK(feed.json(2, body).empty());
}

TEST_CASE("who has control is one value", "[events]") {
  Feed feed;
  feed.json(1, R"({"current_lock":{"locked":false}})");
  feed.registers(1, 43, 0);
  CHECK(summary(feed.json(2, R"({"current_lock":{"locked":true,"nick_name":"RDS","ip":"10.0.0.2"}})")) ==
        "control_owner nobody->RDS (10.0.0.2)");
  CHECK(summary(feed.json(3, R"({"current_lock":{"locked":true}})")) == "control_owner RDS (10.0.0.2)->somebody");
  CHECK(summary(feed.registers(4, 43, 1)) == "control_owner own->external");
}

TEST_CASE("a firmware change is a change of identity", "[events]") {
  Feed feed;
  feed.registers(1, 38, 4);
  CHECK(summary(feed.registers(2, 38, 5)) == "identity firmware 0.4.0.0->0.5.0.0");
}

TEST_CASE("decodability is told when it changes, and an unreadable answer changes nothing else", "[events]") {
  Feed feed;
  feed.json(1, R"({"blocked":true})");
  CHECK(summary(feed.json(2, "\x1F\x8B")) == "undecodable false->true");
  CHECK(feed.json(3, "\x1F\x8B").empty());
  CHECK(summary(feed.json(4, R"({"blocked":true})")) == "undecodable true->false");
  Feed from_the_start;
  CHECK(summary(from_the_start.json(1, "nonsense")) == "undecodable ->true");
}

TEST_CASE("an unknown key is told once, and a robot that makes up keys is cut off", "[events]") {
  Feed feed;
  CHECK(summary(feed.json(1, R"({"b":1,"a":1})")) == "unknown_key a ->; unknown_key b ->");
  CHECK(summary(feed.json(2, R"({"b":1,"a":1,"c":1})")) == "unknown_key c ->");
  CHECK(feed.json(3, R"({"a":1})", Source::io).size() == 1);  // told per source
  std::string body = "{\"k\":0";
  for (int i = 0; i < 1000; ++i) {
    body += ",\"k" + std::to_string(i) + "\":1";
  }
  CHECK(feed.json(4, body + "}").size() == 197);
}

TEST_CASE("a wall clock that steps back gives no reversed interval", "[events]") {
  Feed feed;
  feed.json(1000, R"({"blocked":false})");
  const std::vector<Event> events = feed.json(1, R"({"blocked":true})");
  REQUIRE(events.size() == 1);
  CHECK(events[0].t_from_us == events[0].t_us);
}

TEST_CASE("the fields a machine asks for are all it needs", "[events]") {
  const std::string first = R"({"blocked":false,"time":9000,"errors":[],"DI":[{"id":1,"status":false}],"x":1,
      "current_lock":{"locked":false},"current_map":"a","vehicle_id":"r"})";
  const std::string second =
      R"({"blocked":true,"time":10,"errors":[{"52201":1,"times":2}],"DI":[{"id":1,"status":true}],
      "x":2,"current_lock":{"locked":true,"nick_name":"n"},"current_map":"b","vehicle_id":"s"})";
  const auto run = [&](const FieldSet& fields) {
    EventMachine machine;
    wire::JsonDecoder decoder;
    std::vector<Event> events;
    for (const std::string& body : {first, second}) {
      Sample sample;
      decoder.decode(body, fields, false, sample);
      machine.step(sample, [&](const Event& event) { events.push_back(event); });
    }
    return summary(events);
  };
  CHECK(run(EventMachine::fields(Source::status)) == run(kAll));
  CHECK_FALSE(EventMachine::fields(Source::status).test(field("voltage")));
  CHECK(EventMachine::fields(Source::ring).none());
  CHECK(EventMachine::fields(Source::io).test(field("di")));
  CHECK(EventMachine::fields(Source::inputs).test(field("di_15")));
  CHECK(EventMachine::fields(Source::inputs).test(field("blocked")));
  CHECK(EventMachine::fields(Source::registers).test(field("current_station_id")));
  CHECK_FALSE(EventMachine::fields(Source::registers).test(field("blocked")));
}

TEST_CASE("a pose that moves farther than speed and acceleration allow is a jump, on the same map alone") {
  Feed feed;
  const auto at = [](double x, double v, const char* map = "m1") {
    return "{\"x\":" + std::to_string(x) + ",\"y\":0,\"angle\":0.1,\"vx\":" + std::to_string(v) +
           ",\"vy\":0,\"w\":0,\"current_map_md5\":\"" + map + "\"}";
  };
  CHECK(summary(feed.json(0, at(0, 1))) == "");
  CHECK(summary(feed.json(1, at(1.1, 1))) == "");
  CHECK(summary(feed.json(2, at(2.6, 0))) == "");  // 1 m/s before, and 0.75 m by acceleration
  const std::vector<Event> jump = feed.json(3, at(4.0, 0));
  CHECK(summary(jump) == "pose_jump 2.600 0.000 0.1000->4.000 0.000 0.1000");
  REQUIRE(jump.size() == 1);
  CHECK(jump[0].t_from_us == sent(2));
  CHECK(jump[0].t_us == received(3));
  CHECK(summary(feed.json(4, at(9, 0, "m2"))) == "map md5 m1->m2");
  CHECK(summary(feed.json(10, at(90, 0, "m2"))) == "");  // in six seconds everything is possible
}

TEST_CASE("a heading that turns by more than it can is a jump, and an answer without speed tells nothing") {
  Feed feed;
  const std::string rest = ",\"vx\":0,\"vy\":0,\"w\":0.2}";
  CHECK(summary(feed.json(0, "{\"x\":0,\"y\":0,\"angle\":3.1" + rest)) == "");
  CHECK(summary(feed.json(0.5, "{\"x\":0,\"y\":0,\"angle\":-3.1" + rest)) == "");  // across the seam
  CHECK(summary(feed.json(1.0, R"({"x":50,"y":0,"angle":1})")) == "");
  CHECK(summary(feed.json(1.5, "{\"x\":0,\"y\":0,\"angle\":-0.5" + rest)) ==
        "pose_jump 0.000 0.000 -3.1000->0.000 0.000 -0.5000");
}

TEST_CASE("a push tells what status tells, and the ring tells nothing") {
  Feed feed;
  CHECK(summary(feed.json(0, R"({"blocked":false})", Source::push)) == "");
  CHECK(summary(feed.json(1, R"({"blocked":true,"errors":[{"52201":1}]})", Source::ring)) == "");
  CHECK(summary(feed.json(2, R"({"blocked":true})", Source::push)) == "blocked false->true");
}
