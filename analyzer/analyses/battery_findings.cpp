#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "analyzer/analyses/battery_tables.hpp"
#include "schema/time.hpp"

namespace tacho::battery {
namespace {

class Builder {
 public:
  Builder(const RobotFold& fold, std::string id, std::string title) : fold_(fold) {
    finding_.id = std::move(id);
    finding_.robot = fold.robot.name;
    finding_.title = std::move(title);
  }
  void threshold(std::string words, std::initializer_list<std::string_view> settings) {
    finding_.threshold = std::move(words);
    finding_.threshold_source = fold_.settings->sources(settings, fold_.robot.name);
  }
  Finding unknown(const std::string& why, std::string advice) {
    finding_.verdict = Verdict::unknown;
    finding_.value = battery::unknown(why);
    finding_.advice = std::move(advice);
    return std::move(finding_);
  }
  Finding decide(Verdict verdict, int severity, Quantity value, std::string advice) {
    finding_.verdict = verdict;
    finding_.severity = verdict == Verdict::pass ? 0 : severity;
    finding_.value = std::move(value);
    finding_.advice = std::move(advice);
    return std::move(finding_);
  }
  void evidence(Micros from_us, Micros to_us, Item item, std::string note) {
    if (finding_.evidence.size() < 20) {
      const std::optional<Source> source = fold_.reader.stats(item).source;
      finding_.evidence.push_back(
          {from_us, to_us, std::string(source ? source_name(*source) : std::string_view{}), std::move(note)});
    }
  }
  [[nodiscard]] bool shown() const { return !finding_.evidence.empty(); }

 private:
  const RobotFold& fold_;
  Finding finding_;
};

std::string how_to_get(Item item) {
  return fmt::format("record {} (status answer 1100, or the registers and discrete inputs)", item_name(item));
}

Finding counter_finding(const RobotFold& fold) {
  Builder b(fold, "BAT-03", "battery_cycle against equivalent full cycles");
  b.threshold(fmt::format("PASS when one count is 1.0, 0.9 or 0.8 full cycles or one charge session, WARN otherwise; "
                          "needs {:.0f} steps",
                          fold.config.counter_steps),
              {"battery.counter_steps"});
  if (!fold.has_soc()) {
    return b.unknown(missing(fold, Item::level), how_to_get(Item::level));
  }
  const CounterResult c = counter_result(fold, *fold.packs.back());
  if (c.kind == CounterClass::not_supplied) {
    return b.unknown(missing(fold, Item::counter),
                     "the battery of this robot may not count; our own count is in the table");
  }
  if (c.kind == CounterClass::too_few) {
    return b.unknown(fmt::format("battery_cycle has {} steps in this log", c.steps), "record for longer");
  }
  b.evidence(fold.packs.back()->from_us, fold.packs.back()->to_us, Item::counter,
             fmt::format("{} to {}, {:.1f} full cycles", c.first, c.last, c.efc));
  Quantity value = known(c.efc, "1");
  value.n = static_cast<std::int64_t>(c.steps);
  if (c.kind == CounterClass::sessions && c.sessions_per_count) {
    value =
        within(c.sessions_per_count->slope, c.sessions_per_count->lo, c.sessions_per_count->hi, "sessions per count");
  } else if (c.efc_per_count) {
    value = within(c.efc_per_count->slope, c.efc_per_count->lo, c.efc_per_count->hi, "full cycles per count");
  }
  switch (c.kind) {
    case CounterClass::frozen:
      return b.decide(Verdict::warn, 4, value,
                      "the counter stands still: plan by our full cycles, and have the battery's "
                      "management checked");
    case CounterClass::erratic:
      return b.decide(Verdict::warn, 4, value,
                      "the counter follows neither cycles nor sessions: plan by our full cycles");
    case CounterClass::other:
      return b.decide(Verdict::warn, 2, value,
                      "the counter is steady but counts something else: do not compare it with "
                      "the maker's cycle life");
    default:
      return b.decide(Verdict::pass, 0, value, fmt::format("it counts: {}", counter_class_name(c.kind)));
  }
}

/// Nothing found in less time than it takes to find anything says nothing.
bool too_short(const RobotFold& fold) { return fold.usage.observed_s <= fold.config.failed_s; }

Finding deep_finding(const RobotFold& fold) {
  const Config& c = fold.config;
  Builder b(fold, "BAT-04", "Lowest state of charge");
  b.threshold(fmt::format("PASS when it never fell below {:.0f} %, FAIL when it fell below {:.0f} % (deep discharge)",
                          c.low_soc * 100, c.deep_soc * 100),
              {"battery.low_soc", "battery.deep_soc"});
  if (!fold.has_soc()) {
    return b.unknown(missing(fold, Item::level), how_to_get(Item::level));
  }
  const Usage& u = fold.usage;
  const double half = fold.packs.back()->cycles.quantum / 2;
  const Quantity lowest = within(u.soc_min * 100, (u.soc_min - half) * 100, (u.soc_min + half) * 100, "%");
  const bool deep = u.soc_min + half < c.deep_soc;
  const bool low = u.soc_min - half < c.low_soc;
  for (const Stretch& s : (deep ? u.deep : u.low).examples()) {
    b.evidence(s.from_us, s.to_us, Item::level,
               fmt::format("below {:.0f} % for {}", (deep ? c.deep_soc : c.low_soc) * 100,
                           duration_text(s.to_us - s.from_us)));
  }
  if (!low && too_short(fold)) {
    return b.unknown("the log is too short to tell", "record for longer");
  }
  if (!low) {
    return b.decide(Verdict::pass, 0, lowest, "");
  }
  return b.decide(
      deep ? Verdict::fail : Verdict::warn, deep ? 7 : 4, lowest,
      fmt::format("let the robot go to the charger before it is down to {:.0f} %, or charge it in its pauses "
                  "(table habits: missed charging)",
                  c.low_soc * 100));
}

Finding failed_finding(const RobotFold& fold) {
  const Config& c = fold.config;
  Builder b(fold, "BAT-05", "Failed charges");
  b.threshold(fmt::format("PASS 0, FAIL from {:.0f} on; failed: charging, dock or plug without current for more than "
                          "{:.0f} s below {:.0f} %",
                          c.failed_fail, c.failed_s, c.full_soc * 100),
              {"battery.failed_fail", "battery.failed_s", "battery.full_soc"});
  if (!fold.has_current()) {
    return b.unknown(missing(fold, Item::current), how_to_get(Item::current));
  }
  const RowReader& reader = fold.reader;
  if (reader.stats(Item::charging).given + reader.stats(Item::docked).given + reader.stats(Item::plugged).given == 0) {
    return b.unknown("neither charging nor auto_charge nor manual_charge is in this log", how_to_get(Item::charging));
  }
  const std::vector<ChargeSession> failed = failed_charges(fold);
  for (const ChargeSession& s : failed) {
    b.evidence(s.from_us, s.to_us, s.flagged ? Item::charging : Item::docked,
               fmt::format("{} without current{}", duration_text(s.to_us - s.from_us),
                           s.station.empty() ? "" : " at " + s.station));
  }
  Quantity count = known(static_cast<double>(failed.size()), "");
  count.n = static_cast<std::int64_t>(fold.charges().all().size() + fold.charges().idle_contacts().size());
  if (failed.empty() && too_short(fold)) {
    return b.unknown("the log is too short to tell", "record for longer");
  }
  if (failed.empty()) {
    return b.decide(Verdict::pass, 0, count, "");
  }
  const bool often = static_cast<double>(failed.size()) >= c.failed_fail;
  return b.decide(often ? Verdict::fail : Verdict::warn, often ? 6 : 4, count,
                  "clean the charging contacts and check the docking position and the charger; the table says where");
}

Finding temperature_finding(const RobotFold& fold) {
  const Config& c = fold.config;
  Builder b(fold, "BAT-06", "Battery temperature");
  b.threshold(fmt::format("PASS {:.0f} to {:.0f} degC, FAIL above {:.0f} degC, each for a minute at least",
                          c.temp_min_c, c.temp_warn_c, c.temp_max_c),
              {"battery.temp_min_c", "battery.temp_warn_c", "battery.temp_max_c"});
  if (!fold.has_temperature()) {
    return b.unknown(missing(fold, Item::temp), how_to_get(Item::temp));
  }
  const Usage& u = fold.usage;
  for (const auto& [lasting, word] : {std::pair{&u.hot, "above the limit"}, {&u.warm, "warm"}, {&u.cold, "cold"}}) {
    for (const Stretch& s : lasting->examples()) {
      if (lasting != &u.warm || u.hot.count() == 0) {
        b.evidence(s.from_us, s.to_us, Item::temp, fmt::format("{} for {}", word, duration_text(s.to_us - s.from_us)));
      }
    }
  }
  const bool cold_only = u.cold.count() > 0 && u.warm.count() == 0;
  const Quantity value = known(cold_only ? u.temp_min : u.temp_max, "degC");
  if (u.hot.count() > 0) {
    return b.decide(Verdict::fail, 8, value, "let the battery cool down, charge with less current, and find the cause");
  }
  if (u.warm.count() + u.cold.count() > 0) {
    return b.decide(Verdict::warn, 4, value,
                    cold_only ? "do not charge a frozen battery; check the maker's limit for charging in the cold"
                              : "compare with the maker's limits; high temperature shortens the battery's life");
  }
  if (too_short(fold)) {
    return b.unknown("the log is too short to tell", "record for longer");
  }
  return b.decide(Verdict::pass, 0, value, "");
}

Finding contradiction_finding(const RobotFold& fold) {
  const Config& c = fold.config;
  Builder b(fold, "BAT-07", "Charging flag against current");
  b.threshold(fmt::format("PASS when they never disagree for more than {:.0f} s, FAIL above {:.1f} % of the time",
                          c.contradiction_s, c.contradiction_fail * 100),
              {"battery.contradiction_s", "battery.contradiction_fail"});
  for (const Item item : {Item::current, Item::charging}) {
    if (item == Item::current ? !fold.has_current() : fold.reader.stats(item).given == 0) {
      return b.unknown(missing(fold, item), how_to_get(item));
    }
  }
  const Contradictions& all = *fold.contradictions.at(fold.sign());
  if (all.compared_s() <= c.contradiction_s) {
    return b.unknown("the log is too short to tell", "record for longer");
  }
  for (const Stretch& s : all.examples()) {
    b.evidence(s.from_us, s.to_us, Item::charging,
               s.flag_on ? "charging is on while the battery is discharged" : "charging is off while current flows in");
  }
  const double share = all.seconds() / all.compared_s();
  Quantity value = known(share * 100, "%");
  value.n = static_cast<std::int64_t>(all.count());
  value.exposure = all.compared_s() / 3600;
  if (all.count() == 0) {
    return b.decide(Verdict::pass, 0, value, "");
  }
  return b.decide(
      share > c.contradiction_fail ? Verdict::fail : Verdict::warn, 5, value,
      "sessions here count by flag or current; check the charging relay, its wiring to the controller and the "
      "battery's current sensor");
}

}  // namespace

void add_findings(Section& section, const RobotFold& fold) {
  section.findings.push_back(counter_finding(fold));
  section.findings.push_back(deep_finding(fold));
  section.findings.push_back(failed_finding(fold));
  section.findings.push_back(temperature_finding(fold));
  section.findings.push_back(contradiction_finding(fold));
}

void add_notes(Section& section, const RobotFold& fold) {
  const std::string who = fold.robot.name.empty() ? "" : fold.robot.name + ": ";
  if (fold.reader.rows() == 0) {
    section.notes.push_back(who + "no answer with a battery field in this log");
    return;
  }
  section.notes.push_back(
      fmt::format("{}{} rows of source {}", who, fold.reader.rows(), source_name(*fold.reader.clock_source())));
  if (fold.has_current()) {
    const double agreement = fold.current_sign.agreement();
    section.notes.push_back(
        agreement < 0.75 ? who + "the record does not show which sign of the current is charging; positive is assumed"
                         : fmt::format("{}{} current is charging, as {:.1f} % of the changes of SoC show", who,
                                       fold.sign() > 0 ? "positive" : "negative", agreement * 100));
  }
  if (fold.packs.size() > 1) {
    section.notes.push_back(
        fmt::format("{}{} battery packs: battery_cycle fell; each has its own trends", who, fold.packs.size()));
  }
  for (const PackHint& hint : fold.hints) {
    section.notes.push_back(
        fmt::format("{}SoC and charge limits all changed between {} and {}: perhaps another battery", who,
                    iso_zone(hint.from_us, fold.clock.zone()), iso_zone(hint.to_us, fold.clock.zone())));
  }
}

}  // namespace tacho::battery
