#include "schema/store/coverage.hpp"

#include <algorithm>

#include "schema/store/hot_scan.hpp"
#include "schema/store/schema_sql.hpp"

namespace tacho::store {

void StreamCount::add(const AnswerMeta& meta, std::uint64_t length) {
  first_us = stored == 0 ? meta.t_send_us : std::min(first_us, meta.t_send_us);
  last_us = stored == 0 ? meta.t_send_us : std::max(last_us, meta.t_send_us);
  ++stored;
  bytes += length;
  next_seq = std::max(next_seq, meta.seq + 1);
}

void write(Statement& replace, const StreamKey& key, const StreamCount& c) {
  const std::string seen = pack_fields(c.seen);
  const std::string valued = pack_fields(c.valued);
  replace.run(key.session, key.robot, source_name(key.source), c.stored, c.bytes, c.undecodable, c.first_us, c.last_us,
              c.next_seq, Statement::Blob{seen}, Statement::Blob{valued});
}

GapReading read_gap_counts(Connection& connection) {
  GapReading reading;
  Statement row(connection, select_sql("gap"));
  while (row.step()) {
    ++reading.rows;
    const std::optional<Gap> gap = read_gap(row);
    if (!gap) {
      ++reading.bad;
      continue;
    }
    GapCount& count = reading.counts[{gap->session, gap->robot, gap->source}];
    count.last_us = std::max(count.last_us, gap->t_to_us);
    count.sums.add(*gap);
    if (gap->partial) {
      count.partial += gap->seq_count;
    } else {
      count.missed += gap->seq_count;
      count.next_seq = std::max(count.next_seq, gap->seq_count == 0 ? 0 : gap->seq_from + gap->seq_count);
    }
  }
  return reading;
}

StreamCounts read_coverage_rows(Connection& connection, const Vocabulary& vocabulary) {
  StreamCounts counts;
  Statement row(connection, select_sql("coverage"));
  while (row.step()) {
    StreamKey key{static_cast<SessionId>(row.integer(0)), static_cast<RobotId>(row.integer(1)), Source::status};
    if (!parse_source(row.bytes(2), key.source)) {
      continue;
    }
    StreamCount& c = counts[key];
    c.stored = static_cast<std::uint64_t>(row.integer(3));
    c.bytes = static_cast<std::uint64_t>(row.integer(4));
    c.undecodable = static_cast<std::uint64_t>(row.integer(5));
    c.first_us = row.integer(6);
    c.last_us = row.integer(7);
    c.next_seq = static_cast<std::uint64_t>(row.integer(8));
    c.seen = unpack_fields(row.bytes(9), vocabulary);
    c.valued = unpack_fields(row.bytes(10), vocabulary);
  }
  return counts;
}

std::int64_t add_hot_rows(Connection& connection, const Vocabulary& vocabulary, std::int64_t after,
                          StreamCounts& counts) {
  // A damaged row does not tell how many places it has taken, but its own is taken.
  std::int64_t last = std::max(after, connection.integer("SELECT ifnull(max(id), 0) FROM hot"));
  for_each_hot_row(
      connection, vocabulary, after, [&](const HotRow& row, Source source, const std::vector<HotMark>& marks) {
        StreamCount& count = counts[{row.session, row.robot, source}];
        for (const HotMark& mark : marks) {
          count.add({row.robot, source, row.session, mark.seq, mark.t_send_us, mark.t_recv_us}, mark.length);
        }
        last = std::max(last, marks.back().place);
      });
  return last;
}

}  // namespace tacho::store
