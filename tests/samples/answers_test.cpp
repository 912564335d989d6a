// Answers of a simulated robot decode to its state, through the same decoders as a real robot's.

#include "samples/simulator/answers.hpp"

#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "samples/simulator/json_text.hpp"
#include "samples/simulator/robot_clock.hpp"
#include "schema/time.hpp"
#include "schema/wire/registers.hpp"
#include "schema/wire/status_json.hpp"
#include "tests/support/catch.hpp"

namespace sim = tacho::sim;
namespace wire = tacho::wire;
using namespace std::string_literals;
using sim::RobotState;
using sim::Scenario;
using tacho::field;
using tacho::FieldIndex;
using tacho::FieldSet;
using tacho::Micros;
using tacho::Sample;

namespace {

constexpr Micros kStart = 1'767'225'600'000'000;
constexpr Micros kSecond = 1'000'000;

Scenario exact(std::uint64_t seed) {
  Scenario s = sim::busy_day(seed);
  s.pose_sigma_m = 0;
  s.heading_sigma_rad = 0;
  s.current_noise_a = 0;
  return s;
}

std::string register_image(const std::array<std::uint16_t, 140>& words) {
  std::string image;
  wire::append_words(image, {1, 100}, std::span(words).subspan(0, 100));
  wire::append_words(image, {101, 40}, std::span(words).subspan(100, 40));
  return image;
}

void check_near(const Sample& sample, FieldIndex f, double value, double tolerance) {
  INFO(tacho::field_at(f).name);
  REQUIRE(sample.at(f).has());
  CHECK(sample.at(f).real == Approx(value).margin(tolerance));
}

void check_state(const Sample& sample, const Scenario& s, const RobotState& state) {
  check_near(sample, field("x"), state.x_m, 5.1e-5);
  check_near(sample, field("y"), state.y_m, 5.1e-5);
  check_near(sample, field("odo"), s.odo_start_m + s.odo_scale * state.wheel_path_m, 5.1e-4);
  check_near(sample, field("today_odo"), s.odo_scale * state.today_wheel_path_m, 5.1e-4);
  check_near(sample, field("vx"), state.wheel_mps * s.twist_scale, 7e-4);
  check_near(sample, field("w"), state.w_radps * s.angular_scale, 7e-4);
  check_near(sample, field("battery_level"), state.soc, 5.1e-5);
  check_near(sample, field("current"), state.current_a, 0.0051);
  check_near(sample, field("voltage"), state.voltage_v, 0.07);
  check_near(sample, field("battery_temp"), state.battery_temp_c, 0.051);
  check_near(sample, field("uptime"), state.uptime_s, 5.1e-4);
  CHECK(sample.at(field("is_stop")).integer == (state.is_stop ? 1 : 0));
  CHECK(sample.at(field("blocked")).integer == (state.blocked ? 1 : 0));
  CHECK(sample.at(field("charging")).integer == (state.charging ? 1 : 0));
  CHECK(sample.at(field("task_status")).integer == state.task_status);
  CHECK(sample.text(field("current_station")) == state.current_station);
  CHECK(sample.at(field("block_reason")).has() == state.blocked);
}

}  // namespace

TEST_CASE("a status answer decodes to the state it was made from") {
  Scenario s = exact(3);
  s.twist_scale = 1.02;
  s.odo_scale = 0.97;
  sim::Robot robot(s, kStart);
  sim::AnswerMaker answers(s);
  wire::JsonDecoder decoder;
  Sample sample;
  int blocked = 0;
  int alarms = 0;
  for (int i = 0; i < 1500; ++i) {
    const RobotState& state = robot.at(kStart + i * 17 * kSecond + i * 1234);
    decoder.decode(answers.status(state), FieldSet().set(), true, sample);
    REQUIRE(sample.decodable);
    REQUIRE(sample.unknown_keys.empty());
    check_state(sample, s, state);
    REQUIRE(sample.alarms.size() == state.alarms.size());
    REQUIRE(sample.points.size() == 43);
    for (const auto& item : sample.alarms) {
      const auto same = std::find_if(state.alarms.begin(), state.alarms.end(),
                                     [&](const auto& a) { return a.level == item.level && a.code == item.code; });
      REQUIRE(same != state.alarms.end());
      CHECK(item.stamp_s == same->stamp_s);
      CHECK(item.times == same->times);
      CHECK(sample.texts.at(item.desc) == same->desc);
    }
    blocked += state.blocked ? 1 : 0;
    alarms += static_cast<int>(state.alarms.size());
  }
  CHECK(blocked > 10);
  CHECK(alarms > 10);
}

TEST_CASE("all alarm shapes carry the same alarms once") {
  for (int shape = 0; shape <= 3; ++shape) {
    Scenario s = exact(3);
    s.alarm_shape = shape;
    sim::AnswerMaker answers(s);
    RobotState state;
    state.t_us = kStart;
    state.alarms = {{tacho::AlarmLevel::error, 52200, 1'767'225'000, 3, "line one\nline \"two\""},
                    {tacho::AlarmLevel::error, 52111, 1'767'225'500, 1, ""},
                    {tacho::AlarmLevel::notice, 57002, 1'767'225'501, 1, "notice"}};
    wire::JsonDecoder decoder;
    Sample sample;
    decoder.decode(answers.status(state), FieldSet().set(), true, sample);
    INFO("shape " << shape);
    CHECK(sample.unknown_keys.empty());
    REQUIRE(sample.alarms.size() == 3);
    for (const auto& item : sample.alarms) {
      if (item.code == 52200) {
        CHECK(item.stamp_s == 1'767'225'000);
        CHECK(item.times == (shape == 0 ? 0 : 3));
        CHECK(sample.texts.at(item.desc) == (shape == 0 ? "" : "line one\nline \"two\""));
      }
    }
    const auto json = nlohmann::json::parse(answers.status(state));
    CHECK(json.contains("alarms") == (shape == 3));
    CHECK(json.contains("errors_solution") == (shape == 1));
    CHECK(json["errors"].size() == 2);
  }
}

TEST_CASE("an answer has the 197 keys of a real one, reasons only while blocked") {
  const Scenario s = exact(1);
  sim::AnswerMaker answers(s);
  RobotState state;
  state.t_us = kStart;
  auto json = nlohmann::json::parse(answers.status(state, {}, true));
  CHECK(json.size() == 197);
  CHECK(json["lasers"].size() == 2);
  CHECK(!json.contains("block_reason"));
  CHECK(json["transparent_data"].is_null());
  json = nlohmann::json::parse(answers.status(state));
  CHECK(json.size() == 196);
  state.blocked = true;
  state.block_reason = 6;
  state.slowed = true;
  json = nlohmann::json::parse(answers.status(state));
  CHECK(json["block_reason"] == 6);
  CHECK(json.contains("slow_x"));
}

TEST_CASE("keys asked for are the keys given") {
  sim::AnswerMaker answers(exact(1));
  RobotState state;
  state.t_us = kStart;
  const std::vector<std::string> keys{"x", "DI", "no_such_key"};
  const auto json = nlohmann::json::parse(answers.status(state, keys));
  CHECK(json.size() == 4);
  CHECK(json["DI"].size() == 25);
  CHECK(json.contains("create_on"));
  CHECK(json["ret_code"] == 0);
}

TEST_CASE("without battery fields there are none, and their registers are zero") {
  Scenario s = exact(1);
  s.battery_fields = false;
  sim::AnswerMaker answers(s);
  sim::Robot robot(s, kStart);
  const RobotState& state = robot.at(kStart + 100 * kSecond);
  const auto json = nlohmann::json::parse(answers.status(state));
  for (const char* key : {"battery_level", "battery_temp", "battery_cycle", "voltage", "current"}) {
    CHECK(!json.contains(key));
  }
  const auto words = answers.registers(state);
  CHECK(words[12] == 0);
  CHECK(words[16] == 0);
  CHECK(words[17] == 0x8000);  // -0.0, low word first
}

TEST_CASE("registers in every word order decode to the state") {
  for (const auto order :
       {tacho::WordOrder::cdab, tacho::WordOrder::abcd, tacho::WordOrder::badc, tacho::WordOrder::dcba}) {
    Scenario s = exact(5);
    s.word_order = order;
    s.registers_rounded = false;
    sim::Robot robot(s, kStart);
    sim::AnswerMaker answers(s);
    for (int i = 1; i < 60; ++i) {
      const RobotState& state = robot.at(kStart + i * 97 * kSecond);
      Sample sample;
      sample.clear();
      tacho::Gates gates;
      gates.known.set(field("blocked"));
      gates.on.set(field("blocked"), state.blocked);
      wire::decode_registers(register_image(answers.registers(state)), order, gates, FieldSet().set(), sample);
      REQUIRE(sample.decodable);
      check_near(sample, field("x"), state.x_m, 1e-5);
      check_near(sample, field("odo"), s.odo_start_m + state.wheel_path_m, 0.002);
      check_near(sample, field("current"), state.current_a, 1e-5);
      check_near(sample, field("battery_level"), state.soc, 0.00501);
      check_near(sample, field("total_time"), 449'741.604 + state.uptime_s, 0.1);
      CHECK(sample.at(field("task_status")).integer == state.task_status);
      CHECK(sample.at(field("rfid")).integer == -1);
      CHECK(sample.at(field("block_reason")).has() == state.blocked);
    }
  }
}

TEST_CASE("a float register holds the number that the status answer prints, but for the confidence") {
  const Scenario s = sim::busy_day(5);
  sim::Robot robot(s, kStart);
  sim::AnswerMaker answers(s);
  wire::JsonDecoder decoder;
  for (int i = 1; i < 60; ++i) {
    const RobotState& state = robot.at(kStart + i * 97 * kSecond);
    tacho::Gates gates;
    Sample image;
    image.clear();
    wire::decode_registers(register_image(answers.registers(state)), s.word_order, gates, FieldSet().set(), image);
    Sample status;
    decoder.decode(answers.status(state), FieldSet().set(), true, status);
    for (const FieldIndex f : {field("x"), field("y"), field("angle"), field("vx"), field("w"), field("voltage"),
                               field("current"), field("controller_temp"), field("odo")}) {
      INFO(tacho::field_at(f).name);
      CHECK(static_cast<float>(image.at(f).real) == static_cast<float>(status.at(f).real));
    }
    const double confidence = image.at(field("confidence")).real;
    CHECK(status.at(field("confidence")).real == Approx(confidence).margin(5.1e-5));
    CHECK(static_cast<float>(confidence) != static_cast<float>(status.at(field("confidence")).real));
  }
}

TEST_CASE("register 44 reads 1 while nothing is blocked, gaps read 0") {
  const Scenario s = exact(5);
  sim::AnswerMaker answers(s);
  RobotState state;
  state.t_us = kStart;
  auto words = answers.registers(state);
  CHECK(words[43] == 1);
  CHECK(words[13] == 0);
  CHECK(words[100] == 0);
  state.blocked = true;
  state.block_reason = 0;
  CHECK(answers.registers(state)[43] == 0);
}

TEST_CASE("discrete inputs follow the state") {
  sim::AnswerMaker answers(exact(5));
  RobotState state;
  state.t_us = kStart;
  state.blocked = true;
  state.charging = true;
  state.alarms = {{tacho::AlarmLevel::error, 52200, 0, 1, ""}};
  const auto bits = answers.inputs(state);
  CHECK(bits[2 - 1] == 1);
  CHECK(bits[3 - 1] == 1);
  CHECK(bits[4 - 1] == 0);
  CHECK(bits[9 - 1] == 1);
  CHECK(bits[10 - 1] == 0);
  CHECK(bits[19 - 1] == 1);
  CHECK(bits[29 - 1] == 1);  // DI 9 is the charging contact
}

TEST_CASE("the robot's clock shows zone UTC-11 and its own error") {
  Scenario s = exact(1);
  s.clock_offset_s = 90.25;
  sim::AnswerMaker answers(s);
  RobotState state;
  state.t_us = kStart;
  const auto json = nlohmann::json::parse(answers.io(state));
  CHECK(json["create_on"] == "2025-12-31T13:01:30.250-1100");
  CHECK(tacho::parse_time(json["create_on"].get<std::string>(), "UTC") == kStart + 90'250'000);
  const auto words = answers.registers(state);
  CHECK(words[125] == 2025);
  CHECK(words[129] == 1);
  CHECK(words[130] == 30);
}

TEST_CASE("the same seed gives the same bytes, another seed others") {
  const auto body = [](std::uint64_t seed) {
    Scenario s = sim::busy_day(seed);
    s.name = "robot";
    sim::Robot robot(s, kStart);
    sim::AnswerMaker answers(s);
    return answers.status(robot.at(kStart + 5000 * kSecond));
  };
  CHECK(body(1) == body(1));
  CHECK(body(1) != body(2));
}

TEST_CASE("a standing robot still shows noise of 1e-4 m/s and now and then -0.0") {
  Scenario s;
  s.always_idle = true;
  sim::Robot robot(s, kStart);
  sim::AnswerMaker answers(s);
  int negative_zero = 0;
  double sum = 0;
  for (int i = 0; i < 1000; ++i) {
    const std::string body = answers.status(robot.at(kStart + i * kSecond));
    negative_zero += body.find("\"vx\":-0.0,") != std::string::npos ? 1 : 0;
    const double vx = nlohmann::json::parse(body)["vx"];
    sum += vx * vx;
  }
  CHECK(negative_zero > 50);
  CHECK(std::sqrt(sum / 1000) == Approx(1.04e-4).epsilon(0.15));
}

TEST_CASE("numbers are printed as robots print them") {
  const auto rounded = [](double value, int decimals) {
    std::string out;
    sim::append_rounded(out, value, decimals);
    return out;
  };
  CHECK(rounded(15.0, 1) == "15");
  CHECK(rounded(0.82, 4) == "0.82");
  CHECK(rounded(-0.05, 4) == "-0.05");
  CHECK(rounded(-1e-5, 4) == "-0.0");
  CHECK(rounded(1e-5, 4) == "0");
  CHECK(rounded(21773.948, 3) == "21773.948");
  CHECK(rounded(-12.3456, 2) == "-12.35");
  std::string out;
  sim::append_shortest(out, 2.775760269175899e-05);
  CHECK(out == "2.775760269175899e-05");
  out.clear();
  sim::append_escaped(out, "a\"b\\c\nd\x01");
  CHECK(out == "a\\\"b\\\\c\\nd\\u0001");
}
