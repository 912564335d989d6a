// Configuration: what is accepted, what every mistake is answered with, and the way out and back in.

#include "recorder/config.hpp"

#include <unistd.h>

#include <fstream>

#include "tests/support/catch.hpp"
#include "tests/support/temp_dir.hpp"

using namespace tacho;
using namespace tacho::recorder;

namespace {

std::string error_of(const std::string& toml) {
  try {
    validate(parse_config(toml, "site.toml"));
  } catch (const UsageError& error) {
    return error.what();
  }
  return "";
}

std::string error_of(const Overrides& overrides) {
  try {
    Config config;
    apply(overrides, config);
    validate(config);
  } catch (const UsageError& error) {
    return error.what();
  }
  return "";
}

bool has(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

const std::string kRobot = "[[robot]]\nname = 'amr-1'\nhost = '192.168.192.5'\n";

Overrides with_robot() {
  Overrides o;
  o.robots = {"amr-1=192.168.192.5"};
  return o;
}

}  // namespace

TEST_CASE("a robot alone is recorded with the defaults") {
  const Config config = parse_config(kRobot, "site.toml");
  REQUIRE(config.robots.size() == 1);
  const RobotConfig& robot = config.robots[0];
  CHECK(robot.address() == "192.168.192.5:19204:502");
  CHECK(robot.settings.period(Source::status) == 1'000'000);
  CHECK(robot.settings.period(Source::io) == 0);
  CHECK(robot.settings.period(Source::registers) == 200'000);
  CHECK(robot.settings.period(Source::inputs) == 200'000);
  CHECK(robot.settings.modbus.unit == 1);
  CHECK_FALSE(robot.settings.modbus.word_order);
  CHECK(robot.settings.status.request.return_laser == false);
}

TEST_CASE("a robot's own tables win over the tables for all, wherever they stand in the file") {
  const Config config = parse_config(kRobot +
                                         "[robot.sources]\nio = '2Hz'\n[robot.modbus]\nunit = 7\nword_order = 'abcd'\n"
                                         "[[robot]]\nname = 'amr-2'\nhost = 'h'\nstatus_port = 1\nmodbus_port = 2\n"
                                         "[sources]\nstatus = '5s'\n[status]\nkeys = ['x', 'y']\nversion = 2\n"
                                         "language = 'en'\nreturn_beams3D = true\n",
                                     "site.toml");
  REQUIRE(config.robots.size() == 2);
  CHECK(config.robots[0].settings.period(Source::io) == 500'000);
  CHECK(config.robots[0].settings.period(Source::status) == 5'000'000);
  CHECK(config.robots[0].settings.modbus.unit == 7);
  CHECK(config.robots[0].settings.modbus.word_order == WordOrder::abcd);
  CHECK(config.robots[1].settings.modbus.unit == 1);
  CHECK(config.robots[1].address() == "h:1:2");
  CHECK(config.robots[1].settings.status.version == 2);
  CHECK(wire::status_request_body(config.robots[1].settings.status.request) ==
        R"({"keys":["x","y"],"return_laser":false,"return_beams3D":true,"language":"en"})");
}

TEST_CASE("what is written out is read back as the same configuration") {
  Overrides o = with_robot();
  o.robots.push_back("amr-2=[::1]:1234:5678");
  o.periods = "status=250ms,io=2Hz,inputs=off";
  o.word_order = "badc";
  o.log = "/var/lib/tachograph";
  o.commit = "5s";
  Config config;
  config.defaults.status.request.keys = {"x", "quote\"d"};
  config.defaults.status.request.language = "zh";
  config.defaults.status.request.return_mid360 = true;
  config.retention = {90 * 86'400'000'000, std::uint64_t{20} << 30, 0};
  apply(o, config);
  config.robots[1].settings.modbus.unit = 9;
  config.robots[1].settings.modbus.spacing_us = 0;
  const std::string text = to_toml(config);
  const Config again = parse_config(text, "again.toml");
  CHECK(to_toml(again) == text);
  CHECK(again.robots[1].host == "::1");
  CHECK(again.robots[1].settings.modbus.unit == 9);
  CHECK(again.robots[0].settings.period(Source::inputs) == 0);
  CHECK(again.robots[0].settings.status.request.keys[1] == "quote\"d");
  CHECK(again.part_bytes == config.part_bytes);
  CHECK(again.retention.age_us == 90 * 86'400'000'000);
  CHECK(again.retention.size_bytes == std::uint64_t{20} << 30);
  CHECK(again.retention.reserve_bytes == 0);
}

TEST_CASE("a mistake in the file is answered with its line and what was meant") {
  CHECK(has(error_of("[[robot]]\nname = 'a'\nhsot = 'b'\n"), "site.toml:3:1: unknown key 'hsot'"));
  CHECK(has(error_of("[[robot]]\nname = 'a'\nhsot = 'b'\n"), "did you mean 'host'"));
  CHECK(has(error_of("[modbus]\nunit = 1\n\nword_ordr = 'cdab'\n"),
            "site.toml:4:1: unknown key 'word_ordr' in [modbus]"));
  CHECK(has(error_of("[sources]\nstatus = 'often'\n"), "site.toml:2:10: [sources] status: 'often' is no period"));
  CHECK(has(error_of("[sources]\nstatus = 1\n"), "site.toml:2:10: [sources] status: a text was expected"));
  CHECK(has(error_of("[modbus]\nunit = 248\n"), "248 is no unit id"));
  CHECK(has(error_of("[modbus]\nword_order = 'acbd'\n"), "no word order 'acbd'"));
  CHECK(has(error_of("[status]\nversion = 256\n"), "does not fit into a byte"));
  CHECK(has(error_of("[status]\nkeys = 'x'\n"), "a list of texts was expected"));
  CHECK(has(error_of("[status]\nreturn_laser = 'no'\n"), "true or false was expected"));
  CHECK(has(error_of("[status]\ntimeout = '5h'\n"), "out of range"));
  CHECK(has(error_of("[robot]\nname = 'a'\n"), "write [[robot]] with two brackets"));
  CHECK(has(error_of("\n\n[[robot]]\nname = 'a'\n"), "site.toml:3:1: a robot without host"));
  CHECK(has(error_of("part_size = '1KB'\n"), "is no size"));
  CHECK(has(error_of("[retention]\naeg = '90d'\n"), "unknown key 'aeg' in [retention]; did you mean 'age'"));
  CHECK(has(error_of("[retention]\nage = '5min'\n"), "[retention] age: 5min is out of range"));
  CHECK(has(error_of("[retention]\nsize = 'much'\n"), "[retention] size: 'much' is no size"));
  CHECK(has(error_of("[retention]\nreserve = 1\n"), "[retention] reserve: a text was expected"));
  CHECK(has(error_of("log = 'x'\nlog = 'y'\n"), "site.toml:2:"));
  CHECK(has(error_of("robot = 3\n"), "site.toml:1:"));
}

TEST_CASE("tables that do not exist, and values that are no tables, are named with what was meant") {
  CHECK(has(error_of("[sorces]\nstatus = '1s'\n"), "site.toml:1:2: unknown table 'sorces'; did you mean 'sources'?"));
  CHECK(has(error_of("[[robto]]\nname = 'a'\n"), "unknown table 'robto'; did you mean 'robot'?"));
  CHECK(has(error_of("[[robot]]\nname='a'\nhost='b'\n[robot.modbsu]\nunit=1\n"),
            "site.toml:4:8: unknown table 'modbsu' in [[robot]]; did you mean 'modbus'?"));
  CHECK(has(error_of("sources = '1s'\n"), "site.toml:1:11: sources: a table was expected"));
  CHECK(has(error_of("modbus = [1]\n"), "site.toml:1:10: modbus: a table was expected"));
  CHECK(has(error_of("robot = [1, 2]\n"), "site.toml:1:10: a table was expected"));
}

TEST_CASE("what is no TOML at all is answered with the place where it stops being some") {
  CHECK(has(error_of("log = 'x\n"), "site.toml:1:"));
  CHECK(has(error_of("log = 'x'\n[modbus\nunit = 1\n"), "site.toml:2:"));
  CHECK(has(error_of("log = 'x'\n[modbus]\nunit = 1\n[modbus]\n"), "site.toml:4:"));
  CHECK(has(error_of("log = '\xff'\n"), "site.toml:1:"));
  CHECK(has(error_of(std::string("log = 'a\0b'\n", 12)), "site.toml:1:"));
  CHECK(has(error_of("[modbus]\nunit = 99999999999999999999\n"), "site.toml:2:"));
  CHECK(has(error_of("{\"log\": 1}"), "site.toml:1:"));
  CHECK(has(error_of(""), "robots: none given"));
  CHECK(has(error_of("# nothing but words\n"), "robots: none given"));
}

TEST_CASE("values out of range are refused with what is allowed") {
  CHECK(has(error_of("[[robot]]\nname='a'\nhost='b'\nstatus_port=0\n"), "0 is no port; give a number from 1 to 65535"));
  CHECK(has(error_of("[[robot]]\nname='a'\nhost='b'\nmodbus_port=65536\n"), "65536 is no port"));
  CHECK(has(error_of("[modbus]\nunit = -1\n"), "-1 is no unit id"));
  CHECK(has(error_of("commit = '1ms'\n"), "1ms is out of range; allowed is 50 ms to"));
  CHECK(has(error_of("[sources]\nstatus = '1ms'\n"), "from 10 ms to 24 h"));
  CHECK(has(error_of("metrics = 'everywhere'\n"), "'everywhere' is no port"));
  CHECK(has(error_of("metrics = 'a:1:2'\n"), "no place to listen at"));
}

TEST_CASE("metrics listen on loopback unless an address is given") {
  CHECK(parse_listen("9460", "m") == "127.0.0.1:9460");
  CHECK(parse_listen("0.0.0.0:9460", "m") == "0.0.0.0:9460");
  CHECK(parse_listen("[::1]:9460", "m") == "[::1]:9460");
  CHECK(parse_listen("off", "m").empty());
  CHECK(parse_config(kRobot, "site.toml").metrics.empty());
}

TEST_CASE("a file that cannot be read is named with the reason") {
  const tacho::test::TempDir dir;
  const auto refused = [](const std::filesystem::path& file) -> std::string {
    try {
      load_config(file, {});
    } catch (const UsageError& error) {
      return error.what();
    }
    return "";
  };
  CHECK(refused(dir / "none.toml") ==
        (dir / "none.toml").string() + ": No such file or directory; check the path given with --config");
  CHECK(has(refused(dir.path()), "is a folder"));
  std::ofstream(dir / "empty.toml").close();
  CHECK(has(refused(dir / "empty.toml"), "robots: none given"));
  std::ofstream(dir / "secret.toml") << kRobot;
  std::filesystem::permissions(dir / "secret.toml", std::filesystem::perms::none);
  if (geteuid() != 0) {  // root may read everything
    CHECK(has(refused(dir / "secret.toml"), "Permission denied"));
  }
}

TEST_CASE("the text for the log is the file as it is, or everything in force when a flag changes it") {
  const tacho::test::TempDir dir;
  std::ofstream(dir / "site.toml") << "# my robots\n" + kRobot;
  CHECK(load_config(dir / "site.toml", {}).text == "# my robots\n" + kRobot);
  Overrides flags;
  flags.commit = "5s";
  const LoadedConfig changed = load_config(dir / "site.toml", flags);
  CHECK(changed.text == to_toml(changed.config));
  CHECK(parse_config(changed.text, "again").commit_us == 5'000'000);
}

TEST_CASE("a gigabyte of the disk is kept free, and nothing else removes parts, unless the file says so") {
  const Config usual = parse_config(kRobot, "site.toml");
  CHECK(usual.retention.reserve_bytes == std::uint64_t{1} << 30);
  CHECK(usual.retention.age_us == 0);
  CHECK(usual.retention.size_bytes == 0);
  const Config config = parse_config("[retention]\nage='30d'\nsize='600MB'\nreserve='off'\n" + kRobot, "site.toml");
  CHECK(config.retention.age_us == 30 * 86'400'000'000);
  CHECK(config.retention.size_bytes == std::uint64_t{600} << 20);
  CHECK(config.retention.reserve_bytes == 0);
  CHECK_NOTHROW(validate(config));
}

TEST_CASE("timeout, the parameter that raises an alarm on the robot, cannot be asked for by name") {
  // [status] timeout is our own waiting time: it never reaches the request.
  const Config config = parse_config("[status]\ntimeout = '2s'\n" + kRobot, "site.toml");
  CHECK(wire::status_request_body(config.robots[0].settings.status.request).find("timeout") == std::string::npos);
}

TEST_CASE("settings that cannot work together are refused") {
  CHECK(has(error_of(std::string("log = 'x'\n")), "none given"));
  CHECK(has(error_of("[[robot]]\nname=\"a\\u001b[31m\"\nhost='b'\n"), "the name has control characters"));
  CHECK(has(error_of(kRobot + kRobot), "site.toml:4:1: robot amr-1 is given twice, first at site.toml:1:1"));
  Overrides twice = with_robot();
  twice.robots.push_back(twice.robots[0]);
  CHECK(has(error_of(twice), "robot amr-1: given twice"));
  CHECK(has(error_of("[sources]\nstatus='off'\nregisters='off'\ninputs='off'\n" + kRobot),
            "site.toml:5:1: robot amr-1: every source is off"));
  CHECK(has(error_of("[sources]\nstatus='100ms'\nio='10Hz'\n" + kRobot), "more often than the spacing"));
  CHECK(error_of("[sources]\nstatus='200ms'\nio='5Hz'\n" + kRobot).empty());
  CHECK(has(error_of("[retention]\nsize='300MB'\n" + kRobot), "less than two parts of 256.0 MB"));
  CHECK(has(error_of("[sources]\nstatus='off'\nregisters='off'\nring='5Hz'\n" + kRobot), "can set off the ring"));
  CHECK(error_of("[sources]\nstatus='off'\nring='5Hz'\n" + kRobot).empty());
}

TEST_CASE("flags take durations and rates, choose sources, and name their mistakes") {
  Overrides o = with_robot();
  o.periods = "status=2s, io=4Hz,registers=off";
  Config config;
  apply(o, config);
  CHECK(config.robots[0].settings.period(Source::status) == 2'000'000);
  CHECK(config.robots[0].settings.period(Source::io) == 250'000);
  CHECK(config.robots[0].settings.period(Source::registers) == 0);

  Overrides chosen = with_robot();
  chosen.sources = "io,inputs";
  Config some;
  apply(chosen, some);
  CHECK(some.robots[0].settings.period(Source::status) == 0);
  CHECK(some.robots[0].settings.period(Source::io) == 500'000);
  CHECK(some.robots[0].settings.period(Source::inputs) == 200'000);

  o.periods = "statsu=1s";
  CHECK(has(error_of(o), "did you mean 'status'"));
  o.periods = "status";
  CHECK(has(error_of(o), "is not SOURCE=PERIOD"));
  o.periods = "status=0Hz";
  CHECK(has(error_of(o), "is no period"));
  o.periods = "status=1000Hz";
  CHECK(has(error_of(o), "is no period"));
}

TEST_CASE("robots are given as NAME=HOST with optional ports") {
  const Settings settings;
  CHECK(parse_robot("a=10.0.0.1", settings).address() == "10.0.0.1:19204:502");
  CHECK(parse_robot("a=10.0.0.1:1", settings).address() == "10.0.0.1:1:502");
  CHECK(parse_robot("a=host:1:2", settings).address() == "host:1:2");
  CHECK(parse_robot("a=[fe80::1]:1:2", settings).address() == "[fe80::1]:1:2");
  CHECK(parse_robot("a=host:1:2:3", settings).push_port == 3);
  CHECK(parse_robot("a=host:1:2", settings).push_port == 19301);
  for (const char* bad : {"", "a", "=h", "a=", "a=h:0", "a=h:70000", "a=h:1:2:3:4", "a=h:x", "a=[::1"}) {
    INFO(bad);
    Overrides o;
    o.robots = {bad};
    CHECK(has(error_of(o), "--robot"));
  }
}

TEST_CASE("the sample configuration is valid and shows the defaults") {
  const Config config = read_config(std::filesystem::path(TACHO_SOURCE_DIR) / "samples/config/site.toml");
  CHECK_NOTHROW(validate(config));
  CHECK(config.robots.size() == 2);
  Config plain;
  plain.log = config.log;
  plain.robots = config.robots;
  CHECK(to_toml(plain) == to_toml(config));
}

TEST_CASE("a period may depend on what the robot is doing, in the file and as flags") {
  Config config = parse_config(kRobot +
                                   "[robot.sources]\nstatus = { moving = '200ms', idle = '1s', charging = '5s' }\n"
                                   "registers = { idle = '2s' }\ninputs = '1s'\n",
                               "site.toml");
  const Settings& settings = config.robots[0].settings;
  CHECK(settings.rates(Source::status).period_us == std::array<Micros, 3>{200'000, 1'000'000, 5'000'000});
  CHECK(settings.rates(Source::registers).period_us == std::array<Micros, 3>{200'000, 2'000'000, 2'000'000});
  CHECK_FALSE(settings.rates(Source::inputs).varies());
  CHECK(to_toml(parse_config(to_toml(config), "again")) == to_toml(config));
  Overrides o;
  o.periods = "status.charging=10s,registers=100ms";
  apply(o, config);
  CHECK(settings.rates(Source::status).period_us == std::array<Micros, 3>{200'000, 1'000'000, 10'000'000});
  CHECK_FALSE(settings.rates(Source::registers).varies());
  validate(config);

  const auto sources = [](const std::string& text) { return error_of(kRobot + "[robot.sources]\n" + text + "\n"); };
  CHECK(has(sources("status = { moving = '1s', idel = '2s' }"), "site.toml:5:27"));
  CHECK(has(sources("status = { moving = '1s', idel = '2s' }"), "did you mean 'idle'"));
  CHECK(has(sources("status = { idle = 'off' }"), "cannot be off for a part of the time"));
  CHECK(has(sources("inputs = { idle = '10s' }"), "at least one poll in 5 s"));
  o.periods = "status.parked=10s";
  CHECK(has(error_of(o), "a robot is never 'parked'"));
}

TEST_CASE("pose is off, asked up to 10 Hz, and up to 20 Hz only when that is said") {
  const auto with = [](const std::string& pose, const std::string& status) {
    return error_of(kRobot + "[robot.sources]\npose = '" + pose + "'\n[robot.status]\n" + status + "\n");
  };
  CHECK(parse_config(kRobot, "site.toml").robots[0].settings.period(Source::pose) == 0);
  CHECK(with("8Hz", "").empty());
  CHECK(has(with("10Hz", ""), "status and pose together ask more often than the spacing of 100 ms"));
  CHECK(with("10Hz", "spacing = '50ms'").empty());
  CHECK(has(with("20Hz", "spacing = '20ms'"), "set allow_fast = true in [status]"));
  CHECK(with("20Hz", "spacing = '20ms'\nallow_fast = true").empty());
  CHECK(has(with("25Hz", "spacing = '20ms'\nallow_fast = true"), "more often than 20 Hz"));
  Overrides o = with_robot();
  o.sources = "status,pose";
  Config config;
  apply(o, config);
  CHECK(config.robots[0].settings.period(Source::pose) == 200'000);
}

TEST_CASE("two robots at one address are refused, but not where only one of them asks there") {
  const auto robot = [](const std::string& name, std::uint16_t status, std::uint16_t modbus, int unit) {
    RobotConfig out;
    out.name = name;
    out.host = "10.0.0.5";
    out.status_port = status;
    out.modbus_port = modbus;
    out.settings.modbus.unit = unit;
    return out;
  };
  Config config;
  const auto refusal = [&]() -> std::string {
    try {
      validate(config);
      return "";
    } catch (const UsageError& error) {
      return error.what();
    }
  };
  config.robots = {robot("a", 19204, 502, 1), robot("b", 19205, 502, 2)};  // a gateway with two units
  CHECK(refusal().empty());
  config.robots[1].settings.modbus.unit = 1;
  CHECK(has(refusal(), "robot b"));
  CHECK(has(refusal(), "is asked at 10.0.0.5:502 unit 1, and so is robot a"));
  config.robots[1].settings.period_us[static_cast<std::size_t>(Source::registers)] = 0;
  config.robots[1].settings.period_us[static_cast<std::size_t>(Source::inputs)] = 0;
  CHECK(refusal().empty());
  config.robots[1].status_port = 19204;
  CHECK(has(refusal(), "is asked at 10.0.0.5:19204, and so is robot a"));
}
