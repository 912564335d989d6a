#include "analyzer/settings.hpp"

#include <set>

#include "schema/error.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/golden.hpp"
#include "tests/support/temp_dir.hpp"

using namespace tacho;
using test::TempDir;

namespace {

/// The message that loading this text gives.
std::string refusal(const std::string& text) {
  TempDir dir;
  std::ofstream(dir / "config.toml") << text;
  try {
    Settings::load(dir / "config.toml");
  } catch (const Error& error) {
    return error.what();
  }
  return "accepted";
}

Settings load(const std::string& text) {
  TempDir dir;
  std::ofstream(dir / "config.toml") << text;
  return Settings::load(dir / "config.toml");
}

/// The first setting that has a default: tests hold for whatever table the analyses bring.
const SettingRow& some_row() {
  for (const SettingRow& row : setting_rows()) {
    if (row.fallback) {
      return row;
    }
  }
  throw std::runtime_error("no setting has a default");
}

std::string table_of(const SettingRow& row) { return std::string(row.name.substr(0, row.name.find('.'))); }
std::string key_of(const SettingRow& row) { return std::string(row.name.substr(row.name.find('.') + 1)); }

}  // namespace

TEST_CASE("every setting has a table, a key, a meaning, and a name of its own") {
  std::set<std::string_view> names;
  for (const SettingRow& row : setting_rows()) {
    INFO(row.name);
    CHECK(row.name.find('.') != std::string_view::npos);
    CHECK_FALSE(row.meaning.empty());
    CHECK(names.insert(row.name).second);
  }
  CHECK(names.size() >= 4);
}

TEST_CASE("a setting that is not configured has its default and says so") {
  const Settings settings;
  for (const SettingRow& row : setting_rows()) {
    INFO(row.name);
    CHECK(settings.get(row.name).value == row.fallback);
    CHECK(settings.get(row.name).source == (row.fallback ? "default" : "not configured"));
  }
}

TEST_CASE("a configured value comes with its file and line") {
  const SettingRow& row = some_row();
  const Settings settings = load("# facts\n\n[" + table_of(row) + "]\n" + key_of(row) + " = 7\n");
  CHECK(settings.number(row.name) == 7.0);
  CHECK(settings.get(row.name).source == "config.toml:4");
}

TEST_CASE("a value of one robot wins over the general one, for that robot only") {
  const SettingRow& row = some_row();
  const Settings settings = load("[" + table_of(row) + "]\n" + key_of(row) + " = 7.5\n[robot.\"amb 01/a\"." +
                                 table_of(row) + "]\n" + key_of(row) + " = 8.5\n");
  CHECK(settings.number(row.name) == 7.5);
  CHECK(settings.number(row.name, "amb 01/a") == 8.5);
  CHECK(settings.number(row.name, "amb 02") == 7.5);
  CHECK(settings.get(row.name, "amb 01/a").source == "config.toml:4");
  CHECK(settings.robots() == std::vector<std::string>{"amb 01/a"});
}

TEST_CASE("an unknown key is refused with its place and the nearest name") {
  const SettingRow& row = some_row();
  const std::string misspelt = key_of(row) + "x";
  const std::string message = refusal("[" + table_of(row) + "]\n" + misspelt + " = 1\n");
  INFO(message);
  CHECK(message.find("config.toml:2") != std::string::npos);
  CHECK(message.find("did you mean '" + std::string(row.name) + "'") != std::string::npos);
  CHECK(refusal("nonsense = 3\n").find("config.toml:1") != std::string::npos);
  CHECK(refusal("[zzzzzzzzzz]\nqqqqqqqqqqqq = 3\n").find("no such setting") != std::string::npos);
  CHECK(refusal("[battery]\nnominal_capacity = 3\n") ==
        "config.toml:2: battery.nominal_capacity: no such setting; did you mean 'battery.nominal_capacity_ah'? "
        "`tacho-analyzer settings` lists them");
}

TEST_CASE("what is no finite number, no table or no TOML is refused with its place") {
  const SettingRow& row = some_row();
  const std::string head = "[" + table_of(row) + "]\n" + key_of(row) + " = ";
  for (const char* value : {"\"fast\"", "true", "[1]", "nan", "inf"}) {
    INFO(value);
    CHECK(refusal(head + value + "\n").find("config.toml:2: " + std::string(row.name) + ": not a number") !=
          std::string::npos);
  }
  CHECK(refusal("robot = 3\n").find("config.toml:1") != std::string::npos);
  CHECK(refusal("[robot]\nx = 3\n").find("config.toml:2") != std::string::npos);
  CHECK(refusal("a = \n").find("config.toml:1") != std::string::npos);
  CHECK_THROWS_AS(Settings::load("/nonexistent/config.toml"), Error);
}

TEST_CASE("a value that cannot be true is refused with its place, its unit and what is allowed") {
  CHECK(refusal("[battery]\nnominal_capacity_ah = -4\n") ==
        "config.toml:2: battery.nominal_capacity_ah: -4 Ah: allowed is above 0");
  CHECK(refusal("[battery]\nlow_soc = 20\n") == "config.toml:2: battery.low_soc: 20: allowed is 0 to 1");
  CHECK(refusal("[robot.a.alarms]\ngap_periods = 0.5\n") ==
        "config.toml:2: alarms.gap_periods: 0.5: allowed is 1 or more");
  CHECK(refusal("[battery]\ntemp_min_c = -20\n") == "accepted");
}

TEST_CASE("every default is inside the range of its setting") {
  for (const SettingRow& row : setting_rows()) {
    INFO(row.name << " " << row.allowed.text());
    CHECK((!row.fallback || row.allowed.holds(*row.fallback)));
  }
}

TEST_CASE("a value set by hand says where it came from") {
  const SettingRow& row = some_row();
  Settings settings;
  settings.set(row.name, 3.0, "command line");
  CHECK(settings.number(row.name, "any robot") == 3.0);
  CHECK(settings.get(row.name).source == "command line");
}

TEST_CASE("the places that several settings came from are named once each") {
  Settings settings;
  settings.set("odometry.jump_m", 0.2, "site.toml:12");
  settings.set("odometry.jump_rad", 0.1, "site.toml:1");
  CHECK(settings.sources({"odometry.jump_m", "odometry.jump_rad", "odometry.jump_min_km", "odometry.jump_sigmas"}) ==
        "site.toml:12, site.toml:1, default");
}

TEST_CASE("the configurations that we show are accepted") {
  const std::filesystem::path house = TACHO_SOURCE_DIR;
  const Settings sample = Settings::load(house / "samples/config/site-facts.toml");
  CHECK(*sample.get("battery.nominal_capacity_ah").value == 40.0);
  CHECK(*sample.get("battery.nominal_capacity_ah", "forklift-2").value == 210.0);

  const std::string readme = test::read_file(house / "analyzer/README.md");
  const std::size_t from = readme.find("```toml\n") + 8;
  const Settings shown = load(readme.substr(from, readme.find("```", from) - from));
  CHECK(*shown.get("battery.nominal_capacity_ah", "amb-01").value == 60.0);
}
