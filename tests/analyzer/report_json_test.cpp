#include "analyzer/report/json.hpp"

#include <nlohmann/json.hpp>

#include "tests/analyzer/example_section.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/golden.hpp"

using namespace tacho;
using namespace tacho::test;
using Json = nlohmann::json;

namespace {

report::Origin origin() {
  report::Origin out;
  out.tool = "tacho-analyzer test";
  out.zone = "Europe/Berlin";
  out.window.from_us = kExampleTime;
  out.robots = {"amb-01", "amb-02"};
  out.settings = {{"odometry.v_max_mps", quantity(2.0, "m/s"), "default"},
                  {"battery.nominal_capacity_ah", unknown("not configured"), "not configured"}};
  return out;
}

std::string text() {
  const Section section = example_section();
  return report::json_text({&section, 1}, origin());
}

}  // namespace

TEST_CASE("a section as JSON reads as documented") { check_golden("tests/golden/report-example.json", text()); }

TEST_CASE("every number carries value, unit, lo, hi, n and exposure, and a missing one its reason") {
  const Json document = Json::parse(text());
  CHECK(document["format"] == "tachograph-report");
  CHECK(document["version"] == 1);
  CHECK(document["to"].is_null());
  const Json& section = document["sections"][0];
  const Json& rate = section["tables"][0]["rows"][0]["rate"];
  for (const char* key : {"value", "unit", "lo", "hi", "n", "exposure"}) {
    INFO(key);
    CHECK(rate.contains(key));
    CHECK(section["tables"][0]["rows"][0]["duration_s"].contains(key));
    CHECK(section["tables"][0]["rows"][0]["polls"].contains(key));
  }
  CHECK(rate["value"] == 1.5);
  CHECK(rate["lo"] == 1.25);
  CHECK(rate["hi"] == 1.75);
  CHECK(rate["n"] == 42);
  CHECK(rate["exposure"] == 12.5);
  CHECK(rate["unit"] == "1/h");
  const Json& second = section["tables"][0]["rows"][1];
  CHECK(second["duration_s"]["value"].is_null());
  CHECK(second["duration_s"]["reason"] == "not a finite number");
  CHECK(second["rate"]["value"].is_null());
  CHECK(second["rate"]["reason"] == "no exposure");
  CHECK(section["tables"][0]["rows"][2]["loaded"]["reason"] == "never told");
}

TEST_CASE("JSON gives back what the section held: text, counts beyond 2^53, curves and maps with their gaps") {
  const Json document = Json::parse(text());
  const Json& section = document["sections"][0];
  const Section original = example_section();
  const Json& rows = section["tables"][0]["rows"];
  CHECK(rows[0]["polls"]["value"].get<std::int64_t>() == 9'007'199'254'740'993);
  CHECK(rows[1]["robot"].get<std::string>() == "halle, \"süd\"\n二");
  CHECK(rows[0]["start"]["t_unix_us"].get<Micros>() == kExampleTime);
  CHECK(section["series"][0]["value"][0].get<double>() == 52.347);
  CHECK(section["series"][0]["value"][1].is_null());
  const Json& layer = section["grids"][0]["layers"][0]["value"];
  for (std::size_t i = 0; i < layer.size(); ++i) {
    const double value = original.grids[0].layers[0].value[i];
    CHECK((std::isnan(value) ? layer[i].is_null() : layer[i].get<double>() == value));
  }
  CHECK(section["findings"][2]["verdict"] == "FAIL");
  CHECK(section["findings"][2]["evidence"][0]["note"] == "+3 % over one minute");
}

TEST_CASE("text that is not UTF-8 does not break the document") {
  Section section;
  section.name = "bad";
  section.notes = {"broken \xFF\xC3 text"};
  const Json document = Json::parse(report::json_text({&section, 1}, origin()));
  CHECK(document["sections"][0]["notes"][0] == "broken \xEF\xBF\xBD\xEF\xBF\xBD text");
  CHECK(Json::parse(report::json_string("a\"\n\xFF")) == "a\"\n\xEF\xBF\xBD");
}

TEST_CASE("laying the text out changes nothing in the document") {
  Section section = example_section();
  section.series[0].t_us.clear();
  section.series[0].value.clear();
  for (int i = 0; i < 1000; ++i) {
    section.series[0].t_us.push_back(kExampleTime + i);
    section.series[0].value.push_back(i % 7 == 0 ? kNaN : i / 3.0);
  }
  const std::string laid_out = report::json_text({&section, 1}, origin());
  const Json document = Json::parse(laid_out);
  REQUIRE(document["sections"][0]["series"][0]["value"].size() == 1000);
  CHECK(document["sections"][0]["series"][0]["value"][1].get<double>() == 1 / 3.0);
  std::size_t longest = 0;
  for (std::size_t at = 0; at < laid_out.size();) {
    const std::size_t end = laid_out.find('\n', at);
    longest = std::max(longest, end - at);
    at = end + 1;
  }
  CHECK(longest <= 300);  // long texts stay whole
}
