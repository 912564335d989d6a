#include "recorder/log_tail.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <ctime>
#include <utility>

#include "recorder/config.hpp"
#include "schema/error.hpp"
#include "schema/json_text.hpp"
#include "schema/log.hpp"
#include "schema/store/log_reader.hpp"
#include "schema/survey.hpp"
#include "schema/text.hpp"
#include "schema/time.hpp"

namespace tacho::recorder {

namespace {

/// Rows are committed in the order of their arrival, and an answer arrives at most a timeout (60 s) after its request.
constexpr Micros kLookBack = 62'000'000;
constexpr std::size_t kNewestParts = 2;
constexpr Micros kLook = 500'000;

constexpr std::array kUsualFields{
    field("x"),        field("y"),       field("angle"),     field("vx"),          field("battery_level"),
    field("charging"), field("blocked"), field("emergency"), field("task_status"), field("current_station")};

std::string json_string(std::string_view text) {
  std::string out;
  append_json_string(out, text);
  return out;
}

/// As JSON: in a line of words, too, where a text with spaces needs its quotes; but there numbers have the seven digits
/// that a register has.
std::string value_text(const Batch& batch, const Column& column, std::size_t row, bool json) {
  const Field& about = field_at(column.field);
  switch (about.kind) {
    case Kind::real:
      return !std::isfinite(column.real[row]) ? "null"
             : json                           ? fmt::format("{}", column.real[row])
                                              : fmt::format("{:.7g}", column.real[row]);
    case Kind::flag:
      return column.integer[row] != 0 ? "true" : "false";
    case Kind::integer:
      return fmt::format("{}", column.integer[row]);
    case Kind::code: {
      const std::string_view name = code_name(about, column.integer[row]);
      return name.empty() ? fmt::format("{}", column.integer[row]) : json_string(name);
    }
    case Kind::text:
      return json_string(batch.text(column, row));
    case Kind::list:
    case Kind::structured:
      return std::string(batch.text(column, row));
    case Kind::alarms:
      return alarms_json(batch, row, about.name);
    case Kind::points:
      return points_json(batch, row, about.name == "do");
  }
  return "null";
}

/// The newest parts, or all: by their numbers, which are in their names.
std::vector<std::filesystem::path> part_files(const std::filesystem::path& log, bool all) {
  const std::vector<std::filesystem::path> logs{log};
  std::vector<std::filesystem::path> files = store::LogReader::files(logs);
  std::erase_if(files, [](const auto& file) { return file.filename().string().rfind("part-", 0) != 0; });
  if (!all && files.size() > kNewestParts) {
    files.erase(files.begin(), files.end() - static_cast<std::ptrdiff_t>(kNewestParts));
  }
  return files.empty() ? logs : files;
}

}  // namespace

std::vector<Source> parse_sources(const std::vector<std::string>& names) {
  const std::vector<std::string> known = source_names();
  std::vector<Source> out;
  for (const std::string& name : names) {
    if (!parse_source(name, out.emplace_back())) {
      throw UsageError("--source " + name, "no such source" + did_you_mean(name, known),
                       fmt::format("the sources are {}", fmt::join(known, ", ")));
    }
  }
  return out;
}

std::vector<FieldIndex> parse_fields(const std::vector<std::string>& names) {
  std::vector<FieldIndex> out;
  for (const std::string& name : names) {
    out.push_back(find_field(name));
    if (out.back() == kNoField) {
      const std::string_view near = nearest_field(name);
      throw UsageError("--fields " + name, "no such field",
                       near.empty() ? "`tacho-analyzer fields` lists them" : fmt::format("did you mean '{}'?", near));
    }
  }
  return out;
}

Tail::Tail(TailOptions options, Micros from_us) : options_(std::move(options)), from_us_(from_us), newest_us_(from_us) {
  if (options_.sources.empty()) {
    options_.sources.assign(all_sources().begin(), all_sources().end());
  }
  if (options_.fields.empty()) {
    options_.fields.assign(kUsualFields.begin(), kUsualFields.end());
  }
  for (const Source source : options_.sources) {
    for (const FieldIndex f : options_.fields) {
      if (options_.answers) {
        selection_.add(source, f);
      }
    }
  }
  const std::vector<std::filesystem::path> logs{options_.log};
  std::vector<std::string> known;
  for (const Robot& robot : open_log(logs)->robots()) {
    known.push_back(robot.name);
  }
  for (const std::string& name : options_.robots) {
    if (std::find(known.begin(), known.end(), name) == known.end()) {
      throw UsageError("--robot " + name, "not in this log" + did_you_mean(name, known),
                       fmt::format("it has {}", fmt::join(known, ", ")));
    }
  }
}

std::vector<std::string> Tail::poll() {
  std::unique_ptr<RowSource> log;
  try {
    log = open_log(part_files(options_.log, first_));
    first_ = false;
  } catch (const Error&) {
    return {};  // a part has just been closed or removed: the next look sees what there is
  }
  std::vector<Line> lines;
  Robot nobody;  // what belongs to no robot
  nobody.name = "-";
  if (options_.robots.empty()) {
    read(*log, nobody, lines);
  }
  for (const Robot& robot : log->robots()) {
    const auto& wanted = options_.robots;
    if (wanted.empty() || std::find(wanted.begin(), wanted.end(), robot.name) != wanted.end()) {
      read(*log, robot, lines);
    }
  }
  std::stable_sort(lines.begin(), lines.end(), [](const Line& a, const Line& b) { return a.t_us < b.t_us; });
  std::vector<std::string> out;
  for (Line& line : lines) {
    newest_us_ = std::max(newest_us_, line.t_us);
    out.push_back(options_.json ? std::move(line.text) : printable(std::move(line.text)));
  }
  newest_us_ = std::min(newest_us_, wall_now_us());  // the clock may have been set back
  std::erase_if(told_records_, [this](const auto& told) { return told.second < newest_us_ - 2 * kLookBack; });
  return out;
}

void Tail::follow(std::optional<Micros> for_us) {
  sigset_t signals;
  sigemptyset(&signals);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    sigaddset(&signals, signal);
  }
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  std::signal(SIGPIPE, SIG_IGN);
  const Micros start_us = mono_now_us();
  for (bool ended = false; !ended;) {
    const Micros before_us = mono_now_us();
    for (const std::string& line : poll()) {
      std::fputs((line + "\n").c_str(), stdout);
    }
    const Micros now_us = mono_now_us();
    // A log of many robots takes longer to look into: never more than a fifth of a core.
    const Micros pause_us = std::max(kLook, 4 * (now_us - before_us));
    const timespec wait{pause_us / 1'000'000, pause_us % 1'000'000 * 1000};
    ended = std::fflush(stdout) != 0 || (for_us && now_us - start_us >= *for_us) ||
            sigtimedwait(&signals, nullptr, &wait) > 0;
  }
}

void Tail::read(RowSource& log, const Robot& robot, std::vector<Line>& lines) {
  log.read(robot.id, {newest_us_ - kLookBack, Window{}.to_us}, selection_, [&](const Slice& slice) {
    rows(robot, slice, lines);
    records(robot, slice, lines);
  });
}

void Tail::rows(const Robot& robot, const Slice& slice, std::vector<Line>& lines) {
  for (const Batch& batch : slice.batches) {
    Poll& told = told_.try_emplace({robot.id, batch.source}, Poll{0, 0}).first->second;
    for (std::size_t row = 0; row < batch.rows(); ++row) {
      const Poll poll{slice.session, batch.seq[row] + 1};
      if (poll <= told) {
        continue;
      }
      told = poll;
      if (batch.t_recv_us[row] > from_us_) {
        lines.push_back({batch.t_recv_us[row], answer_line(robot, slice.session, batch, row)});
      }
    }
  }
}

void Tail::records(const Robot& robot, const Slice& slice, std::vector<Line>& lines) {
  const auto is_new = [this](std::uint64_t hash, Micros t_us) {
    return told_records_.emplace(hash, t_us).second && t_us > from_us_;
  };
  for (const Gap& gap : slice.gaps) {
    if (is_new(row_hash(gap), gap.t_to_us)) {
      lines.push_back({gap.t_to_us, gap_line(robot, gap)});
    }
  }
  for (const Event& event : slice.events) {
    if (is_new(row_hash(event), event.t_us)) {
      lines.push_back({event.t_us, event_line(robot, event)});
    }
  }
}

std::string Tail::answer_line(const Robot& robot, SessionId session, const Batch& batch, std::size_t row) const {
  std::string values;
  for (const FieldIndex f : options_.fields) {
    const Column* const column = batch.find(f);
    if (column != nullptr && column->has(row)) {
      values += options_.json ? fmt::format("{}\"{}\":", values.empty() ? "" : ",", field_at(f).name)
                              : fmt::format(" {}=", field_at(f).name);
      values += value_text(batch, *column, row, options_.json);
    }
  }
  const Micros send_us = batch.t_send_us[row];
  const Micros recv_us = batch.t_recv_us[row];
  if (options_.json) {
    return fmt::format(
        "{{\"type\":\"answer\",\"robot\":{},\"source\":\"{}\",\"session\":{},\"seq\":{},\"t_send_us\":{},"
        "\"t_recv_us\":{},\"fields\":{{{}}}}}",
        json_string(robot.name), source_name(batch.source), session, batch.seq[row], send_us, recv_us, values);
  }
  return fmt::format("{} {} {} #{} {:.1f} ms{}", iso_utc(recv_us), robot.name, source_name(batch.source),
                     batch.seq[row], static_cast<double>(recv_us - send_us) / 1e3, values);
}

std::string Tail::gap_line(const Robot& robot, const Gap& gap) const {
  if (options_.json) {
    return fmt::format(
        "{{\"type\":\"gap\",\"robot\":{},\"source\":\"{}\",\"session\":{},\"seq_from\":{},\"seq_count\":{},"
        "\"t_from_us\":{},\"t_to_us\":{},\"cause\":\"{}\",\"partial\":{},\"detail\":{}}}",
        json_string(robot.name), source_name(gap.source), gap.session, gap.seq_from, gap.seq_count, gap.t_from_us,
        gap.t_to_us, cause_name(gap.cause), gap.partial, json_string(gap.detail));
  }
  return fmt::format("{} {} {} {} {} poll{} from #{}: {}{}{}", iso_utc(gap.t_to_us), robot.name,
                     source_name(gap.source), gap.partial ? "PARTIAL" : "MISSED", gap.seq_count,
                     gap.seq_count == 1 ? "" : "s", gap.seq_from, cause_name(gap.cause), gap.detail.empty() ? "" : ": ",
                     gap.detail);
}

std::string Tail::event_line(const Robot& robot, const Event& event) const {
  if (options_.json) {
    return fmt::format(
        "{{\"type\":\"event\",\"robot\":{},\"source\":\"{}\",\"session\":{},\"seq\":{},\"t_us\":{},\"kind\":\"{}\","
        "\"subject\":{},\"old\":{},\"new\":{},\"detail\":{}}}",
        robot.id == 0 ? "null" : json_string(robot.name), source_name(event.source), event.session, event.seq,
        event.t_us, event_kind_name(event.kind), json_string(event.subject), json_string(event.old_value),
        json_string(event.new_value), json_string(event.detail));
  }
  std::string text = fmt::format("{} {} {} EVENT {}", iso_utc(event.t_us), robot.name,
                                 robot.id == 0 ? "-" : source_name(event.source), event_kind_name(event.kind));
  text += event.subject.empty() ? "" : " " + event.subject;
  if (!event.old_value.empty() || !event.new_value.empty()) {
    text += fmt::format(" {} -> {}", event.old_value.empty() ? "?" : event.old_value, event.new_value);
  }
  // Of a text of several lines the first says what it is.
  const std::string first = event.detail.substr(0, event.detail.find('\n'));
  return text + (first.empty() ? "" : ": " + first);
}

}  // namespace tacho::recorder
