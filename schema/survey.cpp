#include "schema/survey.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <set>
#include <string_view>

#include "schema/events.hpp"
#include "schema/log.hpp"
#include "schema/rollup_check.hpp"
#include "schema/store/fnv.hpp"
#include "schema/time.hpp"

namespace tacho {

namespace {

constexpr std::size_t kFewDifferences = 5;

std::uint64_t hash_of(std::string_view text) { return store::Fnv().add(text).value(); }

std::string text_of(const Event& e) {
  return fmt::format("robot {} session {} {} poll {}: {} '{}' from '{}' to '{}' at {} to {}, '{}'", e.robot, e.session,
                     source_name(e.source), e.seq, event_kind_name(e.kind), e.subject, e.old_value, e.new_value,
                     e.t_from_us, e.t_us, e.detail);
}

/// Polls from .. to - 1 that are accounted for.
struct Span {
  std::uint64_t from = 0;
  std::uint64_t to = 0;
  Micros t_from_us = 0;
  Micros t_to_us = 0;
};

/// What one robot says about one session, on the way.
struct SessionCheck {
  EventMachine machine;
  Gates gates;
  std::map<std::string, int> differ;  // stored events count up, derived ones down
  /// Why Ingest did not see the same answers in the same state; empty: it did.
  std::string_view obstacle;

  [[nodiscard]] bool exact() const { return obstacle.empty(); }
  void refuse(bool so, std::string_view why) { obstacle = so && exact() ? why : obstacle; }
};

/// What was learnt is what registers were read by from the start.
bool confirms_default(const Event& event) {
  return event.subject.empty() && event.new_value == word_order_name(Stream{}.word_order);
}

struct Lane {
  std::vector<Span> spans;
  std::optional<std::uint64_t> last;
};

class Surveyor {
 public:
  explicit Surveyor(store::LogReader& log) : log_(&log) {
    for (const Stream& stream : log.streams()) {
      streams_[{stream.session, stream.robot, stream.source}] = stream;
    }
    for (const Session& session : log.sessions()) {
      starts_[session.id] = session.t_start_us;
    }
  }

  Survey run() {
    for (std::size_t part = 0; part < log_->parts().size(); ++part) {
      log_->check_pages(part);
    }
    std::vector<RobotId> robots = robots_in(*log_);
    robots.insert(robots.begin(), 0);
    for (const RobotId robot : robots) {
      read(robot);
      finish(robot);
    }
    check_manifests();
    check_summaries();
    return std::move(out_);
  }

 private:
  store::LogReader* log_;
  Survey out_;
  std::map<store::StreamKey, Stream> streams_;
  std::map<SessionId, Micros> starts_;
  // Of the robot that is read now.
  std::map<store::StreamKey, Lane> lanes_;
  std::map<SessionId, SessionCheck> sessions_;
  // Of (robot, source), to be compared with the log's own counts.
  std::map<std::pair<RobotId, Source>, FieldSet> seen_;
  std::vector<store::Manifest> manifests_;  // of each part, made again
  std::size_t part_ = 0;                    // that is read now
  RollupCheck rollups_;                     // of it
  AnswerDecoder decoder_;
  Sample sample_;
  const FieldSet all_ = FieldSet().set();

  void read(RobotId robot) {
    const std::vector<store::LogReader::PartInfo> infos = log_->parts();
    const std::size_t parts = infos.size();
    manifests_.resize(parts);
    std::vector<store::LogReader::Records> records;
    for (std::size_t part = 0; part < parts; ++part) {
      // All of them first: they say which sessions cannot be repeated.
      records.push_back(log_->part_records(part, robot));
      take(records.back());
    }
    for (std::size_t part = 0; part < parts && robot != 0; ++part) {
      part_ = part;
      log_->part_answers(part, robot, std::nullopt, [this](const Answer& answer) { take(answer); });
      std::vector<Rollup> stored = log_->rollups(robot, part);
      if (!infos[part].closed || !log_->problems().empty()) {
        stored.clear();  // it has answers that are in no rollup yet, or rollups of answers that are damaged
      }
      const std::vector<std::string> wrong = rollups_.compare(stored);
      out_.wrong_rollups += wrong.size();
      for (std::size_t i = 0; i < wrong.size() && out_.first_rollups.size() < kFewDifferences; ++i) {
        out_.first_rollups.push_back(wrong[i]);
      }
    }
  }

  void take(const store::LogReader::Records& records) {
    for (const Gap& gap : records.gaps) {
      out_.gaps.add(row_hash(gap));
      if (gap.partial || gap.seq_count == 0) {
        continue;
      }
      const store::StreamKey key{gap.session, gap.robot, gap.source};
      out_.streams[key].missed += gap.seq_count;
      lanes_[key].spans.push_back({gap.seq_from, gap.seq_from + gap.seq_count, gap.t_from_us, gap.t_to_us});
      // Where the disk failed the machine knew more than the log, as before damage; a gap of the inputs empties the
      // gates at a moment that is not on record.
      SessionCheck& session = sessions_[gap.session];
      session.refuse(gap.cause == Cause::disk || gap.cause == Cause::damaged, "answers were lost on the disk");
      session.refuse(gap.source == Source::inputs, "inputs, by which registers are read, have a gap");
    }
    for (const Event& event : records.events) {
      out_.events.add(row_hash(event));
      SessionCheck& session = sessions_[event.session];
      session.refuse(event.kind == EventKind::word_order && !confirms_default(event),
                     "the word order of registers was learnt on the way");
      if (derived_from_answers(event.kind)) {
        count(session, text_of(event), 1);
      }
    }
    for (const ClockPoint& point : records.clock) {
      out_.clock.add(row_hash(point));
    }
  }

  void take(const Answer& answer) {
    const AnswerMeta& meta = answer.meta;
    const store::StreamKey key{meta.session, meta.robot, meta.source};
    StreamSurvey& stream = out_.streams[key];
    Lane& lane = lanes_[key];
    const store::ManifestKey hour = store::manifest_key(meta);
    const std::uint64_t hash = store::row_hash(answer);
    out_.hours[hour].add(hash);
    manifests_[part_][hour].add(hash);
    ++stream.stored;
    stream.bytes += answer.body.size();
    if (lane.last && meta.seq <= *lane.last) {
      ++stream.disordered;
    }
    lane.last = std::max(lane.last.value_or(0), meta.seq);
    if (!lane.spans.empty() && lane.spans.back().to == meta.seq) {
      lane.spans.back().to = meta.seq + 1;
      lane.spans.back().t_to_us = meta.t_send_us;
    } else {
      lane.spans.push_back({meta.seq, meta.seq + 1, meta.t_send_us, meta.t_send_us});
    }
    SessionCheck& session = sessions_[meta.session];
    decoder_.decode(answer, streams_[key].word_order, all_, true, session.gates, sample_);
    stream.undecodable += sample_.decodable ? 0 : 1;
    seen_[{meta.robot, meta.source}] |= sample_.seen();
    rollups_.add(sample_);
    if (session.exact()) {
      session.machine.step(sample_, [&](const Event& event) {
        ++out_.event_check.derived;
        count(session, text_of(event), -1);
      });
    }
  }

  static void count(SessionCheck& session, std::string text, int step) {
    const auto found = session.differ.try_emplace(std::move(text), 0).first;
    found->second += step;
    if (found->second == 0) {
      session.differ.erase(found);
    }
  }

  /// Accounts for every planned poll of the robot and compares its events.
  void finish(RobotId robot) {
    for (const auto& [key, stream] : streams_) {
      if (key.robot == robot) {
        lanes_[key];
      }
    }
    for (auto& [key, lane] : lanes_) {
      account(key, lane);
    }
    for (auto& [id, session] : sessions_) {
      if (robot != 0) {
        compare(session);
      }
    }
    lanes_.clear();
    sessions_.clear();
  }

  void account(const store::StreamKey& key, Lane& lane) {
    StreamSurvey& stream = out_.streams[key];
    const auto known = streams_.find(key);
    stream.first = known == streams_.end() ? 0 : log_->first_poll(known->second);
    std::sort(lane.spans.begin(), lane.spans.end(), [](const Span& a, const Span& b) { return a.from < b.from; });
    stream.from = lane.spans.empty() ? stream.first : std::min(stream.first, lane.spans.front().from);
    std::uint64_t next = stream.from;
    Micros t_us = starts_[key.session];
    for (const Span& span : lane.spans) {
      if (span.from > next) {
        stream.holes.push_back({next, span.from - next, std::min(t_us, span.t_from_us), span.t_from_us});
      }
      stream.beyond += std::min(span.to, std::max(span.from, stream.first)) - span.from;
      stream.doubled += std::min(next, span.to) - std::min(next, span.from);
      if (span.to > next) {
        next = span.to;
        t_us = span.t_to_us;
      }
    }
    const std::uint64_t end = known == streams_.end() ? next : known->second.planned.value_or(next);
    if (end > next) {
      const Micros period = known->second.period_us;
      stream.holes.push_back({next, end - next, t_us, t_us + static_cast<Micros>(end - next) * period});
    }
    stream.to = std::max(next, end);
    stream.beyond += next - std::min(next, end);
    stream.planned = end - std::min(end, stream.first);
    SessionCheck& session = sessions_[key.session];
    session.refuse(stream.first != 0, "its beginning is not here");
    session.refuse(!stream.holes.empty() || stream.disordered > 0, "polls are missing or out of order");
  }

  void compare(const SessionCheck& session) {
    EventCheck& check = out_.event_check;
    if (!session.exact()) {
      ++check.left_out[session.obstacle];
      return;
    }
    ++check.sessions;
    for (const auto& [text, n] : session.differ) {
      (n > 0 ? check.only_stored : check.only_derived) += static_cast<std::uint64_t>(std::abs(n));
      if (check.first.size() < kFewDifferences) {
        check.first.push_back((n > 0 ? "stored, not derived: " : "derived, not stored: ") + text);
      }
    }
  }

  /// What came, as the recorder summed it up before it was packed. Of a part that is still written some of it is in no
  /// manifest yet; damage has been told of.
  void check_manifests() {
    const std::vector<store::LogReader::PartInfo> infos = log_->parts();
    for (std::size_t part = 0; part < infos.size(); ++part) {
      const store::Manifest written = log_->part_manifest(part);
      if (!infos[part].closed || written.empty() || !log_->problems().empty()) {
        continue;
      }
      store::Manifest keys = manifests_[part];
      keys.insert(written.begin(), written.end());
      for (const auto& [key, any] : keys) {
        compare(infos[part].path.filename().string(), key, written, manifests_[part]);
      }
    }
  }

  void compare(const std::string& part, const store::ManifestKey& key, const store::Manifest& written,
               const store::Manifest& read) {
    const auto of = [&](const store::Manifest& manifest) {
      const auto found = manifest.find(key);
      return found == manifest.end() ? store::RowSum{} : found->second;
    };
    if (of(written) == of(read)) {
      return;
    }
    ++out_.wrong_hours;
    if (out_.first_hours.size() < kFewDifferences) {
      const auto& [robot, source, hour_us] = key;
      out_.first_hours.push_back(fmt::format("{}: robot {} {} from {}: {} answers came, {} are read{}", part, robot,
                                             source_name(source), iso_utc(hour_us), of(written).rows, of(read).rows,
                                             of(written).rows == of(read).rows ? ", but not the same" : ""));
    }
  }

  /// What `info` says without opening a body.
  void check_summaries() {
    for (const Coverage& c : log_->coverage()) {
      Coverage here;
      for (const auto& [key, stream] : out_.streams) {
        if (key.robot == c.robot && key.source == c.source) {
          here.stored += stream.stored;
          here.missed += stream.missed;
          here.bytes += stream.bytes;
          here.undecodable += stream.undecodable;
        }
      }
      const auto tell = [&](const char* what, std::uint64_t said, std::uint64_t found) {
        if (said != found) {
          out_.wrong_summaries.push_back(fmt::format("robot {} {}: the summary says {} {}, there are {}", c.robot,
                                                     source_name(c.source), said, what, found));
        }
      };
      tell("stored answers", c.stored, here.stored);
      tell("missed polls", c.missed, here.missed);
      tell("bytes", c.bytes, here.bytes);
      tell("undecodable answers", c.undecodable, here.undecodable);
      tell("fields seen", c.seen.count(), seen_[{c.robot, c.source}].count());
    }
  }
};

}  // namespace

std::uint64_t row_hash(const Gap& g) {
  return hash_of(fmt::format("{} {} {} {} {} {} {} {} {} {}", g.robot, source_name(g.source), g.session, g.seq_from,
                             g.seq_count, g.t_from_us, g.t_to_us, cause_name(g.cause), g.partial, g.detail));
}

std::uint64_t row_hash(const Event& event) { return hash_of(text_of(event)); }

std::uint64_t row_hash(const ClockPoint& p) {
  return hash_of(fmt::format("{} {} {} {} {}", p.robot, p.session, p.wall_us, p.mono_us,
                             p.robot_us ? fmt::format("{}", *p.robot_us) : "-"));
}

std::vector<RobotId> robots_in(const store::LogReader& log) {
  std::set<RobotId> ids;
  for (const Robot& robot : log.robots()) {
    ids.insert(robot.id);
  }
  for (const Stream& stream : log.streams()) {
    ids.insert(stream.robot);
  }
  for (const Coverage& coverage : log.coverage()) {
    ids.insert(coverage.robot);
  }
  return {ids.begin(), ids.end()};
}

Survey survey(store::LogReader& log) { return Surveyor(log).run(); }

}  // namespace tacho
