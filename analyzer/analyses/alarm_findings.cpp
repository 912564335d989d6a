// ALM-01 rate band, ALM-02 flood share, ALM-03 chattering codes, ALM-04 stale alarms.

#include <fmt/format.h>

#include <algorithm>

#include "analyzer/analyses/alarm_results.hpp"
#include "analyzer/analyses/cells.hpp"
#include "schema/row_source.hpp"

namespace tacho {
namespace {

constexpr const char* kOperator = " (one operator for all robots)";

struct Words {
  const char* id;
  const char* title;
};
constexpr Words kRate{"ALM-01", "Alarm rate"};
constexpr Words kFloods{"ALM-02", "Share of time in alarm floods"};
constexpr Words kChatter{"ALM-03", "Chattering alarm codes"};
constexpr Words kStale{"ALM-04", "Stale alarms"};

Finding finding(const Words& words, const std::string& robot, int severity) {
  Finding f;
  f.id = words.id;
  f.title = words.title;
  f.robot = robot;
  f.severity = severity;
  return f;
}

void unknown(Finding& f, const std::string& unit, const std::string& reason, const std::string& advice) {
  f.verdict = Verdict::unknown;
  f.value = cells::missing(unit, reason);
  f.advice = advice;
}

void undecided(Finding& f) {
  if (f.verdict == Verdict::unknown) {
    f.advice = "the interval is wider than the PASS band: record longer";
  }
}

/// Of the robot, or of the first one of all that can tell.
std::string source_of(const AlarmData& data, const AlarmScope& scope) {
  for (const RobotAlarms& robot : data.robots) {
    if (!robot.source.empty() && (scope.robot.empty() || robot.name == scope.robot)) {
      return robot.source;
    }
  }
  return {};
}

/// First and last poll of the scope's robots.
Window record_of(const AlarmData& data, const AlarmScope& scope) {
  Window record{scope.end_us, scope.end_us};
  for (const RobotAlarms& robot : data.robots) {
    if (!robot.source.empty() && robot.exposure.polls > 0 && (scope.robot.empty() || robot.name == scope.robot)) {
      record.from_us = std::min(record.from_us, robot.exposure.first_us);
    }
  }
  return record;
}

Finding rate_band(const AlarmData& data, const AlarmScope& scope) {
  const double pass = data.settings.number("alarms.rate_pass_per_h", scope.robot);
  const double fail = data.settings.number("alarms.rate_fail_per_h", scope.robot);
  Finding f = finding(kRate, scope.robot, 5);
  f.title += scope.robot.empty() ? kOperator : "";
  f.threshold = fmt::format(
      "PASS up to {:g} /h, FAIL above {:g} /h (ANSI/ISA-18.2-2016, per operator position); UNKNOWN below "
      "{:g} h",
      pass, fail, data.rules.min_hours);
  f.threshold_source =
      data.settings.sources({"alarms.rate_pass_per_h", "alarms.rate_fail_per_h", "alarms.min_hours"}, scope.robot);
  if (!(scope.hours > 0.0)) {
    unknown(f, "1/h", "no two polls with alarm arrays near each other", "record for at least an hour");
    return f;
  }
  f.value = cells::rate(static_cast<double>(scope.raises.size()), scope.hours, 1.0, "1/h", scope.dispersion);
  f.verdict = cells::judge_small(*f.value.lo, *f.value.hi, pass, fail);
  f.advice = "see by_code: usually a few codes make most of the alarms";
  undecided(f);
  if (scope.hours < data.rules.min_hours - 1e-6) {  // a sum of seconds
    f.verdict = Verdict::unknown;
    f.value.reason = fmt::format("{:.2g} h observed, {:g} h needed", scope.hours, data.rules.min_hours);
    f.advice = fmt::format("record for at least {:g} h", data.rules.min_hours);
  }
  std::map<std::int64_t, int> bins;
  for (const Raise& raise : scope.raises) {
    ++bins[LocalTime::floor_div(raise.mid_us(), 600'000'000)];
  }
  const auto worst = std::max_element(bins.begin(), bins.end(), [](auto& a, auto& b) { return a.second < b.second; });
  if (worst != bins.end()) {
    const Window record = record_of(data, scope);
    f.evidence.push_back({std::max(record.from_us, worst->first * 600'000'000),
                          std::min(record.to_us, (worst->first + 1) * 600'000'000), source_of(data, scope),
                          fmt::format("most in 10 minutes: {}", worst->second)});
  }
  return f;
}

/// Share of time in floods. Limits: Poisson in the number of floods, each with its own length (scaled Poisson).
Finding flood_share(const AlarmData& data, const AlarmScope& scope) {
  const double pass = data.settings.number("alarms.flood_share_pass", scope.robot);
  const double fail = data.settings.number("alarms.flood_share_fail", scope.robot);
  Finding f = finding(kFloods, scope.robot, 6);
  f.title += scope.robot.empty() ? kOperator : "";
  f.threshold = fmt::format("PASS up to {:g} %, FAIL above {:g} %", pass * 100, fail * 100);
  f.threshold_source = data.settings.sources({"alarms.flood_share_pass", "alarms.flood_share_fail"}, scope.robot);
  if (!(scope.hours > 0.0)) {
    unknown(f, "%", "no two polls with alarm arrays near each other", "record for at least a day");
    return f;
  }
  const double observed_s = scope.hours * 3'600.0;
  double sum = 0.0;
  double squares = 0.0;
  for (const Flood& flood : scope.floods) {
    const double length_s = static_cast<double>(flood.to_us - flood.from_us) * 1e-6;
    sum += length_s;
    squares += length_s * length_s;
    f.evidence.push_back({flood.from_us, flood.to_us, source_of(data, scope),
                          fmt::format("{} alarms, first out {}", flood.raises, alarm_text(flood.first_out.key))});
  }
  const double typical_s = data.settings.number("alarms.flood_typical_s", scope.robot);
  const math::Limits limits =
      sum > 0.0 ? math::scaled_limits(sum, squares) : math::Limits{0.0, math::garwood(0).hi * typical_s};
  f.value = cells::bounded(100 * sum / observed_s, 100 * limits.lo / observed_s,
                           std::min(100.0, 100 * limits.hi / observed_s), "%");
  f.value.n = static_cast<std::int64_t>(scope.floods.size());
  f.value.exposure = scope.hours;
  if (scope.floods.empty()) {
    f.value.reason = fmt::format("no flood seen; upper limit for floods of {:g} s", typical_s);
  }
  f.verdict = cells::judge_small(*f.value.lo, *f.value.hi, 100 * pass, 100 * fail);
  f.advice = "look at the first-out code of each flood: the others often follow from it";
  undecided(f);
  return f;
}

Finding chatter_codes(const AlarmData& data, const RobotAlarms& robot, std::size_t index) {
  Finding f = finding(kChatter, robot.name, 4);
  const double fail = data.settings.number("alarms.chatter_codes_fail", robot.name);
  f.threshold = fmt::format("PASS none, FAIL from {:g} codes; chattering: {} raises in {:g} s", fail,
                            data.rules.chatter.raises, static_cast<double>(data.rules.chatter.window_us) * 1e-6);
  f.threshold_source = data.settings.sources(
      {"alarms.chatter_codes_fail", "alarms.chatter_raises", "alarms.chatter_window_s"}, robot.name);
  int sure = 0;
  int possible = 0;
  int seen = 0;
  for (const auto& [key, raises] : raises_by_key(robot, index)) {
    const Chatter chatter = chattering(raises, data.rules.chatter);
    sure += chatter.sure ? 1 : 0;
    possible += chatter.possible ? 1 : 0;
    seen += chatter.runs > 0 ? 1 : 0;
    if (chatter.runs > 0) {
      f.evidence.push_back({chatter.from_us, chatter.to_us, robot.source,
                            fmt::format("{}: {} raises in the worst window", alarm_text(key), chatter.most)});
    }
  }
  f.value = cells::bounded(seen, sure, possible, "");
  f.value.exposure = robot.exposure.observed_s / 3'600.0;
  // Between two raises lies at least one poll without the alarm; twice as many are needed to see most of them.
  const double period_s = static_cast<double>(robot.period_us) * 1e-6;
  const double fastest_s = 2.0 * period_s * static_cast<double>(data.rules.chatter.raises - 1);
  const double window_s = static_cast<double>(data.rules.chatter.window_us) * 1e-6;
  const double hours = robot.exposure.observed_s / 3'600.0;
  if (sure >= fail) {
    f.verdict = Verdict::fail;
  } else if (sure > 0) {
    f.verdict = Verdict::warn;
  } else if (const bool slow = 2.0 * fastest_s > window_s; slow || hours < data.rules.min_hours) {
    const std::string poll = fmt::format("poll {} at least every {:.2g} s", robot.source,
                                         window_s * period_s / (2.0 * std::max(fastest_s, 1e-9)));
    const std::string record = fmt::format("record for at least {:g} h", data.rules.min_hours);
    if (hours < data.rules.min_hours) {
      unknown(f, "", fmt::format("{:.2g} h observed, {:g} h needed", hours, data.rules.min_hours),
              slow ? record + ", and " + poll : record);
    } else {
      unknown(f, "", fmt::format("at a period of {:g} s most raises of a chattering code are not seen", period_s),
              poll);
    }
    return f;
  } else {
    f.verdict = possible > 0 ? Verdict::warn : Verdict::pass;
  }
  f.advice = "a chattering code hides others: add a delay or fix the sensor behind it";
  return f;
}

/// Most alarms on one local day that are older than the limit on it.
Finding stale_alarms(const AlarmData& data, const RobotAlarms& robot) {
  Finding f = finding(kStale, robot.name, 3);
  const double pass = data.settings.number("alarms.stale_pass", robot.name);
  f.threshold = fmt::format(
      "PASS fewer than {:g} on any day (ANSI/ISA-18.2-2016), FAIL otherwise; stale: active for more "
      "than {:g} h",
      pass, data.rules.stale_s / 3'600.0);
  f.threshold_source = data.settings.sources({"alarms.stale_pass", "alarms.stale_h"}, robot.name);
  LocalTime local(data.zone);
  std::map<std::int64_t, std::int64_t> sure;
  std::map<std::int64_t, std::int64_t> possible;
  for (const AlarmInterval& a : robot.intervals()) {
    const Lasting lasting = stale({&a, 1}, data.rules.stale_s);
    if (lasting.possible == 0) {
      continue;
    }
    const Micros from = a.onset_hi_us + static_cast<Micros>(data.rules.stale_s * 1e6);
    const Micros to = std::max(from, a.clear_lo_us);
    for (std::int64_t day = local.day(from); day <= local.day(to); ++day) {
      sure[day] += lasting.sure;
      possible[day] += 1;
    }
    if (lasting.sure > 0) {
      f.evidence.push_back({a.onset_hi_us, a.clear_lo_us, robot.source, alarm_text(a.key)});
    }
  }
  const auto most = [](const std::map<std::int64_t, std::int64_t>& days) {
    std::int64_t m = 0;
    for (const auto& [day, n] : days) {
      m = std::max(m, n);
    }
    return static_cast<double>(m);
  };
  const double lo = most(sure);
  const double hi = most(possible);
  f.value = cells::bounded(lo, lo, hi, "");
  f.value.exposure = robot.exposure.observed_s / 3'600.0;
  const double record_s = static_cast<double>(robot.exposure.last_us - robot.exposure.first_us) * 1e-6;
  if (lo >= pass) {
    f.verdict = Verdict::fail;
  } else if (record_s <= data.rules.stale_s) {
    unknown(f, "", "the record is shorter than the age at which an alarm is stale", "record for more than a day");
    return f;
  } else {
    f.verdict = hi < pass ? Verdict::pass : Verdict::warn;
  }
  f.advice = "an alarm nobody clears for a day is either no alarm or a defect: decide which";
  return f;
}

}  // namespace

std::vector<Finding> alarm_findings(const AlarmData& data) {
  std::vector<Finding> out;
  for (const RobotAlarms& robot : data.robots) {
    if (!robot.source.empty()) {
      continue;
    }
    for (const Words& words : {kRate, kFloods, kChatter, kStale}) {
      Finding f = finding(words, robot.name, 0);
      unknown(f, "", robot.why_not, "record status answers (1100) with the keys fatals, errors, warnings, notices");
      out.push_back(std::move(f));
    }
  }
  if (data.scopes.size() == 1) {
    return out;  // no robot can tell: nothing to say about all of them either
  }
  for (const AlarmScope& scope : data.scopes) {
    out.push_back(rate_band(data, scope));
    out.push_back(flood_share(data, scope));
  }
  for (std::size_t r = 0; r < data.robots.size(); ++r) {
    if (!data.robots[r].source.empty()) {
      out.push_back(chatter_codes(data, data.robots[r], r));
      out.push_back(stale_alarms(data, data.robots[r]));
    }
  }
  return out;
}

}  // namespace tacho
