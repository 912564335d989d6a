// The analyzer program on whole logs: every command, every format, and what it says about logs with little in them.

#include "tests/cli/analyze_fixture.hpp"

using namespace tacho;
using namespace tacho::test;
namespace fs = std::filesystem;

TEST_CASE("info: stored and missed polls add up to the planned ones, by cause") {
  const Outcome json = analyze({"info", two_robots(), "--format", "json"});
  INFO(json.err);
  REQUIRE(json.code == 0);
  const Json document = Json::parse(json.out);
  const Json sources = table(document, "sources");
  CHECK(sources.size() == 8);
  for (const Json& s : sources) {
    INFO(s.dump());
    CHECK(s["accounted"] == true);
    CHECK(s["planned"]["value"] == s["stored"]["value"].get<int>() + s["missed"]["value"].get<int>());
  }
  const Json missed = table(document, "missed");
  REQUIRE(missed.size() == 1);
  CHECK(missed[0]["cause"] == "timeout");
  CHECK(missed[0]["polls"]["value"] == 60);
  const Outcome text = analyze({"info", two_robots()});
  CHECK(text.code == 0);
  CHECK(text.out.find("0 unknown keys") != std::string::npos);
  CHECK(text.out.find("amb-02") != std::string::npos);
}

TEST_CASE("every command answers in every format") {
  TempDir dir;
  std::vector<std::string> names = analysis_names();
  names.push_back("info");
  for (const std::string& name : names) {
    INFO(name);
    const Outcome text = analyze({name, two_robots()});
    INFO(text.err);
    CHECK(text.code == 0);
    CHECK(text.out.find(name == "info" ? "DATA-01" : "Notes") != std::string::npos);
    const Outcome json = analyze({name, two_robots(), "--format", "json"});
    REQUIRE(json.code == 0);
    CHECK(Json::parse(json.out)["sections"][0]["name"] == name);
    const Outcome csv = analyze({name, two_robots(), "--format", "csv"});
    CHECK(csv.code == 0);
    CHECK(csv.out.rfind("id,robot,verdict", 0) == 0);
    REQUIRE(analyze({name, two_robots(), "--format", "csv", "-o", (dir / name).string()}).code == 0);
    CHECK(fs::exists(dir / name / "findings.csv"));
    CHECK(fs::exists(dir / name / "schema.csv"));
  }
  REQUIRE(analyze({"blockage", two_robots(), "--format", "png", "-o", (dir / "png").string()}).code == 0);
  CHECK_FALSE(fs::is_empty(dir / "png"));
}

TEST_CASE(
    "a report is the same twice, also from a copy of the log elsewhere, and its sections are those of the commands") {
  TempDir dir;
  const Outcome first = analyze({"report", two_robots(), "-o", (dir / "a").string()});
  INFO(first.err);
  REQUIRE(first.code == 0);
  fs::copy(two_robots(), dir / "copy", fs::copy_options::recursive);
  REQUIRE(analyze({"report", (dir / "copy").string(), "-o", (dir / "b").string()}).code == 0);
  const auto files = contents(dir / "a");
  CHECK(files == contents(dir / "b"));
  CHECK(first.out == files.at("summary.txt"));

  const Json manifest = Json::parse(files.at("manifest.json"));
  CHECK(manifest["input"].size() == 1);
  CHECK(manifest["coverage"].size() == 8);
  CHECK(manifest["files"].size() + 1 == files.size());
  bool picture = false;
  for (const auto& [name, bytes] : files) {
    picture = picture || (name.rfind("blockage/", 0) == 0 && name.ends_with(".png") && bytes.rfind("\x89PNG", 0) == 0);
  }
  CHECK(picture);
  for (const std::string& name : analysis_names()) {
    INFO(name);
    CHECK(analyze({name, two_robots(), "--format", "json"}).out == files.at(name + "/" + name + ".json"));
  }
}

TEST_CASE("info of a period is the same in a report, and says of what is about the whole log that it is") {
  TempDir dir;
  const Outcome outcome = analyze({"report", two_robots(), "--from", "2026-01-01T00:01:00Z", "--to",
                                   "2026-01-01T00:02:00Z", "-o", (dir / "out").string()});
  INFO(outcome.err);
  REQUIRE(outcome.code == 0);
  const Json section = Json::parse(contents(dir / "out").at("info/info.json"))["sections"][0];
  CHECK(section["notes"][0].get<std::string>().find("of the whole log") != std::string::npos);
  REQUIRE_FALSE(section["findings"].empty());
  for (const Json& finding : section["findings"]) {
    INFO(finding.dump());
    CHECK(finding["title"].get<std::string>().ends_with("(whole log)") == (finding["id"] != "DATA-01"));
  }
  const Outcome info = analyze(
      {"info", two_robots(), "--from", "2026-01-01T00:01:00Z", "--to", "2026-01-01T00:02:00Z", "--format", "json"});
  CHECK(info.out == contents(dir / "out").at("info/info.json"));
  for (const Json& source : table(Json::parse(info.out), "sources")) {
    INFO(source.dump());
    const double period_s = source["period_s"]["value"].get<double>();
    CHECK(source["stored"]["value"].get<double>() + source["missed"]["value"].get<double>() ==
          Approx(60.0 / period_s).margin(1.0));
  }
  CHECK(outcome.out.find("(whole log)") != std::string::npos);
}

TEST_CASE("incident: the gap, the events and the signals around a moment, in the order of time") {
  const Outcome json = analyze({"incident", two_robots(), "--at", "2026-01-01T00:05:30Z", "--format", "json"});
  INFO(json.err);
  REQUIRE(json.code == 0);
  const Json document = Json::parse(json.out);
  const Json timeline = table(document, "timeline");
  Micros before = 0;
  bool gap = false;
  for (const Json& row : timeline) {
    CHECK(row["t"]["t_unix_us"].get<Micros>() >= before);
    before = row["t"]["t_unix_us"].get<Micros>();
    gap = gap || (row["kind"] == "gap" && row["what"] == "timeout");
  }
  CHECK(gap);
  CHECK(table(document, "signals").size() > 3);
  CHECK(table(document, "state").size() > 10);
  CHECK(table(document, "quality").size() == 8);
  CHECK(analyze({"incident", two_robots(), "--at", "2026-01-01 01:05:30", "--tz", "+01:00", "--format", "json"}).code ==
        0);
}

TEST_CASE("a log without battery fields: the battery is UNKNOWN and everything else goes on") {
  TempDir dir;
  sim::Scenario scenario = robot("amb-01", 3);
  scenario.battery_fields = false;
  sim::WriteOptions options;
  options.duration_us = 600'000'000;
  sim::write_log({scenario}, options, dir / "log");
  const Outcome outcome = analyze({"battery", (dir / "log").string(), "--format", "json"});
  INFO(outcome.err);
  REQUIRE(outcome.code == 0);
  const Json document = Json::parse(outcome.out);
  const Json& findings = document["sections"][0]["findings"];
  REQUIRE_FALSE(findings.empty());
  for (const Json& finding : findings) {
    INFO(finding.dump());
    CHECK((finding["verdict"] == "UNKNOWN" || finding["verdict"] == "NA"));
  }
  CHECK(analyze({"report", (dir / "log").string(), "-o", (dir / "out").string()}).code == 0);
}

TEST_CASE(
    "an empty log and a log of one or two answers get clear words, never a crash and never a PASS of an analysis") {
  for (const int polls : {0, 1, 2}) {
    TempDir dir;
    const std::string log = (dir / "log").string();
    write_short_log(log, polls);
    INFO(polls << " answers");
    for (const std::string& name : analysis_names()) {
      INFO(name);
      const Outcome outcome = analyze({name, log, "--format", "json"});
      INFO(outcome.err);
      REQUIRE(outcome.code == 0);
      const Json document = Json::parse(outcome.out);
      for (const Json& finding : document["sections"][0]["findings"]) {
        INFO(finding.dump());
        CHECK((polls > 1 || finding["verdict"] != "PASS"));  // one snapshot decides nothing
      }
    }
    for (const std::vector<std::string>& arguments : {std::vector<std::string>{"info", log},
                                                      {"incident", log, "--at", "2026-01-01"},
                                                      {"export", log},
                                                      {"export", log, "--raw"},
                                                      {"report", log, "-o", (dir / "out").string()}}) {
      const Outcome outcome = analyze(arguments);
      INFO(arguments[0] << ": " << outcome.err);
      CHECK(civil(outcome));
      CHECK((outcome.code == 0 || outcome.err.find("tacho-analyzer: error: ") != std::string::npos));
    }
    CHECK(analyze({"info", log}).code == 0);
    CHECK(analyze({"report", log, "-o", (dir / "again").string()}).code == 0);
  }
}

TEST_CASE("a part cut off anywhere is read as far as it goes, or refused with a reason") {
  TempDir dir;
  write_short_log(dir / "whole", 120);
  fs::path part;
  for (const auto& entry : fs::directory_iterator(dir / "whole")) {
    part = entry.path().extension() == ".db" ? entry.path() : part;
  }
  const std::string bytes = read_file(part);
  for (const double share : {0.0, 0.001, 0.1, 0.5, 0.9, 0.999}) {
    INFO(share);
    const fs::path cut = dir / ("cut" + std::to_string(share));
    fs::create_directory(cut);
    const auto size = static_cast<std::size_t>(share * static_cast<double>(bytes.size()));
    std::ofstream(cut / part.filename(), std::ios::binary) << bytes.substr(0, size);
    for (const char* name : {"info", "odometry", "export"}) {
      const Outcome outcome = analyze({name, cut.string()});
      INFO(name << ": " << outcome.err);
      CHECK((outcome.code == 0 || outcome.code == 1));
      CHECK((outcome.code == 0 || outcome.err.find("tacho-analyzer: error: ") != std::string::npos));
      if (outcome.code == 0 && std::string(name) == "info") {
        CHECK(outcome.out.find("WARN     DATA-11") != std::string::npos);
      }
    }
  }
}

TEST_CASE("foreign files in the folder are skipped and named") {
  TempDir dir;
  write_short_log(dir / "log", 30);
  std::ofstream(dir / "log" / "holiday.db") << "this is no database at all, but it is called like one";
  const Outcome outcome = analyze({"info", (dir / "log").string(), "--format", "json"});
  INFO(outcome.err);
  REQUIRE(outcome.code == 0);
  const Json document = Json::parse(outcome.out);
  const Json problems = table(document, "problems");
  REQUIRE(problems.size() == 1);
  CHECK(problems[0]["where"].get<std::string>().find("holiday.db") != std::string::npos);
  CHECK(analyze({"odometry", (dir / "log").string()}).code == 0);
}

TEST_CASE("a configuration changes thresholds and is named with its line in the result") {
  TempDir dir;
  const Outcome list = analyze({"settings", "--format", "json"});
  REQUIRE(list.code == 0);
  std::string name;
  const Json settings = table(Json::parse(list.out), "settings");
  for (const Json& row : settings) {
    if (name.empty() && row["default"].contains("value") && row["default"]["value"].is_number()) {
      name = row["name"].get<std::string>();
    }
  }
  REQUIRE_FALSE(name.empty());
  const std::size_t dot = name.find('.');
  std::ofstream(dir / "site.toml") << "[" << name.substr(0, dot) << "]\n" << name.substr(dot + 1) << " = 3\n";
  const Outcome outcome =
      analyze({"alarms", two_robots(), "--config", (dir / "site.toml").string(), "--format", "json"});
  INFO(outcome.err);
  REQUIRE(outcome.code == 0);
  const Json document = Json::parse(outcome.out);
  bool found = false;
  for (const Json& s : document["settings"]) {
    found = found || (s["name"] == name && s["value"]["value"] == 3.0 && s["source"] == "site.toml:2");
  }
  CHECK(found);
}
