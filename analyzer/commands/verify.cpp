#include "analyzer/commands/verify.hpp"

#include <fmt/format.h>

#include "analyzer/commands/info.hpp"
#include "schema/log.hpp"
#include "schema/recover.hpp"

namespace tacho::commands {
namespace {

Finding finding(const char* id, const char* title, std::uint64_t n, Verdict bad, const std::string& advice) {
  Finding f;
  f.id = id;
  f.title = title;
  f.threshold = "PASS 0";
  f.threshold_source = "fixed";
  f.value.value = static_cast<double>(n);
  f.verdict = n == 0 ? Verdict::pass : bad;
  f.severity = n == 0 ? 0 : bad == Verdict::fail ? 8 : 2;
  f.advice = advice;
  return f;
}

Section section_of(store::LogReader& log, const Survey& found) {
  Section section;
  section.name = "verify";
  section.title = "Verification";
  section.question = "Is everything in this log there and whole?";
  std::map<RobotId, std::string> names;
  for (const Robot& robot : log.robots()) {
    names[robot.id] = robot.name;
  }
  DataTable damage{"damage", "Damage", {{"where", "", "file"}, {"what", "", "what is damaged"}}, {}};
  DataTable beside{"beside", "Database files beside the log that are not read", {{"where", "", "file"}, {"what", "", "what it is"}}, {}};
  for (const ReadProblem& p : log.problems()) {
    (p.beside ? beside : damage).rows.push_back({p.where, p.what});
  }
  const store::LogReader::Absent absent = log.absent();
  const std::vector<std::uint32_t>& missing = absent.between;
  for (const std::uint32_t number : missing) {
    damage.rows.push_back({fmt::format("part {}", number), "is missing between others"});
  }
  const ColumnSpec robot{"robot", "", "robot"};
  const ColumnSpec source{"source", "", "source"};
  const ColumnSpec session{"session", "", "session"};
  DataTable streams{"streams",
                    "Polls",
                    {robot,
                     source,
                     session,
                     {"planned", "", "polls asked for"},
                     {"stored", "", "answers"},
                     {"missed", "", "polls in gap rows"},
                     {"lost", "", "neither"},
                     {"doubled", "", "polls accounted for twice"},
                     {"disordered", "", "answers out of order"}},
                    {}};
  DataTable lost{"lost",
                 "Polls that are neither stored nor in a gap row",
                 {robot,
                  source,
                  session,
                  {"poll_from", "", "first"},
                  {"poll_to", "", "last"},
                  {"from", "", "from", false, true},
                  {"to", "", "to", false, true}},
                 {}};
  std::uint64_t holes = 0;
  std::uint64_t wrong = 0;
  for (const auto& [key, s] : found.streams) {
    std::uint64_t n = 0;
    for (const Hole& h : s.holes) {
      n += h.seq_count;
      lost.rows.push_back({names[key.robot], std::string(source_name(key.source)), std::int64_t{key.session},
                           count(h.seq_from), count(h.seq_from + h.seq_count - 1), Time{h.t_from_us}, Time{h.t_to_us}});
    }
    holes += n;
    wrong += s.doubled + s.beyond + s.disordered;
    streams.rows.push_back({names[key.robot], std::string(source_name(key.source)), std::int64_t{key.session},
                            count(s.planned), count(s.stored), count(s.missed), count(n), count(s.doubled),
                            count(s.disordered)});
  }
  DataTable manifest{"manifest",
                     "Rows by hour",
                     {robot,
                      source,
                      {"hour", "", "UTC hour of sending", false, true},
                      {"rows", "", "answers"},
                      {"hash", "", "sum of FNV-1a hashes, see schema/survey.hpp"}},
                     {}};
  manifest.detail = true;
  for (const auto& [key, sum] : found.hours) {
    const auto& [id, from, hour] = key;
    manifest.rows.push_back(
        {names[id], std::string(source_name(from)), Time{hour}, count(sum.rows), fmt::format("{:016x}", sum.hash)});
  }
  const std::string remedy = "tacho-analyzer recover LOG -o NEW writes all that can be read into a new log";
  const EventCheck& e = found.event_check;
  section.findings = {
      finding("VER-01", "damaged files and rows", damage.rows.size() - missing.size(), Verdict::fail, remedy),
      finding("VER-02", "polls neither stored nor in a gap row", holes, Verdict::fail, remedy),
      finding("VER-03", "polls doubled, out of order or never planned", wrong, Verdict::fail, remedy),
      finding("VER-04", "summaries that are not what is there", found.wrong_summaries.size(), Verdict::fail, remedy),
      finding("VER-05", "events that differ from those derived again", e.only_stored + e.only_derived, Verdict::warn,
              "the log may have been written by another version of this program"),
      finding("VER-06", "parts that are missing between others", missing.size(), Verdict::fail,
              "put the missing files back; recover writes gap rows for what was in them"),
      finding("VER-07", "one-minute rollups that differ from those made again", found.wrong_rollups, Verdict::fail,
              remedy),
      finding("VER-08", "hours whose answers are not those that were recorded", found.wrong_hours, Verdict::fail,
              "do not rely on these hours; keep the log: its bytes are whole, but this program reads them as something "
              "else than was written")};
  Finding& events = section.findings[4];
  if (e.sessions == 0 && !e.left_out.empty()) {  // nothing was compared, which is no PASS
    events.verdict = Verdict::unknown;
    events.value.value.reset();
    events.value.reason = "in no session can the way to its events be repeated exactly";
    events.advice = "nothing to do: the notes say what stands in the way";
  }
  section.notes = found.wrong_summaries;
  section.notes.insert(section.notes.end(), found.first_hours.begin(), found.first_hours.end());
  section.notes.insert(section.notes.end(), found.first_rollups.begin(), found.first_rollups.end());
  section.notes.insert(section.notes.end(), e.first.begin(), e.first.end());
  section.notes.push_back(fmt::format("events derived again for {} sessions of a robot", e.sessions));
  for (const auto& [obstacle, sessions] : e.left_out) {
    section.notes.push_back(fmt::format("not for {}: {}", sessions, obstacle));
  }
  for (std::string& note : notes_of(absent, log)) {
    section.notes.push_back(std::move(note));
  }
  section.tables = {damage, beside, streams, lost, manifest};
  return section;
}

std::vector<std::filesystem::path> paths_of(const Options& options) {
  return {options.logs.begin(), options.logs.end()};
}

}  // namespace

int verify(const Options& options) {
  const auto log = open_log(paths_of(options));
  auto& reader = dynamic_cast<store::LogReader&>(*log);
  const Section section = section_of(reader, survey(reader));
  report::Origin origin;
  origin.tool = "tacho-analyzer " TACHO_VERSION;
  const int code = emit(section, origin, options);
  tell_problems(reader);
  return code != kExitOk ? code : exit_code(section.findings, "fail");
}

int recover_log(const Options& options) {
  const Recovery done = recover(paths_of(options), options.output);
  for (const ReadProblem& problem : done.problems) {
    std::fprintf(stderr, "tacho-analyzer: warning: %s: %s\n", problem.where.c_str(), problem.what.c_str());
  }
  for (const ReadProblem& note : done.notes) {
    std::fprintf(stderr, "tacho-analyzer: note: %s: %s\n", note.where.c_str(), note.what.c_str());
  }
  for (const std::string& what : done.different) {
    std::fprintf(stderr, "tacho-analyzer: error: %s: %s; do not use it\n", options.output.c_str(), what.c_str());
  }
  write_stdout(fmt::format("{}: {} answers, {} polls lost, {} rows left out\n", options.output, done.answers, done.lost,
                           done.left_out));
  const bool lossy = done.lost + done.left_out > 0 || !done.whole;
  return !done.different.empty() ? kExitFailed : lossy ? kExitFindings : kExitOk;
}

}  // namespace tacho::commands
