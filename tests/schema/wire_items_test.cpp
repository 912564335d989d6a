// Alarms in their four shapes and digital points in their two.

#include "schema/wire/status_json.hpp"
#include "tests/support/catch.hpp"

using namespace tacho;

namespace {

Sample decode(std::string_view body) {
  wire::JsonDecoder decoder;
  Sample sample;
  decoder.decode(body, FieldSet().set(), true, sample);
  REQUIRE(sample.decodable);
  return sample;
}

AlarmItem only_alarm(const Sample& sample) {
  REQUIRE(sample.alarms.size() == 1);
  return sample.alarms.front();
}

State alarm_state(std::string_view body) { return decode(body).at(field("errors")).state; }
State point_state(std::string_view body) { return decode(body).at(field("di")).state; }

}  // namespace

TEST_CASE("an alarm of the oldest shape is a code and its stamp", "[wire]") {
  const Sample s = decode(R"({"errors":[{"52201":1497698402}]})");
  const AlarmItem alarm = only_alarm(s);
  CHECK(alarm.level == AlarmLevel::error);
  CHECK(alarm.code == 52201);
  CHECK(alarm.stamp_s == 1497698402);
  CHECK(alarm.times == 0);
  CHECK(alarm.desc == 0);
}

TEST_CASE("an alarm of the documented shape has words and a repetition count", "[wire]") {
  const Sample s = decode(R"({"warnings":[{"54003":1497698405,"desc":"two\nlines","times":3}]})");
  const AlarmItem alarm = only_alarm(s);
  CHECK(alarm.level == AlarmLevel::warning);
  CHECK(s.texts.at(alarm.desc) == "two\nlines");
  CHECK(alarm.times == 3);
  CHECK(s.unknown_keys.empty());
}

TEST_CASE("an alarm of the newest shape brings its own solution", "[wire]") {
  for (const char* const time_key : {"dateTime", "dataTime"}) {
    const Sample s = decode(std::string(R"({"notices":[{"54018":1700000000,"code":54018,")") + time_key +
                            R"(":"2023-11-14","desc":"d","describe":"what","method":"how","reason":"why","times":2,
                            "timestamp":1700000001}]})");
    const AlarmItem alarm = only_alarm(s);
    CHECK(alarm.code == 54018);
    CHECK(alarm.stamp_s == 1700000000);
    CHECK(s.texts.at(alarm.solution) == "what\nhow\nwhy");
    CHECK(s.unknown_keys.empty());
  }
}

TEST_CASE("an alarm without a digit key uses code and timestamp", "[wire]") {
  const AlarmItem alarm = only_alarm(decode(R"({"fatals":[{"timestamp":1700000000,"code":"50000","desc":"d"}]})"));
  CHECK(alarm.level == AlarmLevel::fatal);
  CHECK(alarm.code == 50000);
  CHECK(alarm.stamp_s == 1700000000);
}

TEST_CASE("the nested copy of a fleet report is the same alarm, counted once", "[wire]") {
  const std::string nested = R"("alarms":{"errors":[{"code":52201,"times":1,"timestamp":5,"own":1}],"fatals":[]})";
  CHECK(decode("{" + nested + R"(,"errors":[{"52201":5}]})").alarms.size() == 1);
  CHECK(decode(R"({"errors":[{"52201":5}],)" + nested + "}").alarms.size() == 1);
  const Sample only_nested = decode("{" + nested + "}");
  CHECK(only_alarm(only_nested).code == 52201);
  CHECK(only_nested.at(field("errors")).integer == 1);
  CHECK(only_nested.at(field("fatals")).has());
  CHECK(only_nested.at(field("warnings")).state == State::absent);
  CHECK(only_nested.unknown_keys.empty());  // inside a structured key
}

TEST_CASE("an empty array, a missing one and an unreadable one are three different things", "[wire]") {
  CHECK(alarm_state(R"({"errors":[]})") == State::present);
  CHECK(alarm_state(R"({})") == State::absent);
  CHECK(alarm_state(R"({"errors":null})") == State::null);
  CHECK(alarm_state(R"({"errors":{}})") == State::wrong_type);
  CHECK(alarm_state(R"({"errors":[{"desc":"no code"}]})") == State::wrong_type);
  CHECK(alarm_state(R"({"errors":[17]})") == State::wrong_type);
  CHECK(alarm_state(R"({"errors":[{"99999999999999999999":1}]})") == State::wrong_type);
}

TEST_CASE("an unreadable array hides its own alarms only", "[wire]") {
  const Sample s = decode(R"({"warnings":[{"54001":1}],"errors":[{"desc":"no code"}],"notices":[{"56000":1}]})");
  REQUIRE(s.alarms.size() == 2);
  CHECK(s.alarms[0].code == 54001);
  CHECK(s.alarms[1].code == 56000);
  CHECK(s.at(field("errors")).state == State::wrong_type);
  CHECK(s.alarms_incomplete.none());
  CHECK(s.unknown_keys == std::vector<std::string>{"errors[]"});
}

TEST_CASE("an odd element leaves the other alarms of its array standing, marked as not all", "[wire]") {
  for (const char* const odd : {"17", "null", "\"text\"", "[]", "{}", R"({"desc":"no code"})", R"({"code":"x"})"}) {
    INFO(odd);
    const Sample s = decode(R"({"warnings":[],"errors":[{"52201":1},)" + std::string(odd) + R"(,{"52202":2}]})");
    REQUIRE(s.alarms.size() == 2);
    CHECK(s.alarms[0].code == 52201);
    CHECK(s.alarms[1].code == 52202);
    CHECK(s.at(field("errors")).has());
    CHECK(s.at(field("errors")).integer == 2);
    CHECK(s.alarms_incomplete == LevelSet().set(static_cast<std::size_t>(AlarmLevel::error)));
    CHECK(s.unknown_keys == std::vector<std::string>{"errors[]"});
  }
  CHECK(decode(R"({"errors":[{"52201":1}]})").alarms_incomplete.none());
}

TEST_CASE("an odd element of the nested copy is told with its place", "[wire]") {
  const Sample s = decode(R"({"alarms":{"errors":[{"code":52201},{"own":1}]}})");
  CHECK(only_alarm(s).code == 52201);
  CHECK(s.alarms_incomplete.count() == 1);
  CHECK(s.unknown_keys == std::vector<std::string>{"alarms.errors[]"});
}

TEST_CASE("solution texts are attached to the alarm of their level and code", "[wire]") {
  const Sample s = decode(R"({"errors_solution":[{"52201":{"describe":"what","method":"how","reason":"why"}},
      {"code":52202,"method":"only how"}],"errors":[{"52201":1},{"52202":1},{"52203":1},
      {"code":52201,"describe":"own words"}],"warnings":[{"52201":1}]})");
  REQUIRE(s.alarms.size() == 5);
  CHECK(s.texts.at(s.alarms[0].solution) == "what\nhow\nwhy");
  CHECK(s.texts.at(s.alarms[1].solution) == "only how");
  CHECK(s.alarms[2].solution == 0);
  CHECK(s.texts.at(s.alarms[3].solution) == "own words");
  CHECK(s.alarms[4].solution == 0);
  CHECK(s.at(field("errors_solution")).has());
}

TEST_CASE("asking for one level decodes the lists whole", "[wire]") {
  wire::JsonDecoder decoder;
  Sample s;
  decoder.decode(R"({"errors":[{"1":1}],"fatals":[{"2":1}],"errors_solution":[{"1":{"method":"how"}}],"DI":[true]})",
                 FieldSet().set(field("fatals")), false, s);
  CHECK(s.alarms.size() == 2);
  CHECK(s.alarms[0].code == 2);
  CHECK(s.texts.at(s.alarms[1].solution) == "how");
  CHECK(s.at(field("errors_solution")).state == State::absent);
  CHECK(s.points.empty());
}

TEST_CASE("points keep the ids the robot gives", "[wire]") {
  const Sample s = decode(R"({"DO":[{"id":7,"source":"reserve","status":true}],
      "DI":[{"id":3,"source":"normal","status":false,"valid":true},{"id":40,"status":1,"valid":null}]})");
  REQUIRE(s.points.size() == 3);  // DI then DO, whatever the order of the answer
  CHECK(s.points[0].id == 3);
  CHECK(s.points[0].valid == 1);
  CHECK(s.points[1].id == 40);
  CHECK(s.points[1].status);
  CHECK(s.points[1].valid == -1);
  CHECK(s.points[2].output);
  CHECK(s.texts.at(s.points[2].source) == "reserve");
}

TEST_CASE("points of old firmware are booleans, their id is their place", "[wire]") {
  const Sample s = decode(R"({"DI":[true,false,true]})");
  REQUIRE(s.points.size() == 3);
  CHECK(s.points[2].id == 2);
  CHECK(s.points[2].status);
  CHECK_FALSE(s.points[1].status);
  CHECK(s.points[0].valid == -1);
}

TEST_CASE("an array of points without id or level is unreadable", "[wire]") {
  CHECK(point_state(R"({"DI":[]})") == State::present);
  CHECK(point_state(R"({"DI":[{"status":true}]})") == State::wrong_type);
  CHECK(point_state(R"({"DI":[{"id":1}]})") == State::wrong_type);
  CHECK(point_state(R"({"DI":[{"id":4294967296,"status":true}]})") == State::wrong_type);
  CHECK(point_state(R"({"DI":["high"]})") == State::wrong_type);
  CHECK(point_state(R"({"DI":null})") == State::null);
}

TEST_CASE("an odd point leaves the others, with their own ids", "[wire]") {
  const Sample s = decode(R"({"DI":[{"id":1,"status":true},{"id":2},{"id":3,"status":true}],"DO":[true,"odd",true]})");
  REQUIRE(s.points.size() == 4);
  CHECK(s.points[1].id == 3);
  CHECK(s.points[3].id == 2);  // its place, though the one before could not be read
  CHECK(s.at(field("di")).has());
  CHECK(s.at(field("di")).integer == 2);
  CHECK(s.unknown_keys == std::vector<std::string>{"DI[]", "DO[]"});
}
