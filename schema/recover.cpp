#include "schema/recover.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <exception>
#include <iterator>
#include <set>

#include "schema/log.hpp"
#include "schema/store/scavenge.hpp"

namespace tacho {

namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kRowsPerCommit = 2000;
/// Beside the new parts, hidden from readers, gone when all is done.
constexpr const char* kScratchFolder = ".scavenged";

Gap lost_gap(const store::StreamKey& key, const Hole& hole) {
  Gap gap;
  gap.robot = key.robot;
  gap.source = key.source;
  gap.session = key.session;
  gap.seq_from = hole.seq_from;
  gap.seq_count = hole.seq_count;
  gap.t_from_us = hole.t_from_us;
  gap.t_to_us = std::max(hole.t_from_us, hole.t_to_us);
  gap.cause = Cause::damaged;
  return gap;
}

/// Copies part by part, in each session by session and robot by robot: so sessions come one after the other, and only
/// one answer is in memory.
class Copier {
 public:
  Copier(store::LogReader& log, const Survey& found, store::LogWriter& writer, Recovery& out)
      : log_(&log), found_(&found), writer_(&writer), out_(&out), robots_(robots_in(log)), written_(found) {
    for (const auto& [key, stream] : found.streams) {
      for (const Hole& hole : stream.holes) {
        written_.gaps.add(row_hash(lost_gap(key, hole)));
      }
    }
  }

  void run() {
    restore_robots();
    robots_.insert(robots_.begin(), 0);
    const std::vector<store::LogReader::PartInfo> parts = log_->parts();
    for (std::size_t part = 0; part < parts.size(); ++part) {
      go_on_to(parts[part].number);
      std::set<SessionId> sessions = log_->part_sessions(part);
      std::map<RobotId, store::LogReader::Records> records;
      for (const RobotId robot : robots_) {
        records[robot] = log_->part_records(part, robot);
        note_sessions(records[robot], sessions);
      }
      for (const SessionId session : sessions) {
        copy(part, session, records);
      }
    }
    // Sessions that left nothing but their own rows.
    for (const Session& session : log_->sessions()) {
      begin(session.id);
    }
    end();
  }

  /// What the new log must hold.
  [[nodiscard]] const LogSums& written() const { return written_; }

 private:
  store::LogReader* log_;
  const Survey* found_;
  store::LogWriter* writer_;
  Recovery* out_;
  std::vector<RobotId> robots_;
  LogSums written_;
  std::uint32_t part_ = 0;
  SessionId session_ = 0;
  Micros last_us_ = 0;
  std::uint64_t uncommitted_ = 0;
  struct Lane {
    WordOrder order = WordOrder::cdab;
    std::uint64_t next = 0;
    std::size_t hole = 0;
  };
  std::map<store::StreamKey, Lane> lanes_;  // of the open session
  std::map<RobotId, Gates> gates_;
  AnswerDecoder decoder_;
  Sample sample_;
  const FieldSet all_ = FieldSet().set();

  /// Parts that are missing between others are made without rows, so that none seems to be missing in the new log.
  void go_on_to(std::uint32_t number) {
    constexpr std::uint32_t kMostMissing = 1000;  // a damaged number may lie anywhere
    const bool near = part_ != 0 && number - part_ <= kMostMissing;
    for (std::uint32_t next = near ? part_ + 1 : number; next <= number; ++next) {
      writer_->restore_part(next);
    }
    part_ = number;
  }

  void restore_robots() {
    std::map<RobotId, Robot> known;
    for (const Robot& robot : log_->robots()) {
      known[robot.id] = robot;
    }
    for (const RobotId id : robots_) {
      Robot& robot = known[id];
      robot.name = robot.id == 0 ? fmt::format("robot-{}", id) : robot.name;
      robot.id = id;
      writer_->restore(robot);
    }
  }

  static void note_sessions(const store::LogReader::Records& records, std::set<SessionId>& sessions) {
    for (const Gap& gap : records.gaps) {
      sessions.insert(gap.session);
    }
    for (const Event& event : records.events) {
      sessions.insert(event.session);
    }
    for (const ClockPoint& point : records.clock) {
      sessions.insert(point.session);
    }
  }

  /// Goes on to a session, and through those before it. False for one that has been left.
  bool begin(SessionId id) {
    if (id <= session_) {
      return id == session_;
    }
    for (const Session& session : log_->sessions()) {
      if (session.id > session_ && session.id < id) {
        open(session);
      }
    }
    Session next;
    next.id = id;
    for (const Session& session : log_->sessions()) {
      next = session.id == id ? session : next;
    }
    open(next);
    return true;
  }

  void open(const Session& session) {
    end();
    writer_->restore(session);
    session_ = session.id;
    last_us_ = session.t_start_us;
    for (const auto& [key, survey] : found_->streams) {
      if (key.session == session_ && key.robot != 0) {
        declare(key, survey);
      }
    }
  }

  void declare(const store::StreamKey& key, const StreamSurvey& survey) {
    Stream stream;
    stream.session = key.session;
    stream.robot = key.robot;
    stream.source = key.source;
    for (const Stream& known : log_->streams()) {
      const bool same = known.session == key.session && known.robot == key.robot && known.source == key.source;
      stream = same ? known : stream;
    }
    writer_->restore(stream, survey.from);
    writer_->planned(key.robot, key.source, survey.to);
    lanes_[key] = {stream.word_order, survey.from, 0};
  }

  void end() {
    if (session_ == 0) {
      return;
    }
    for (auto& [key, lane] : lanes_) {
      fill(key, lane, ~std::uint64_t{0});
    }
    Session known;
    for (const Session& session : log_->sessions()) {
      known = session.id == session_ ? session : known;
    }
    writer_->end_session(known.t_end_us != 0 ? known.t_end_us : last_us_, known.clean);
    lanes_.clear();
    gates_.clear();
  }

  /// Gap rows for what was lost before poll `seq`.
  void fill(const store::StreamKey& key, Lane& lane, std::uint64_t seq) {
    const std::vector<Hole>& holes = found_->streams.at(key).holes;
    for (; lane.hole < holes.size() && holes[lane.hole].seq_from < seq; ++lane.hole) {
      writer_->add(lost_gap(key, holes[lane.hole]));
      out_->lost += holes[lane.hole].seq_count;
    }
  }

  void copy(std::size_t part, SessionId session, const std::map<RobotId, store::LogReader::Records>& records) {
    const bool open = begin(session);
    for (const auto& [robot, rows] : records) {
      const auto each = [&](const auto& all, store::RowSum& sum) {
        for (const auto& row : all) {
          if (row.session == session && open) {
            writer_->add(row);
          } else if (row.session == session) {
            ++out_->left_out;
            sum.remove(row_hash(row));
          }
        }
      };
      each(rows.gaps, written_.gaps);
      each(rows.events, written_.events);
      each(rows.clock, written_.clock);
      if (robot != 0) {
        log_->part_answers(part, robot, session, [&](const Answer& answer) { take(answer, open); });
      }
    }
    writer_->commit();
  }

  void leave_out(const Answer& answer) {
    ++out_->left_out;
    const auto hour = written_.hours.find(store::manifest_key(answer.meta));
    hour->second.remove(store::row_hash(answer));
    if (hour->second.rows == 0) {
      written_.hours.erase(hour);
    }
  }

  void take(const Answer& answer, bool open) {
    const AnswerMeta& meta = answer.meta;
    const store::StreamKey key{meta.session, meta.robot, meta.source};
    const auto found = lanes_.find(key);
    if (!open || found == lanes_.end() || meta.seq < found->second.next) {
      leave_out(answer);
      return;
    }
    Lane& lane = found->second;
    fill(key, lane, meta.seq);
    Gates& gates = gates_[meta.robot];
    if (meta.source == Source::inputs && meta.seq != lane.next) {
      gates = Gates{};
    }
    decoder_.decode(answer, lane.order, all_, true, gates, sample_);
    writer_->append(answer);
    writer_->note(sample_);
    lane.next = meta.seq + 1;
    last_us_ = std::max(last_us_, meta.t_send_us);
    ++out_->answers;
    if (++uncommitted_ == kRowsPerCommit) {
      uncommitted_ = 0;
      writer_->commit();
    }
  }
};

void compare(const LogSums& before, const LogSums& after, Recovery& out) {
  const auto tell = [&](const char* what, const store::RowSum& read, const store::RowSum& written) {
    if (!(read == written)) {
      out.different.push_back(fmt::format("{}: {} were read, {} are in the new log{}", what, read.rows, written.rows,
                                          read.rows == written.rows ? ", but not the same" : ""));
    }
  };
  tell("gaps", before.gaps, after.gaps);
  tell("events", before.events, after.events);
  tell("clock points", before.clock, after.clock);
  if (before.hours != after.hours) {
    out.different.push_back("the answers are not those that were read");
  }
}

/// The log as it can be read, with what was found in the pages of damaged parts in place of them.
class Salvage {
 public:
  Salvage(std::span<const fs::path> logs, fs::path scratch, Recovery& out)
      : scratch_(std::move(scratch)), out_(&out), files_(store::LogReader::files(logs)) {
    std::set<fs::path> tried;
    for (std::set<fs::path> damaged = look(tried); !damaged.empty(); damaged = look(tried)) {
      tried.insert(damaged.begin(), damaged.end());
      replace(damaged);
    }
    if (!log_) {
      std::rethrow_exception(error_);
    }
  }
  store::LogReader& log() { return dynamic_cast<store::LogReader&>(*log_); }
  [[nodiscard]] const Survey& found() const { return found_; }

 private:
  fs::path scratch_;
  Recovery* out_;
  std::vector<fs::path> files_;
  std::set<fs::path> replacements_;
  std::unique_ptr<RowSource> log_;
  std::exception_ptr error_;  // why there is no log_
  Survey found_;

  /// Damaged files that have not been tried yet.
  std::set<fs::path> look(const std::set<fs::path>& tried) {
    std::set<fs::path> damaged;
    const auto met = [&](const ReadProblem& problem) {
      if (tried.count(problem.where) == 0 && replacements_.count(problem.where) == 0) {
        out_->problems.push_back(told(problem));
        if (!problem.beside) {
          damaged.insert(problem.where);
        }
      }
    };
    log_.reset();
    try {
      log_ = open_log(files_);
      found_ = survey(log());
      const std::vector<ReadProblem> problems = log_->problems();
      std::for_each(problems.begin(), problems.end(), met);
    } catch (const Error&) {
      log_.reset();
      error_ = std::current_exception();
      look_at_each(met);
    }
    return damaged;
  }

  /// What a reader leaves out is not left out here.
  static ReadProblem told(ReadProblem problem) {
    if (const std::size_t end = problem.what.rfind(store::kSkipped); !problem.beside && end != std::string::npos) {
      problem.what.replace(end, std::string::npos, "; its rows are looked for in its pages");
    }
    return problem;
  }

  /// The whole cannot be opened: which of its files cannot?
  template <class Met>
  void look_at_each(Met met) const {
    for (const fs::path& file : files_) {
      try {
        open_log(std::vector<fs::path>{file});
      } catch (const Error& error) {
        if (store::may_be_part(file)) {
          met(ReadProblem{file.string(), error.what()});
        }
      }
    }
  }

  void replace(const std::set<fs::path>& damaged) {
    log_.reset();
    std::vector<fs::path> whole;
    std::copy_if(files_.begin(), files_.end(), std::back_inserter(whole),
                 [&](const fs::path& file) { return damaged.count(file) == 0 && replacements_.count(file) == 0; });
    for (fs::path& file : files_) {
      if (damaged.count(file) == 0) {
        continue;
      }
      const store::Scavenged found = store::scavenge(file, whole, scratch_);
      out_->whole = out_->whole && found.whole;
      for (const std::string& note : found.notes) {
        out_->notes.push_back({file.string(), note});
      }
      if (!found.part.empty()) {
        file = fs::canonical(found.part);
        replacements_.insert(file);
      }
    }
  }
};

/// A folder inside the new log that is gone when this is, and the new log with it where nothing was written.
class Scratch {
 public:
  explicit Scratch(const fs::path& log) : log_(log), folder_(log / kScratchFolder) {
    std::error_code error;
    fs::create_directories(folder_, error);
    if (error) {
      throw Error(log.string(), error.message(), "choose a folder that this user may write to");
    }
  }
  ~Scratch() {
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
    fs::remove(log_, ignored);  // refuses a folder that is not empty
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  [[nodiscard]] const fs::path& folder() const { return folder_; }

 private:
  fs::path log_;
  fs::path folder_;
};

}  // namespace

Recovery recover(std::span<const fs::path> logs, const fs::path& folder) {
  std::error_code error;
  if (fs::exists(folder, error) && !fs::is_empty(folder, error)) {
    throw Error(folder.string(), "is not an empty folder", "give a new folder: nothing is overwritten");
  }
  Recovery out;
  LogSums written;
  const Scratch scratch(folder);
  Salvage salvage(logs, scratch.folder(), out);
  {
    store::WriterOptions options;
    options.decode = answer_decode();
    options.part_bytes = ~std::uint64_t{0};  // parts end where they ended
    options.part_per_day = false;
    options.first_part = salvage.log().parts().front().number;
    store::LogWriter writer(folder, options);
    Copier copier(salvage.log(), salvage.found(), writer, out);
    copier.run();
    written = copier.written();
  }
  const std::vector<fs::path> paths{folder};
  const auto again = open_log(paths);
  auto& reader = dynamic_cast<store::LogReader&>(*again);
  compare(written, survey(reader), out);
  for (const ReadProblem& problem : reader.problems()) {
    out.different.push_back(problem.where + ": " + problem.what);
  }
  return out;
}

}  // namespace tacho
