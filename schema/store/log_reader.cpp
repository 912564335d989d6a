#include "schema/store/log_reader.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <map>
#include <set>
#include <tuple>
#include <utility>

#include "schema/store/order_guard.hpp"
#include "schema/store/part_head.hpp"
#include "schema/store/part_reader.hpp"
#include "schema/store/scavenge.hpp"
#include "schema/store/schema_sql.hpp"
#include "schema/store/slicer.hpp"

namespace tacho::store {

namespace {

namespace fs = std::filesystem;

/// Every file that may be a part, each once: the *.db files of a folder, or the file itself.
std::vector<fs::path> candidates(std::span<const fs::path> logs) {
  std::vector<fs::path> files;
  for (const fs::path& log : logs) {
    std::error_code error;
    if (!fs::exists(log, error)) {
      throw Error(log.string(), error ? error.message() : "does not exist",
                  "give the folder of a log, or a part of one");
    }
    if (!fs::is_directory(log)) {
      files.push_back(fs::canonical(log));
      continue;
    }
    fs::directory_iterator entries(log, error);
    if (error) {
      throw Error(log.string(), error.message(), "check that this user may read the folder");
    }
    const fs::path folder = fs::canonical(log);  // once, not for each of its files
    for (const auto& entry : entries) {
      const std::string name = entry.path().filename().string();
      if (entry.is_regular_file() && entry.path().extension() == ".db" && name.front() != '.') {
        files.push_back(entry.is_symlink() ? fs::canonical(entry.path()) : folder / name);
      }
    }
  }
  std::sort(files.begin(), files.end());
  files.erase(std::unique(files.begin(), files.end()), files.end());
  return files;
}

// Of the inputs before a window: so much later one has come, or there is a gap row.
constexpr Micros kLeadPeriods = 3;
constexpr Micros kLeadUs = 5'000'000;
constexpr std::size_t kMostAbsent = 1000;  // a damaged number may lie anywhere

std::optional<Event> last_removal_in(const fs::path& part) {
  std::optional<Event> last;
  try {
    Connection connection = open_part_for_reading(part);
    Statement row(connection, select_sql("event") + " WHERE kind = ?1 ORDER BY id");
    for (row.query(event_kind_name(EventKind::part_removed)); row.step();) {
      std::optional<Event> event = read_event(row);
      last = event ? std::move(event) : std::move(last);
    }
  } catch (const Error&) {
    // Whoever reads its rows is told.
  }
  return last;
}

std::string joined(std::span<const fs::path> paths) {
  std::string out;
  for (const fs::path& path : paths) {
    out += (out.empty() ? "" : ", ") + path.string();
  }
  return out;
}

}  // namespace

struct LogReader::Impl {
  Decoders decoders;
  Access access = Access::careful;
  BlockTools blocks;
  std::map<const PartHead*, std::unique_ptr<PartReader>> kept;  // of closed parts, open from read() to read()
  std::vector<PartHead> parts;                                  // by number
  bool whole_folder = false;
  std::set<std::uint32_t> numbers;  // of all files of the folders, also of those that cannot be read
  std::vector<ReadProblem> problems;
  std::set<std::pair<std::string, std::string>> told;
  std::map<RobotId, Robot> robots;
  std::map<SessionId, Session> sessions;
  std::map<StreamKey, Stream> streams;
  std::map<StreamKey, std::uint64_t> first_seq;  // of the earliest part that is here
  std::map<StreamKey, std::uint64_t> next_seq;   // after stored answers and gaps
  std::vector<Coverage> coverage;

  void problem(const std::string& where, const std::string& what, bool beside = false) {
    if (told.emplace(where, what).second) {
      problems.push_back({where, what, beside});
    }
  }

  void open(std::span<const fs::path> logs);
  void add_part(const fs::path& path);
  void require_one_log(std::span<const fs::path> logs);
  void drop_copies();
  void merge_heads();
  void merge_coverage();
  ColumnQuery query_of(RobotId robot, Window window);
  void lead_in(RobotId robot, Window window, InputGates& gates);
  PartReader reader(const PartHead& head, Access how = Access::careful);
  PartReader& kept_reader(const PartHead& head);

  template <class Use>
  void each_part(Use use);
  template <class Use>
  void read_carefully(const PartHead& head, Use use);
  const Stream& stream_of(const AnswerMeta& meta);
};

void LogReader::Impl::open(std::span<const fs::path> logs) {
  for (const fs::path& path : candidates(logs)) {
    add_part(path);
  }
  for (const fs::path& log : logs) {
    if (fs::is_directory(log)) {
      whole_folder = true;
      for (const PartFile& file : list_parts(log)) {
        numbers.insert(file.number);
      }
    }
  }
  if (parts.empty()) {
    const std::string cause =
        problems.empty() ? "there is no part of a log here" : problems.front().where + " " + problems.front().what;
    throw Error(joined(logs), cause, "give the folder that tacho-recorder wrote, or a part-*.db file of it");
  }
  const auto place = [](const PartHead& part) {  // of two with one number, the one that has its name is no copy
    const bool renamed = part.path.filename() != part_path({}, part.row.number).filename();
    return std::tuple(part.row.number, renamed, part.path);
  };
  std::sort(parts.begin(), parts.end(), [&](const PartHead& a, const PartHead& b) { return place(a) < place(b); });
  require_one_log(logs);
  drop_copies();
  merge_heads();
  merge_coverage();
}

/// A damaged part may have forgotten which log it is of: it is left out rather than all others.
void LogReader::Impl::require_one_log(std::span<const fs::path> logs) {
  const auto whole = std::find_if(parts.begin(), parts.end(), [](const PartHead& head) { return head.damage.empty(); });
  const PartHead& first = whole == parts.end() ? parts.front() : *whole;
  const std::string log = first.row.log;
  for (const PartHead& head : parts) {
    if (head.row.log != log && head.damage.empty()) {
      throw Error(joined(logs),
                  fmt::format("{} and {} are parts of different logs", first.path.string(), head.path.string()),
                  "read one log at a time");
    }
  }
  const auto stranger = [&](const PartHead& head) {
    if (head.row.log != log) {
      problem(head.path.string(), "says it is a part of another log; left out");
    }
    return head.row.log != log;
  };
  parts.erase(std::remove_if(parts.begin(), parts.end(), stranger), parts.end());
}

void LogReader::Impl::add_part(const fs::path& path) {
  try {
    parts.push_back(read_part(path, access));
    for (const std::string& damage : parts.back().damage) {
      problem(path.string(), damage + "; what can be read is used");
    }
  } catch (const NewerPart&) {
    throw;
  } catch (const Error& error) {
    std::string what = error.what();
    if (const std::string name = path.string() + ": "; what.rfind(name, 0) == 0) {
      what.erase(0, name.size());
    }
    problem(path.string(), what.append(kSkipped), !may_be_part(path));
  }
}

void LogReader::Impl::drop_copies() {
  const auto same_part = [&](const PartHead& a, const PartHead& b) {
    if (a.row.number != b.row.number) {
      return false;
    }
    problem(b.path.string(), ("is a copy of " + a.path.string()).append(kSkipped), true);
    return true;
  };
  parts.erase(std::unique(parts.begin(), parts.end(), same_part), parts.end());
}

void LogReader::Impl::merge_heads() {
  for (const PartHead& head : parts) {
    for (const Robot& robot : head.robots) {
      robots[robot.id] = robot;
    }
    for (const Session& session : head.sessions) {
      Session& known = sessions[session.id];
      if (known.t_end_us == 0) {
        known = session;
      }
    }
    for (const StreamRow& row : head.streams) {
      const StreamKey key{row.stream.session, row.stream.robot, row.stream.source};
      first_seq.try_emplace(key, row.seq_from);
      Stream& known = streams[key];
      // A part that was begun and never written, for the disk failed, knows fewer polls than the one before.
      const std::optional<std::uint64_t> planned = std::max(row.stream.planned, known.planned);
      known = row.stream;
      known.planned = planned;
    }
  }
}

PartReader LogReader::Impl::reader(const PartHead& head, Access how) {
  return PartReader(
      head, [this, &head](const std::string& what) { problem(head.path.string(), what); }, how);
}

/// Opening a part, and mapping it, takes as long as reading an hour of a column.
PartReader& LogReader::Impl::kept_reader(const PartHead& head) {
  constexpr std::size_t kKept = 64;
  auto found = kept.find(&head);
  if (found == kept.end() || !is_closed(head)) {
    if (kept.size() >= kKept) {
      kept.clear();
    }
    const Access how = is_closed(head) ? access : Access::careful;
    found = kept.insert_or_assign(&head, std::make_unique<PartReader>(reader(head, how))).first;
  }
  return *found->second;
}

/// Runs `use` for each part. A part that has gone or broken since it was opened is named and left out.
template <class Use>
void LogReader::Impl::each_part(Use use) {
  for (const PartHead& head : parts) {
    try {
      use(head);
    } catch (const SqliteError& error) {
      problem(head.path.string(), std::string(error.what()) + "; the rest of this part is left out");
    }
  }
}

/// Runs `use` with a reader of the part, inside a transaction.
template <class Use>
void LogReader::Impl::read_carefully(const PartHead& head, Use use) {
  std::optional<PartReader> fresh;
  const bool keep = access == Access::careful && is_closed(head);
  PartReader& part = keep ? kept_reader(head) : fresh.emplace(reader(head));
  const PartReader::Transaction reading(part);
  use(part);
}

void LogReader::Impl::merge_coverage() {
  std::map<std::pair<RobotId, Source>, Coverage> sums;
  for (const PartHead& head : parts) {
    for (const auto& [key, count] : head.counts) {
      Coverage& sum = sums[{key.robot, key.source}];
      if (count.stored == 0) {
        continue;
      }
      sum.first_us = sum.stored == 0 ? count.first_us : std::min(sum.first_us, count.first_us);
      sum.last_us = sum.stored == 0 ? count.last_us : std::max(sum.last_us, count.last_us);
      sum.stored += count.stored;
      sum.bytes += count.bytes;
      sum.undecodable += count.undecodable;
      sum.seen |= count.seen;
      sum.valued |= count.valued;
      next_seq[key] = std::max(next_seq[key], count.next_seq);
    }
    for (const auto& [key, count] : head.gaps) {
      Coverage& sum = sums[{key.robot, key.source}];
      sum.missed += count.missed;
      sum.partial += count.partial;
      sum.gaps.add(count.sums);
      next_seq[key] = std::max(next_seq[key], count.next_seq);
    }
  }
  for (const auto& [key, stream] : streams) {
    Coverage& sum = sums[{key.robot, key.source}];
    sum.period_us = stream.period_us;
    const std::uint64_t end = stream.planned.value_or(next_seq[key]);
    sum.planned += end - std::min(end, first_seq[key]);
  }
  for (auto& [key, sum] : sums) {
    std::tie(sum.robot, sum.source) = key;
    coverage.push_back(sum);
  }
}

/// A stream whose row is damaged is read with the defaults.
const Stream& LogReader::Impl::stream_of(const AnswerMeta& meta) {
  const auto [found, added] = streams.try_emplace({meta.session, meta.robot, meta.source});
  if (added) {
    found->second.session = meta.session;
    found->second.robot = meta.robot;
    found->second.source = meta.source;
  }
  return found->second;
}

LogReader::LogReader(std::span<const fs::path> logs, Decoders decoders, Access access)
    : impl_(std::make_unique<Impl>()) {
  impl_->decoders = std::move(decoders);
  impl_->access = access;
  impl_->open(logs);
}

LogReader::~LogReader() = default;

std::vector<fs::path> LogReader::files(std::span<const fs::path> logs) { return candidates(logs); }

std::vector<Robot> LogReader::robots() const {
  std::vector<Robot> out;
  for (const auto& [id, robot] : impl_->robots) {
    out.push_back(robot);
  }
  return out;
}

std::vector<Session> LogReader::sessions() const {
  std::vector<Session> out;
  for (const auto& [id, session] : impl_->sessions) {
    out.push_back(session);
  }
  return out;
}

std::vector<Stream> LogReader::streams() const {
  std::vector<Stream> out;
  for (const auto& [key, stream] : impl_->streams) {
    out.push_back(stream);
  }
  return out;
}

std::vector<Coverage> LogReader::coverage() const { return impl_->coverage; }

std::vector<UnknownKey> LogReader::unknown_keys() const {
  std::map<std::tuple<RobotId, Source, std::string>, Micros> first;
  for (const PartHead& head : impl_->parts) {
    for (const UnknownKey& key : head.unknown_keys) {
      const auto [known, added] = first.try_emplace({key.robot, key.source, key.key}, key.first_us);
      known->second = std::min(known->second, key.first_us);
    }
  }
  std::vector<UnknownKey> out;
  for (const auto& [key, first_us] : first) {
    out.push_back({std::get<0>(key), std::get<1>(key), std::get<2>(key), first_us});
  }
  return out;
}

std::vector<ReadProblem> LogReader::problems() const { return impl_->problems; }

LogReader::Absent LogReader::absent() const {
  Absent absent;
  if (!impl_->whole_folder) {
    return absent;
  }
  std::set<std::uint32_t> here = impl_->numbers;
  for (const PartHead& head : impl_->parts) {
    here.insert(head.row.number);
  }
  absent.before = std::max(*here.begin(), 1U) - 1;
  std::uint32_t next = *here.begin();
  for (const std::uint32_t number : here) {
    for (; next < number && absent.between.size() < kMostAbsent; ++next) {
      absent.between.push_back(next);
    }
    next = number + 1;
  }
  const PartHead& newest = impl_->parts.back();
  const bool last = newest.row.number == *here.rbegin();
  for (const Session& session : newest.sessions) {
    if (last && is_closed(newest) && session.t_end_us == 0) {
      absent.cut_off = session.id;
    }
  }
  return absent;
}

std::optional<Event> LogReader::last_removal() const {
  std::optional<Event> last;
  for (auto part = impl_->parts.rbegin(); part != impl_->parts.rend() && !last; ++part) {
    last = last_removal_in(part->path);
  }
  return last;
}

std::vector<LogReader::PartInfo> LogReader::parts() const {
  std::vector<PartInfo> out;
  for (const PartHead& head : impl_->parts) {
    PartInfo info{head.path, head.row.number, head.file_bytes, head.row.closed && head.checkpointed, 0, 0};
    bool any = false;
    for (const auto& [key, count] : head.counts) {
      if (count.stored > 0) {
        info.first_us = any ? std::min(info.first_us, count.first_us) : count.first_us;
        info.last_us = any ? std::max(info.last_us, count.last_us) : count.last_us;
        any = true;
      }
    }
    out.push_back(info);
  }
  return out;
}

/// Of no source yet.
ColumnQuery LogReader::Impl::query_of(RobotId robot, Window window) {
  ColumnQuery query{{robot, {}, window}, {}, &decoders, &blocks, {}, {}, {}};
  query.stream_of = [this](const AnswerMeta& meta) -> const Stream& { return stream_of(meta); };
  return query;
}

/// Lets the gates know the inputs of the time before a window, on which the first registers in it depend.
void LogReader::Impl::lead_in(RobotId robot, Window window, InputGates& gates) {
  Micros lead_us = 0;
  for (const auto& [key, stream] : streams) {
    const bool inputs = key.robot == robot && key.source == Source::inputs;
    lead_us = inputs ? std::max(lead_us, kLeadPeriods * stream.period_us + kLeadUs) : lead_us;
  }
  if (gates.flags().none() || lead_us == 0 || window.from_us < Window{}.from_us + lead_us) {
    return;
  }
  const Window before{window.from_us - lead_us, window.from_us};
  ColumnQuery query = query_of(robot, before);
  query.answers.sources[static_cast<std::size_t>(Source::inputs)] = true;
  query.wanted[static_cast<std::size_t>(Source::inputs)] = gates.flags();
  each_part([&](const PartHead& head) {
    if (!PartReader::has_answers(head, query.answers)) {
      return;
    }
    PartReader& part = kept_reader(head);
    const PartReader::Transaction reading(part);
    const std::vector<Gap> gap_rows = part.gaps(robot, before);
    gates.begin_part(gap_rows);
    part.columns(query, [&](ColumnScan& scan) {
      for (Chunk chunk; scan.next(Source::inputs, std::numeric_limits<std::int64_t>::max(), chunk);) {
        gates.inputs(chunk.session, chunk.batch, chunk.place, 0, chunk.place.size());
      }
    });
    gates.catch_up();
  });
}

void LogReader::read(RobotId robot, Window window, const Selection& selection,
                     const std::function<void(const Slice&)>& yield) {
  InputGates gates(selection.fields[static_cast<std::size_t>(Source::registers)]);
  ColumnQuery query = impl_->query_of(robot, window);
  query.wanted = selection.fields;
  query.wanted[static_cast<std::size_t>(Source::inputs)] |= gates.flags();
  for (std::size_t s = 0; s < kSourceCount; ++s) {
    query.answers.sources[s] = selection.rows[s] || query.wanted[s].any();
  }
  impl_->lead_in(robot, window, gates);
  Slicer slicer(robot, selection, gates, yield);
  const bool records = selection.records || gates.needed();
  impl_->each_part([&](const PartHead& head) {
    const bool rows = PartReader::has_answers(head, query.answers);
    if (!rows && !records) {
      return;
    }
    PartReader& part = impl_->kept_reader(head);
    const PartReader::Transaction reading(part);
    if (records && part.touches(window)) {
      std::vector<Gap> gap_rows = part.gaps(robot, window);
      gates.begin_part(gap_rows);
      if (selection.records) {
        slicer.begin_part({std::move(gap_rows), part.events(robot, window), part.clock(robot, window)});
      }
    }
    try {
      part.columns(query, [&](ColumnScan& scan) { slicer.rows(scan); });
    } catch (const SqliteError& error) {
      impl_->problem(head.path.string(), error.what());
    }
    slicer.end_part();
  });
}

void LogReader::read_raw(RobotId robot, Source source, Window window, const std::function<void(const Answer&)>& yield) {
  AnswerQuery query{robot, {}, window};
  query.sources[static_cast<std::size_t>(source)] = true;
  OrderGuard order;
  impl_->each_part([&](const PartHead& head) {
    impl_->read_carefully(head, [&](PartReader& part) {
      part.answers(query, [&](const Answer& answer) {
        if (order.accepts(answer.meta)) {
          yield(answer);
        } else {
          impl_->problem(head.path.string(), kOutOfOrder);
        }
      });
    });
  });
}

void LogReader::check_pages(std::size_t part) {
  const PartHead& head = impl_->parts[part];
  try {
    Connection connection = open_part_for_reading(head.path);
    if (const std::string answer = connection.scalar("PRAGMA quick_check(1)"); answer != "ok") {
      impl_->problem(head.path.string(), "its pages are not sound: " + answer);
    }
  } catch (const SqliteError& error) {
    impl_->problem(head.path.string(), error.what());
  }
}

LogReader::Records LogReader::part_records(std::size_t part, RobotId robot) {
  Records out;
  const PartHead& head = impl_->parts[part];
  try {
    impl_->read_carefully(head, [&](PartReader& reader) {
      out.gaps = reader.gaps(robot, Window{});
      out.events = reader.events(robot, Window{});
      out.clock = reader.clock(robot, Window{});
    });
    std::erase_if(out.clock, [&](const ClockPoint& point) { return point.robot != robot; });
  } catch (const SqliteError& error) {
    impl_->problem(head.path.string(), std::string(error.what()) + "; the rest of this part is left out");
  }
  return out;
}

std::set<SessionId> LogReader::part_sessions(std::size_t part) const {
  std::set<SessionId> sessions;
  for (const auto& [key, count] : impl_->parts[part].counts) {
    sessions.insert(key.session);
  }
  return sessions;
}

void LogReader::part_answers(std::size_t part, RobotId robot, std::optional<SessionId> session,
                             const std::function<void(const Answer&)>& yield) {
  const PartHead& head = impl_->parts[part];
  AnswerQuery query{robot, {}, Window{}, session};
  query.sources.fill(true);
  try {
    impl_->read_carefully(head, [&](PartReader& reader) { reader.answers(query, yield); });
  } catch (const SqliteError& error) {
    impl_->problem(head.path.string(), std::string(error.what()) + "; the rest of this part is left out");
  }
}

std::uint64_t LogReader::first_poll(const Stream& stream) const {
  const auto found = impl_->first_seq.find({stream.session, stream.robot, stream.source});
  return found == impl_->first_seq.end() ? 0 : found->second;
}

Manifest LogReader::part_manifest(std::size_t part) {
  const PartHead& head = impl_->parts[part];
  try {
    Manifest rows;
    impl_->read_carefully(head, [&](PartReader& reader) { rows = reader.manifest(); });
    return rows;
  } catch (const SqliteError& error) {
    impl_->problem(head.path.string(), std::string(error.what()) + "; its manifest is left out");
    return {};
  }
}

std::size_t LogReader::rollup_portions() const { return impl_->parts.size(); }

std::vector<Rollup> LogReader::rollups(RobotId robot, std::size_t portion) {
  const PartHead& head = impl_->parts[portion];
  try {
    std::vector<Rollup> rows;
    impl_->read_carefully(head, [&](PartReader& part) { rows = part.rollups(robot); });
    return rows;
  } catch (const SqliteError& error) {
    impl_->problem(head.path.string(), std::string(error.what()) + "; its rollups are left out");
    return {};
  }
}

}  // namespace tacho::store
