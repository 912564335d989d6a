// The metrics as a scraper sees them: well formed, each once, and the same numbers as the summary.

#include "recorder/metrics.hpp"

#include <httplib.h>

#include <map>
#include <regex>
#include <set>
#include <sstream>

#include "recorder/metrics_server.hpp"
#include "tests/recorder/recording.hpp"
#include "tests/support/temp_dir.hpp"

using namespace tacho;
using namespace tacho::recorder;
using namespace tacho::recorder::test;
using tacho::test::TempDir;

namespace {

struct Scrape {
  std::map<std::string, std::string> types;  // by name
  std::map<std::string, double> values;      // by the whole series, labels included
  std::vector<std::string> names;            // of series, in order
};

/// Strict: every line is HELP, TYPE or a sample of the name announced last.
Scrape parse(const std::string& text) {
  static const std::regex kSample(
      R"re(([a-zA-Z_:][a-zA-Z0-9_:]*)((?:\{[a-z_]+="(?:[^"\\\n]|\\["\\n])*"(?:,[a-z_]+="(?:[^"\\\n]|\\["\\n])*")*\})?) (\S+))re");
  Scrape out;
  std::istringstream lines(text);
  std::string name;
  for (std::string line; std::getline(lines, line);) {
    INFO(line);
    if (line.rfind("# HELP ", 0) == 0) {
      name = line.substr(7, line.find(' ', 7) - 7);
      CHECK(line.size() > 7 + name.size() + 1);
    } else if (line.rfind("# TYPE ", 0) == 0) {
      CHECK(line.substr(7, name.size()) == name);
      CHECK(out.types.emplace(name, line.substr(8 + name.size())).second);
    } else {
      std::smatch match;
      REQUIRE(std::regex_match(line, match, kSample));
      CHECK(match[1].str().rfind(name, 0) == 0);
      CHECK(out.values.emplace(match[1].str() + match[2].str(), std::stod(match[3])).second);
      out.names.push_back(match[1]);
    }
  }
  CHECK((text.empty() || text.back() == '\n'));
  return out;
}

StreamNow stream(const std::string& robot) {
  StreamNow out;
  out.robot = robot;
  out.planned = 10;
  out.stored = 7;
  out.missed[static_cast<std::size_t>(Cause::timeout)] = 3;
  return out;
}

}  // namespace

TEST_CASE("every metric has one name of its own, a type, a sentence, and counters end in _total") {
  std::set<std::string_view> names;
  for (const MetricName& metric : metric_names()) {
    INFO(metric.name);
    CHECK(names.insert(metric.name).second);
    CHECK(metric.name.rfind("tachograph_", 0) == 0);
    CHECK((metric.type == "counter") == (metric.name.substr(metric.name.size() - 6) == "_total"));
    CHECK((metric.type == "counter" || metric.type == "gauge" || metric.type == "histogram"));
    CHECK(metric.help.size() > 15);
    CHECK(metric.help.find('\n') == std::string_view::npos);
  }
}

TEST_CASE("quotes, backslashes and line feeds in a robot's name are escaped") {
  Snapshot snapshot;
  snapshot.streams.push_back(stream("a\"b\\c\nd"));
  const Scrape scrape = parse(metrics_text(snapshot));
  CHECK(scrape.values.count(R"(tachograph_polls_planned_total{robot="a\"b\\c\nd",source="status"})") == 1);
}

TEST_CASE("a histogram counts up to +Inf, which is its count, and adds up seconds") {
  Snapshot snapshot;
  snapshot.streams.push_back(stream("a"));
  for (const Micros us : {400, 500, 501, 60'000, 90'000'000}) {
    snapshot.streams[0].round_trip.add(us);
  }
  const Scrape scrape = parse(metrics_text(snapshot));
  const auto bucket = [&](const std::string& bound) {
    return scrape.values.at(R"(tachograph_round_trip_seconds_bucket{robot="a",source="status",le=")" + bound + "\"}");
  };
  CHECK(bucket("0.0005") == 2);  // bounds belong to their bucket
  CHECK(bucket("0.001") == 3);
  CHECK(bucket("0.05") == 3);
  CHECK(bucket("0.1") == 4);
  CHECK(bucket("5") == 4);
  CHECK(bucket("+Inf") == 5);
  CHECK(scrape.values.at(R"(tachograph_round_trip_seconds_count{robot="a",source="status"})") == 5);
  CHECK(scrape.values.at(R"(tachograph_round_trip_seconds_sum{robot="a",source="status"})") == Approx(90.061401));
}

TEST_CASE("what is not known is absent, not zero") {
  const std::string nothing = metrics_text(Snapshot{});
  CHECK(parse(nothing).values.count("tachograph_log_days_left") == 0);
  Snapshot snapshot;
  snapshot.forecast.days_left = 41.5;
  snapshot.streams.push_back(stream("a"));
  const Scrape scrape = parse(metrics_text(snapshot));
  CHECK(scrape.values.at("tachograph_log_days_left") == 41.5);
  CHECK(scrape.values.count(R"(tachograph_last_answer_time_seconds{robot="a",source="status"})") == 0);
  CHECK(scrape.values.count(R"(tachograph_robot_clock_offset_seconds{robot="a"})") == 0);
}

TEST_CASE("a scrape gives the numbers of the summary, and counters never fall on the way there") {
  TempDir dir;
  TinyServer status([](Peer& peer, int) { serve_status(peer); });
  ModbusServer modbus([](const Asked&) { return 0; });
  const std::uint16_t nobody = closed_port();
  const Config config = config_for(dir / "log", {{status.port(), modbus.port()}, {nobody, nobody}});
  Recorder recorder(config, {});
  MetricsServer server("127.0.0.1:0", [&] { return metrics_text(recorder.snapshot()); });
  httplib::Client client("127.0.0.1", server.port());
  const auto scrape = [&] {
    const auto answer = client.Get("/metrics");
    REQUIRE(answer);
    CHECK(answer->status == 200);
    CHECK(answer->get_header_value("Content-Type") == kMetricsContentType);
    return parse(answer->body);
  };
  Scrape before = scrape();
  while (before.values[R"(tachograph_polls_stored_total{robot="r1",source="inputs"})"] < 5 ||
         before.values[R"(tachograph_polls_missed_total{robot="r2",source="inputs",cause="connect_refused"})"] < 5) {
    const Scrape now = scrape();
    for (const auto& [series, value] : before.values) {
      if (series.find("_total") != std::string::npos || series.find("_bucket") != std::string::npos) {
        INFO(series);
        CHECK(now.values.at(series) >= value);
      }
    }
    before = now;
  }
  CHECK(before.values.at(R"(tachograph_link_up{robot="r1",protocol="modbus"})") == 1);
  CHECK(before.values.at(R"(tachograph_link_up{robot="r2",protocol="modbus"})") == 0);
  const auto summary = recorder.finish();
  Scrape end = scrape();
  for (const SourceSummary& row : summary) {
    const std::string labels = "{robot=\"" + row.robot + "\",source=\"" + std::string(source_name(row.source)) + "\"";
    INFO(labels);
    CHECK(end.values.at("tachograph_polls_planned_total" + labels + "}") == static_cast<double>(row.planned));
    CHECK(end.values.at("tachograph_polls_stored_total" + labels + "}") == static_cast<double>(row.stored));
    CHECK(end.values.at("tachograph_round_trip_seconds_count" + labels + "}") == static_cast<double>(row.stored));
    for (std::size_t c = 0; c < kCauseCount; ++c) {
      const std::string cause(cause_name(static_cast<Cause>(c)));
      const auto missed = end.values.find("tachograph_polls_missed_total" + labels + ",cause=\"" + cause + "\"}");
      CHECK((missed == end.values.end() ? 0.0 : missed->second) == static_cast<double>(row.missed[c]));
    }
  }
}

TEST_CASE("only /metrics has numbers, and nothing can be sent") {
  MetricsServer server("127.0.0.1:0", [] { return "x\n"; });
  httplib::Client client("127.0.0.1", server.port());
  CHECK(client.Get("/elsewhere")->status == 404);
  CHECK(client.Get("/")->body.find("/metrics") != std::string::npos);
  const auto post = client.Post("/metrics", "x", "text/plain");
  CHECK((!post || post->status >= 400));
}

TEST_CASE("a port that is taken is an error that says so") {
  MetricsServer server("127.0.0.1:0", [] { return ""; });
  const std::string taken = "127.0.0.1:" + std::to_string(server.port());
  CHECK_THROWS_WITH(MetricsServer(taken, [] { return ""; }), Catch::Contains("cannot listen there"));
}
