#include "schema/store/recovery.hpp"

#include <algorithm>
#include <vector>

#include "schema/store/part_reader.hpp"

namespace tacho::store {

namespace {

/// Polls from .. to - 1 that left a trace, and when.
struct Span {
  std::uint64_t from = 0;
  std::uint64_t to = 0;
  Micros t_from_us = 0;
  Micros t_to_us = 0;
};

/// Stored answers of a stream, runs of consecutive numbers as one span.
std::vector<Span> stored_spans(const StreamKey& key, const PartHead& head) {
  std::vector<Span> spans;
  PartReader part(head, [](const std::string&) {});
  const PartReader::Transaction reading(part);
  AnswerQuery query;
  query.robot = key.robot;
  query.sources[static_cast<std::size_t>(key.source)] = true;
  part.answers(query, [&](const Answer& answer) {
    const AnswerMeta& meta = answer.meta;
    if (meta.session != key.session) {
      return;
    }
    if (!spans.empty() && spans.back().to == meta.seq) {
      spans.back().to = meta.seq + 1;
      spans.back().t_to_us = meta.t_send_us;
    } else {
      spans.push_back({meta.seq, meta.seq + 1, meta.t_send_us, meta.t_send_us});
    }
  });
  return spans;
}

void add_gap_spans(Connection& connection, const StreamKey& key, std::vector<Span>& spans) {
  Statement row(connection,
                "SELECT seq_from, seq_count, t_from_us, t_to_us FROM gap WHERE robot = ?1 AND session = ?2 AND "
                "source = ?3 AND partial = 0 AND seq_count > 0");
  row.query(key.robot, key.session, source_name(key.source));
  while (row.step()) {
    const auto from = static_cast<std::uint64_t>(row.integer(0));
    spans.push_back({from, from + static_cast<std::uint64_t>(row.integer(1)), row.integer(2), row.integer(3)});
  }
}

void fill_holes(PartWriter& part, const StreamKey& key, const PartHead& head, std::uint64_t seq_from, Micros t_start) {
  std::vector<Span> spans = stored_spans(key, head);
  add_gap_spans(part.connection(), key, spans);
  std::sort(spans.begin(), spans.end(), [](const Span& a, const Span& b) { return a.from < b.from; });
  std::uint64_t next = seq_from;
  Micros t = t_start;
  for (const Span& span : spans) {
    if (span.from > next) {
      Gap gap;
      gap.robot = key.robot;
      gap.source = key.source;
      gap.session = key.session;
      gap.seq_from = next;
      gap.seq_count = span.from - next;
      gap.t_from_us = std::min(t, span.t_from_us);
      gap.t_to_us = span.t_from_us;
      gap.cause = Cause::recorder_killed;
      part.put(gap);
    }
    if (span.to > next) {
      next = span.to;
      t = span.t_to_us;
    }
  }
}

void end_stream(PartWriter& part, StreamRow& row, const PartHead& head, Session& session) {
  const StreamKey key{row.stream.session, row.stream.robot, row.stream.source};
  const auto count = head.counts.find(key);
  const auto gaps = head.gaps.find(key);
  const StreamCount stored = count == head.counts.end() ? StreamCount{} : count->second;
  const GapCount missed = gaps == head.gaps.end() ? GapCount{} : gaps->second;
  const std::uint64_t next = std::max({row.seq_from, stored.next_seq, missed.next_seq});
  if (stored.stored + missed.missed != next - row.seq_from) {
    fill_holes(part, key, head, row.seq_from, session.t_start_us);
  }
  row.stream.planned = next;
  part.put(row);
  session.t_end_us = std::max({session.t_end_us, stored.last_us, missed.last_us});
}

}  // namespace

void end_killed_sessions(PartWriter& part, PartHead& head) {
  const bool killed =
      std::any_of(head.sessions.begin(), head.sessions.end(), [](const Session& s) { return s.t_end_us == 0; });
  if (!killed) {
    return;
  }
  part.begin();
  for (Session& session : head.sessions) {
    if (session.t_end_us != 0) {
      continue;
    }
    session.t_end_us = session.t_start_us;
    for (StreamRow& row : head.streams) {
      if (row.stream.session == session.id) {
        end_stream(part, row, head, session);
      }
    }
    part.put(session);
  }
  for (const auto& [key, count] : head.counts) {
    part.put(key, count);
  }
  part.set_counted_to(head.ends.row);
  part.commit();
}

}  // namespace tacho::store
