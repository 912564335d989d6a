#include "analyzer/commands/info.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <limits>
#include <optional>

#include "analyzer/commands/period.hpp"
#include "analyzer/commands/twins.hpp"
#include "schema/time.hpp"

namespace tacho::commands {
namespace {

constexpr auto kSettings = std::to_array<SettingRow>({
    {"info.stored_pass", 0.99, "1", "DATA-01 passes from this share of planned polls on", kShare},
    {"info.stored_fail", 0.90, "1", "DATA-01 fails below this share of planned polls", kShare},
});

const ColumnSpec kRobot{"robot", "", "robot"};
const ColumnSpec kSource{"source", "", "source"};

Value time_or_missing(Micros t_us, const char* reason) {
  return t_us == 0 ? Value(Missing{reason}) : Value(Time{t_us});
}

const Robot& robot_of(const std::vector<Robot>& robots, RobotId id) {
  return *std::find_if(robots.begin(), robots.end(), [&](const Robot& r) { return r.id == id; });
}

std::vector<Coverage> coverage_of(const RowSource& log, const std::vector<Robot>& robots) {
  std::vector<Coverage> all = log.coverage();
  std::erase_if(all, [&](const Coverage& c) {
    return std::none_of(robots.begin(), robots.end(), [&](const Robot& r) { return r.id == c.robot; });
  });
  std::sort(all.begin(), all.end(), [](const Coverage& a, const Coverage& b) {
    return std::pair(a.robot, a.source) < std::pair(b.robot, b.source);
  });
  return all;
}

bool overlaps(const Window& window, Micros first_us, Micros last_us) {
  return first_us < window.to_us && last_us >= window.from_us;
}

DataTable parts_table(const store::LogReader& reader, const Window& window) {
  DataTable table{"parts",
                  "Parts",
                  {integer_column("number", "number of the part"),
                   {"file", "", "file name"},
                   {"bytes", "B", "size of the file"},
                   flag_column("closed", "complete, never written again"),
                   {"first", "", "first answer", false, true},
                   {"last", "", "last answer", false, true}},
                  {}};
  for (const store::LogReader::PartInfo& part : reader.parts()) {
    if (part.first_us != 0 && !overlaps(window, part.first_us, part.last_us)) {
      continue;
    }
    table.rows.push_back({static_cast<std::int64_t>(part.number), part.path.filename().string(), count(part.bytes),
                          part.closed, time_or_missing(part.first_us, "holds no answer"),
                          time_or_missing(part.last_us, "holds no answer")});
  }
  return table;
}

DataTable sessions_table(const RowSource& log, const Window& window) {
  DataTable table{"sessions",
                  "Sessions (starts of the recorder)",
                  {integer_column("session", "number"),
                   {"start", "", "start", false, true},
                   {"end", "", "end", false, true},
                   flag_column("clean", "ended as asked, not killed"),
                   {"software", "", "program and version"},
                   {"host", "", "host it ran on"}},
                  {}};
  for (const Session& s : log.sessions()) {
    if (!overlaps(window, s.t_start_us, s.t_end_us == 0 ? std::numeric_limits<Micros>::max() : s.t_end_us)) {
      continue;
    }
    table.rows.push_back({static_cast<std::int64_t>(s.id), Time{s.t_start_us},
                          time_or_missing(s.t_end_us, "still running, or killed"), s.clean, s.software, s.host});
  }
  return table;
}

DataTable robots_table(const std::vector<Robot>& robots) {
  DataTable table{"robots",
                  "Robots",
                  {{"robot", "", "name in the configuration"},
                   {"address", "", "where it was found last"},
                   {"vehicle_id", "", "name it gives itself"},
                   {"mac", "", "hardware address"},
                   {"model_md5", "", "checksum of its model"},
                   {"firmware", "", "from registers 37 to 40"}},
                  {}};
  const auto said = [](const std::string& text) {
    return text.empty() ? Value(Missing{"never told by the robot"}) : Value(text);
  };
  for (const Robot& r : robots) {
    table.rows.push_back({r.name, r.address, said(r.vehicle_id), said(r.mac), said(r.model_md5), said(r.firmware)});
  }
  return table;
}

/// How much of [from, to) these stretches cover; where they overlap, once.
Micros covered(std::vector<std::pair<Micros, Micros>> stretches, Micros from_us, Micros to_us) {
  std::sort(stretches.begin(), stretches.end());
  Micros sum = 0;
  for (const auto& [begin, end] : stretches) {
    from_us = std::max(from_us, begin);
    const Micros until_us = std::min(end, to_us);
    if (until_us > from_us) {
      sum += until_us - from_us;
      from_us = until_us;
    }
  }
  return sum;
}

Value rate_of(const Coverage& c) {
  const Micros off_us = covered(c.gaps.off, c.first_us, c.last_us);
  if (c.stored < 2 || c.last_us - c.first_us <= off_us) {
    return Missing{"fewer than two answers"};
  }
  return static_cast<double>(c.stored - 1) / (static_cast<double>(c.last_us - c.first_us - off_us) / 1e6);
}

/// From the first answer to the last of any robot, and the part of it in which the recorder was off.
std::string running_note(const RowSource& log, const std::vector<Coverage>& all) {
  Micros first_us = 0;
  Micros last_us = 0;
  for (const Coverage& c : all) {
    if (c.stored > 0) {
      first_us = first_us == 0 ? c.first_us : std::min(first_us, c.first_us);
      last_us = std::max(last_us, c.last_us);
    }
  }
  if (last_us <= first_us) {
    return "";
  }
  std::vector<std::pair<Micros, Micros>> sessions;  // one that left out a robot was no time off
  for (const Session& s : log.sessions()) {
    sessions.emplace_back(s.t_start_us, s.t_end_us == 0 ? last_us : s.t_end_us);  // 0: running, or killed last
  }
  const Micros off_us = last_us - first_us - covered(std::move(sessions), first_us, last_us);
  const double span_s = static_cast<double>(last_us - first_us) / 1e6;
  const double off_s = static_cast<double>(off_us) / 1e6;
  return fmt::format("the recorder was running for {:.4g} % of the {:.0f} s from the first answer to the last{}",
                     100.0 * (1.0 - off_s / span_s), span_s,
                     off_s > 0.0 ? fmt::format(", off for {:.0f} s", off_s) : "");
}

/// A number of which a period knows no share.
Value of_whole(std::uint64_t n, bool period) {
  return period ? Value(Missing{"counted for the whole log only"}) : Value(count(n));
}

DataTable sources_table(const std::vector<Coverage>& all, const std::vector<Robot>& robots, bool period) {
  DataTable table{
      "sources",
      "Answers by source",
      {kRobot,
       kSource,
       integer_column("planned", "polls the schedule asked for"),
       integer_column("stored", "answers kept"),
       integer_column("missed", "polls inside gap rows"),
       flag_column("accounted", "stored + missed = planned"),
       integer_column("partial", "answers of which some registers are missing"),
       integer_column("undecodable", "answers kept that could not be decoded"),
       {"period_s", "s", "planned period"},
       {"rate", "Hz", "answers per second from the first to the last, without the time the recorder was off"},
       {"bytes", "B", "bodies as received"},
       {"first", "", "first answer", false, true},
       {"last", "", "last answer", false, true}},
      {}};
  for (const Coverage& c : all) {
    table.rows.push_back(
        {robot_of(robots, c.robot).name, std::string(source_name(c.source)), count(c.planned), count(c.stored),
         count(c.missed),
         period ? Value(Missing{"checked for the whole log: DATA-02"}) : Value(c.stored + c.missed == c.planned),
         count(c.partial), of_whole(c.undecodable, period), static_cast<double>(c.period_us) / 1e6, rate_of(c),
         of_whole(c.bytes, period), time_or_missing(c.stored == 0 ? 0 : c.first_us, "no answer"),
         time_or_missing(c.stored == 0 ? 0 : c.last_us, "no answer")});
  }
  return table;
}

DataTable missed_table(const std::vector<Coverage>& all, const std::vector<Robot>& robots) {
  DataTable table{"missed",
                  "Missed polls by cause",
                  {kRobot,
                   kSource,
                   {"cause", "", "why there is no answer"},
                   integer_column("polls", "planned polls without an answer"),
                   integer_column("gaps", "gap rows"),
                   {"duration_s", "s", "length of the gap rows; of recorder_off the time nobody asked"},
                   {"meaning", "", "the cause in words"}},
                  {}};
  for (const Coverage& c : all) {
    for (const auto& [cause, sum] : c.gaps.causes) {
      table.rows.push_back({robot_of(robots, c.robot).name, std::string(source_name(c.source)),
                            std::string(cause_name(cause)), count(sum.polls), count(sum.gaps),
                            static_cast<double>(sum.length_us) / 1e6, std::string(cause_meaning(cause))});
    }
  }
  return table;
}

DataTable unknown_table(const RowSource& log, const std::vector<Robot>& robots) {
  DataTable table{"unknown_keys",
                  "Unknown keys (kept in the answers, not decoded)",
                  {kRobot,
                   kSource,
                   {"key", "", "path in the JSON answer; errors[] = an element of the list that could not be read"},
                   {"first", "", "first seen", false, true}},
                  {}};
  for (const UnknownKey& k : log.unknown_keys()) {
    const auto at = std::find_if(robots.begin(), robots.end(), [&](const Robot& r) { return r.id == k.robot; });
    if (at != robots.end()) {
      table.rows.push_back({at->name, std::string(source_name(k.source)), k.key, Time{k.first_us}});
    }
  }
  return table;
}

DataTable problems_table(const RowSource& log, const store::LogReader::Absent& absent) {
  DataTable table{"problems",
                  "Foreign, damaged and missing files",
                  {{"where", "", "file, and place in it"}, {"what", "", "what is wrong and what was skipped"}},
                  {}};
  for (const ReadProblem& p : log.problems()) {
    table.rows.push_back({p.where, p.what});
  }
  for (const std::uint32_t number : absent.between) {
    table.rows.push_back({fmt::format("part {}", number), "is missing between others"});
  }
  return table;
}

bool expected(const Field& field, Source source) {
  switch (source) {
    case Source::status:
    case Source::ring:
      return !field.json.key.empty() && !field.json.push_only;
    case Source::push:
      return !field.json.key.empty();
    case Source::io:
      return field.kind == Kind::points;
    case Source::registers:
      return field.reg.present() && !field.reg.discrete;
    case Source::inputs:
      return field.reg.discrete;
    case Source::pose:
      return std::find(kPoseKeys.begin(), kPoseKeys.end(), field.json.key) != kPoseKeys.end();
  }
  return false;
}

std::string names_of(const FieldSet& fields) {
  std::string names;
  for (std::size_t f = 0; f < kFieldCount; ++f) {
    if (fields.test(f)) {
      names += (names.empty() ? "" : " ") + std::string(kFields[f].name);
    }
  }
  return names;
}

DataTable never_seen_table(const std::vector<Coverage>& all, const std::vector<Robot>& robots) {
  DataTable table{
      "never_seen",
      "Fields never seen, and fields never seen with a value",
      {kRobot,
       kSource,
       integer_column("seen", "fields seen at least once"),
       integer_column("never", "fields that this source could give and never gave"),
       {"names", "", "their names"},
       integer_column("without_value", "fields seen, but only as null, not supplied, not meaningful or unreadable"),
       {"names_without_value", "", "their names"}},
      {}};
  for (const Coverage& c : all) {
    FieldSet never;
    for (std::size_t f = 0; f < kFieldCount; ++f) {
      never[f] = c.stored > 0 && expected(kFields[f], c.source) && !c.seen.test(f);
    }
    const FieldSet without_value = c.seen & ~c.valued;
    table.rows.push_back({robot_of(robots, c.robot).name, std::string(source_name(c.source)), count(c.seen.count()),
                          count(never.count()), names_of(never), count(without_value.count()),
                          names_of(without_value)});
  }
  return table;
}

Finding finding(const char* id, const std::string& robot, const std::string& title) {
  Finding f;
  f.id = id;
  f.robot = robot;
  f.title = title;
  f.threshold_source = "fixed";
  return f;
}

Finding coverage_finding(const Robot& robot, const std::vector<Coverage>& all, const Settings& settings) {
  Finding f = finding("DATA-01", robot.name, "share of planned polls that are stored");
  const double pass = settings.number("info.stored_pass", robot.name);
  const double fail = settings.number("info.stored_fail", robot.name);
  f.threshold = fmt::format("PASS >= {:.4g} %, FAIL < {:.4g} %", 100.0 * pass, 100.0 * fail);
  f.threshold_source = settings.sources({"info.stored_pass", "info.stored_fail"}, robot.name);
  f.value.unit = "%";
  f.advice = "the table of missed polls names the causes; timeouts and closed connections: check the network first";
  std::uint64_t planned = 0;
  std::uint64_t stored = 0;
  for (const Coverage& c : all) {
    planned += c.robot == robot.id ? c.planned : 0;
    stored += c.robot == robot.id ? c.stored : 0;
  }
  if (planned == 0) {
    f.value.reason = "no polls were planned";
    f.advice = "the recorder was started and ended before its first poll, or this robot has no source configured";
    return f;
  }
  const double share = static_cast<double>(stored) / static_cast<double>(planned);
  f.value.value = 100.0 * share;
  f.value.n = count(planned);
  f.verdict = share >= pass ? Verdict::pass : share < fail ? Verdict::fail : Verdict::warn;
  f.severity = f.verdict == Verdict::pass ? 0 : f.verdict == Verdict::warn ? 3 : 6;
  return f;
}

Finding accounting_finding(const Robot& robot, const std::vector<Coverage>& all, bool damaged) {
  Finding f = finding("DATA-02", robot.name, "polls that are neither stored nor in a gap row");
  f.threshold = "stored + missed = planned for every source";
  f.value.value = 0.0;
  f.verdict = Verdict::pass;
  for (const Coverage& c : all) {
    if (c.robot != robot.id) {
      continue;
    }
    const auto off = count(c.planned) - count(c.stored) - count(c.missed);
    *f.value.value += static_cast<double>(off < 0 ? -off : off);
    if (off != 0) {
      f.verdict = Verdict::fail;
      f.severity = 8;
      f.evidence.push_back({c.first_us, c.last_us, std::string(source_name(c.source)),
                            fmt::format("planned {}, stored {}, missed {}", c.planned, c.stored, c.missed)});
    }
  }
  f.advice = damaged ? "a part of this log is damaged (DATA-11) or missing (DATA-13): what it held cannot be counted"
                     : "rows are lost or doubled: keep the log as it is and report this as a defect";
  return f;
}

Finding count_finding(const char* id, const char* title, std::size_t n, const char* advice) {
  Finding f = finding(id, "", title);
  f.threshold = "PASS 0";
  f.value.value = static_cast<double>(n);
  f.verdict = n == 0 ? Verdict::pass : Verdict::warn;
  f.severity = n == 0 ? 0 : 2;
  f.advice = advice;
  return f;
}

void add_findings(Section& section, const RowSource& log, const std::vector<Coverage>& all, std::size_t unknown) {
  std::uint64_t undecodable = 0;
  for (const Coverage& c : all) {
    undecodable += c.undecodable;
  }
  section.findings.push_back(
      count_finding("DATA-10", "unknown keys", unknown,
                    "newer firmware than this program knows; nothing is lost, the answers keep them"));
  section.findings.push_back(count_finding("DATA-11", "foreign or damaged files", log.problems().size(),
                                           "the table of foreign and damaged files says what was skipped"));
  section.findings.push_back(count_finding("DATA-12", "answers that cannot be decoded", undecodable,
                                           "`export --raw` gives them back byte for byte"));
}

/// Of a period: says which figures are of it, and marks the others.
void mark_whole(Section& section, const InfoQuery& query) {
  const Window open;
  const auto text = [&](Micros t_us, Micros none, const char* word) {
    return t_us == none ? std::string(word) : iso_zone(t_us, query.zone);
  };
  section.notes.push_back(fmt::format(
      "from {} to {}: parts, sessions, answers, missed polls and DATA-01 are of this period; all else is of the whole "
      "log",
      text(query.window.from_us, open.from_us, "the start of the log"),
      text(query.window.to_us, open.to_us, "the end of the log")));
  for (Finding& finding : section.findings) {
    finding.title += finding.id == "DATA-01" ? "" : " (whole log)";
  }
  for (DataTable& table : section.tables) {
    const bool whole = table.name == "unknown_keys" || table.name == "never_seen" || table.name == "problems";
    table.title += whole ? " (whole log)" : "";
  }
}

void add_notes(Section& section, const RowSource& log, const InfoQuery& query, const std::vector<Coverage>& all) {
  const auto add = [&](std::vector<std::string> notes) {
    section.notes.insert(section.notes.end(), notes.begin(), notes.end());
  };
  if (query.reader != nullptr) {
    add(notes_of(query.reader->absent(), *query.reader));
  }
  add(twin_notes(log, query.robots));
  const auto unknown = std::find_if(section.tables.begin(), section.tables.end(),
                                    [](const DataTable& table) { return table.name == "unknown_keys"; });
  const std::size_t keys = unknown == section.tables.end() ? 0 : unknown->rows.size();
  add({fmt::format("{} unknown keys{}", keys, keys == 0 ? ": every key of the answers is a field" : "")});
  if (std::string running = running_note(log, all); !running.empty()) {
    add({std::move(running)});
  }
  if (query.robots.empty()) {
    add({"this log holds no robot: the recorder was started without one, or nothing was written yet"});
  }
}

}  // namespace

std::vector<std::string> notes_of(const store::LogReader::Absent& absent, const store::LogReader& log) {
  std::vector<std::string> notes;
  if (absent.before > 0) {
    const std::optional<Event> removal = log.last_removal();
    const bool told = removal && removal->subject == fmt::format("part {}", absent.before);
    notes.push_back(fmt::format("the log begins with part {}: {}", absent.before + 1,
                                told ? fmt::format("retention removed part {} at {} ({}), and those before it",
                                                   absent.before, iso_utc(removal->t_us), removal->detail)
                                     : "older ones were moved away, or removed without a word of it in the log"));
  }
  if (absent.cut_off) {
    notes.push_back(
        fmt::format("the newest part here is closed, but session {} has not ended in it: a later part is "
                    "missing, or the recorder stopped on an error",
                    *absent.cut_off));
  }
  return notes;
}

std::span<const SettingRow> info_settings() { return kSettings; }

Section info(RowSource& log, const InfoQuery& query) {
  Section section;
  section.name = "info";
  section.title = "Log";
  section.question = "What does this log hold, and what is missing?";
  const std::vector<Robot>& robots = query.robots;
  const store::LogReader* reader = query.reader;
  const Window open;
  const bool period = query.window.from_us != open.from_us || query.window.to_us != open.to_us;
  const std::vector<Coverage> whole = coverage_of(log, robots);
  const std::vector<Coverage> all = period ? coverage_within(log, whole, query.window) : whole;
  const store::LogReader::Absent absent = reader == nullptr ? store::LogReader::Absent{} : reader->absent();
  const bool damaged = !log.problems().empty() || !absent.between.empty();
  for (const Robot& robot : robots) {
    section.findings.push_back(coverage_finding(robot, all, query.settings));
    section.findings.push_back(accounting_finding(robot, whole, damaged));
  }
  if (reader != nullptr) {
    section.tables.push_back(parts_table(*reader, query.window));
  }
  section.tables.push_back(sessions_table(log, query.window));
  section.tables.push_back(robots_table(robots));
  section.tables.push_back(sources_table(all, robots, period));
  section.tables.push_back(missed_table(all, robots));
  DataTable unknown = unknown_table(log, robots);
  const std::size_t unknown_keys = unknown.rows.size();
  section.tables.push_back(std::move(unknown));
  section.tables.push_back(never_seen_table(whole, robots));
  section.tables.push_back(problems_table(log, absent));
  add_findings(section, log, whole, unknown_keys);
  if (reader != nullptr) {
    section.findings.push_back(
        count_finding("DATA-13", "parts that are missing between others", absent.between.size(),
                      "put the missing files back: what they held is neither stored nor missed"));
  }
  if (period) {
    mark_whole(section, query);
  }
  add_notes(section, log, query, all);
  return section;
}

}  // namespace tacho::commands
