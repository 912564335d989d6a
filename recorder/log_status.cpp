#include "recorder/log_status.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "recorder/config.hpp"
#include "recorder/log_holder.hpp"
#include "schema/json_text.hpp"
#include "schema/log.hpp"
#include "schema/store/kept_parts.hpp"
#include "schema/time.hpp"

namespace tacho::recorder {

namespace {

constexpr Micros kMinute = 60'000'000;
constexpr Micros kDay = Micros{24} * 60 * kMinute;
/// An answer is on disk a commit after it came; a reader cannot know sooner.
constexpr Micros kPatience = 10'000'000;

/// What the recorder goes by: the log has its configuration, and every one that was loaded later. Empty: one that this
/// program cannot read.
std::optional<Config> config_in_force(RowSource& log, const Session& session) {
  std::string text = session.config;
  log.read(0, {session.t_start_us, Window{}.to_us}, Selection{}, [&](const Slice& slice) {
    for (const Event& event : slice.events) {
      text = event.kind == EventKind::config_changed && event.session == session.id ? event.detail : text;
    }
  });
  try {
    return parse_config(text, "log");
  } catch (const Error&) {
    return std::nullopt;
  }
}

/// How often a stream of the session is asked now. Where that depends on the robot, events tell the changes of the last
/// day: before them it was the first rate in a `young` session, and else it may be the slowest.
Micros period_of(const std::optional<Config>& config, const std::string& robot, const Stream& stream, bool young) {
  if (!config) {
    return stream.period_us;
  }
  const auto found = std::find_if(config->robots.begin(), config->robots.end(),
                                  [&](const RobotConfig& one) { return one.name == robot; });
  if (found == config->robots.end()) {
    return 0;
  }
  const Rates rates = found->settings.rates(stream.source);
  return rates.varies() && young ? stream.period_us : rates.slowest();
}

/// Sources of one connection go up and down together; the event names one of them.
void note_link(const Event& event, std::map<Source, StreamStatus*>& streams) {
  if (event.kind != EventKind::link_up && event.kind != EventKind::link_down) {
    return;
  }
  for (const auto& [source, stream] : streams) {
    if (source_info(source).protocol == source_info(event.source).protocol) {
      stream->lost = event.kind == EventKind::link_up ? "" : event.new_value;
    }
  }
}

void note_rate(const Event& event, SessionId session, std::map<Source, StreamStatus*>& streams) {
  const auto stream = streams.find(event.source);
  if (event.kind == EventKind::rate && event.session == session && stream != streams.end()) {
    stream->second->period_us = parse_rate(event.new_value).value_or(stream->second->period_us);
  }
}

/// `session`: the one that is looked at; `until_us`: what is recorded by now is in the log until then.
void read_recent(RowSource& log, const std::pair<RobotId, SessionId>& of, Micros until_us,
                 std::map<Source, StreamStatus*>& streams) {
  const RobotId robot = of.first;
  const SessionId session = of.second;
  Selection times;
  for (const auto& [source, stream] : streams) {
    times.rows[static_cast<std::size_t>(source)] = true;
  }
  times.records = false;
  log.read(robot, {until_us - kMinute + 1, until_us + 1}, times, [&](const Slice& slice) {
    for (const Batch& batch : slice.batches) {
      streams.at(batch.source)->last_minute += batch.rows();
    }
  });
  const Selection records;
  log.read(robot, {until_us - kDay, Window{}.to_us}, records, [&](const Slice& slice) {
    for (const Gap& gap : slice.gaps) {
      const auto stream = streams.find(gap.source);
      if (!gap.partial && stream != streams.end()) {
        stream->second->missed_in_day[static_cast<std::size_t>(gap.cause)] += gap.seq_count;
      }
    }
    for (const ClockPoint& point : slice.clock) {
      const auto status = streams.find(Source::status);
      if (point.robot_us && point.robot == robot && status != streams.end()) {
        status->second->clock_offset_us = *point.robot_us - point.wall_us;
      }
    }
    for (const Event& event : slice.events) {
      note_link(event, streams);
      note_rate(event, session, streams);
    }
  });
}

std::vector<StreamStatus> streams_of(const RowSource& log, const Session& session, const std::optional<Config>& config,
                                     std::map<RobotId, std::vector<std::size_t>>& places) {
  std::map<RobotId, std::string> names;
  for (const Robot& robot : log.robots()) {
    names[robot.id] = robot.name;
  }
  const std::vector<Coverage> coverage = log.coverage();
  std::vector<StreamStatus> out;
  for (const Stream& stream : log.streams()) {
    if (stream.session != session.id) {
      continue;
    }
    StreamStatus row;
    row.robot = names[stream.robot];
    row.source = stream.source;
    const auto known = std::find_if(coverage.begin(), coverage.end(), [&](const Coverage& c) {
      return c.robot == stream.robot && c.source == stream.source;
    });
    if (known != coverage.end()) {
      row.last_answer_us = known->stored > 0 ? known->last_us : 0;
      row.stored = known->stored;
      row.missed = known->missed;
    }
    const bool has_order = stream.source == Source::registers && row.last_answer_us > 0;
    row.word_order = has_order ? word_order_name(stream.word_order) : "";
    const bool young = row.last_answer_us - session.t_start_us < kDay;
    row.period_us = period_of(config, row.robot, stream, young);
    places[stream.robot].push_back(out.size());
    out.push_back(std::move(row));
  }
  return out;
}

std::string ago(Micros us) {
  return us < kMinute ? fmt::format("{:.1f} s", static_cast<double>(us) / 1e6) : duration_text(us);
}

std::string headline(const LogStatus& s) {
  const std::string since =
      fmt::format("since {} ({}), {}", iso_utc(s.session.t_start_us),
                  duration_text((s.now_us - s.session.t_start_us) / 1'000'000 * 1'000'000), s.session.software);
  if (!s.holder.empty()) {
    return fmt::format("recorded by {} {}", s.holder, since);
  }
  if (s.alive()) {
    return fmt::format(
        "recorded {}; but by nobody who can be seen from here: by another computer or container, or it has just died",
        since);
  }
  if (s.session.t_end_us > 0 && s.session.clean) {
    return fmt::format("NOT RECORDED: the last recording ended {}, {} ago", iso_utc(s.session.t_end_us),
                       ago(s.now_us - s.session.t_end_us));
  }
  return s.newest_us == 0
             ? "NOT RECORDED: the recorder died before the first answer"
             : fmt::format("NOT RECORDED: the recorder died, the last answer is {} old", ago(s.now_us - s.newest_us));
}

std::string causes_text(const StreamStatus& stream) {
  std::string out;
  for (std::size_t c = 0; c < kCauseCount; ++c) {
    if (stream.missed_in_day[c] > 0) {
      out +=
          fmt::format("{}{} {}", out.empty() ? "" : ", ", cause_name(static_cast<Cause>(c)), stream.missed_in_day[c]);
    }
  }
  return out;
}

std::string notes_text(const StreamStatus& stream) {
  std::string out = causes_text(stream);
  const auto add = [&out](const std::string& note) { out += (out.empty() ? "" : "; ") + note; };
  if (!stream.lost.empty()) {
    add("connection lost: " + stream.lost);
  }
  if (!stream.word_order.empty()) {
    add("word order " + stream.word_order);
  }
  if (stream.clock_offset_us) {
    add("robot's clock " + offset_text(*stream.clock_offset_us));
  }
  return out;
}

}  // namespace

bool LogStatus::alive() const {
  return !holder.empty() || (session.t_end_us == 0 && newest_us > 0 && now_us - newest_us < kPatience);
}

LogStatus read_status(const std::filesystem::path& folder, Micros now_us) {
  if (std::filesystem::is_regular_file(folder)) {
    throw UsageError(folder.string(), "is a file", "give the folder of the log");
  }
  LogStatus out;
  out.log = folder;
  out.now_us = now_us;
  out.holder = log_holder(folder);
  const std::vector<std::filesystem::path> logs{folder};
  const std::unique_ptr<RowSource> log = open_log(logs);
  if (const std::vector<Session> sessions = log->sessions(); !sessions.empty()) {
    out.session = sessions.back();
  }
  const std::optional<Config> config = config_in_force(*log, out.session);
  out.rules = config ? config->retention : store::RetentionRules{};
  std::map<RobotId, std::vector<std::size_t>> places;
  out.streams = streams_of(*log, out.session, config, places);
  for (const StreamStatus& stream : out.streams) {
    out.newest_us = std::max(out.newest_us, stream.last_answer_us);
  }
  const Micros commit_us = config ? config->commit_us : 0;
  const bool goes_on = out.alive() && out.newest_us <= now_us;  // else the clock was set back since
  const Micros until_us = goes_on ? std::max(out.newest_us, now_us - 2 * commit_us) : out.newest_us;
  for (const auto& [robot, rows] : places) {
    std::map<Source, StreamStatus*> streams;
    for (const std::size_t row : rows) {
      streams[out.streams[row].source] = &out.streams[row];
    }
    read_recent(*log, {robot, out.session.id}, until_us, streams);
  }
  for (StreamStatus& stream : out.streams) {
    const Micros due_us = std::max(stream.last_answer_us, out.session.t_start_us) + 3 * stream.period_us + commit_us;
    const bool always = stream.source != Source::ring;  // of which nothing comes while nothing happens
    stream.late = always && stream.period_us > 0 && out.alive() && now_us > due_us + kPatience;
  }
  for (const ReadProblem& problem : log->problems()) {
    out.problems.push_back(problem.where + " " + problem.what);
  }
  const std::vector<store::KeptPart> parts = store::read_kept_parts(folder);
  out.parts = parts.size();
  out.forecast = store::forecast(out.rules, parts, store::free_disk_bytes(folder));
  return out;
}

std::string status_text(const LogStatus& s) {
  std::string out =
      fmt::format("log {}, {} in {} part{}\n{}\n{}\n", s.log.string(), store::size_text(s.forecast.used_bytes), s.parts,
                  s.parts == 1 ? "" : "s", headline(s), store::forecast_text(s.forecast, s.rules));
  for (const std::string& problem : s.problems) {
    out += fmt::format("problem: {}\n", problem);
  }
  std::size_t width = 5;
  for (const StreamStatus& stream : s.streams) {
    width = std::max(width, stream.robot.size());
  }
  out += fmt::format("\n{:<{}}  {:<9}  {:>20}  {:>8}  {:>11}  {:>11}  {:>9}  {}\n", "robot", width, "source",
                     "last answer", "every", "last minute", "stored", "missed", "missed in the last day; notes");
  for (const StreamStatus& stream : s.streams) {
    const std::string last =
        stream.last_answer_us == 0 ? "never" : ago(std::max<Micros>(0, s.now_us - stream.last_answer_us)) + " ago";
    const Micros planned = stream.period_us > 0 ? kMinute / stream.period_us : 0;
    out += fmt::format(
        "{:<{}}  {:<9}  {:>20}  {:>8}  {:>11}  {:>11}  {:>9}  {}\n", stream.robot, width, source_name(stream.source),
        last + (stream.late ? " LATE" : ""), stream.period_us == 0 ? "off" : duration_text(stream.period_us),
        fmt::format("{}/{}", stream.last_minute, planned), stream.stored, stream.missed, notes_text(stream));
  }
  return out;
}

std::string status_json(const LogStatus& s) {
  const auto quoted = [](std::string_view text) {
    std::string out;
    append_json_string(out, text);
    return out;
  };
  const auto or_null = [](const auto& value) { return value ? fmt::format("{}", *value) : std::string("null"); };
  std::string out = fmt::format(
      "{{\"log\":{},\"recorded\":{},\"holder\":{},\"session\":{},\"since_us\":{},\"ended_us\":{},\"now_us\":{},"
      "\"newest_us\":{},\"parts\":{},\"bytes\":{},\"free_bytes\":{},\"bytes_per_day\":{},\"days_left\":{},\"streams\":"
      "[",
      quoted(s.log.string()), s.alive(), s.holder.empty() ? "null" : quoted(s.holder), s.session.id,
      s.session.t_start_us, s.session.t_end_us == 0 ? "null" : fmt::format("{}", s.session.t_end_us), s.now_us,
      s.newest_us, s.parts, s.forecast.used_bytes, or_null(s.forecast.free_bytes), or_null(s.forecast.bytes_per_day),
      or_null(s.forecast.days_left));
  for (const StreamStatus& stream : s.streams) {
    std::string causes;
    for (std::size_t c = 0; c < kCauseCount; ++c) {
      if (stream.missed_in_day[c] > 0) {
        causes += fmt::format("{}\"{}\":{}", causes.empty() ? "" : ",", cause_name(static_cast<Cause>(c)),
                              stream.missed_in_day[c]);
      }
    }
    out += fmt::format(
        "{}{{\"robot\":{},\"source\":\"{}\",\"period_us\":{},\"last_answer_us\":{},\"late\":{},\"last_minute\":{},"
        "\"stored\":{},\"missed\":{},\"missed_in_day\":{{{}}},\"lost\":{},\"word_order\":{},\"clock_offset_us\":{}}}",
        &stream == &s.streams.front() ? "" : ",", quoted(stream.robot), source_name(stream.source), stream.period_us,
        stream.last_answer_us == 0 ? "null" : fmt::format("{}", stream.last_answer_us), stream.late, stream.last_minute,
        stream.stored, stream.missed, causes, stream.lost.empty() ? "null" : quoted(stream.lost),
        stream.word_order.empty() ? "null" : quoted(stream.word_order), or_null(stream.clock_offset_us));
  }
  return out + "]}\n";
}

}  // namespace tacho::recorder
