#include "schema/store/rows.hpp"

#include <bit>

#include "schema/store/checksum.hpp"

namespace tacho::store {

namespace {

// Widened once here: ids of any width take part in a checksum as 64-bit numbers.
template <class Number>
std::int64_t wide(Number value) {
  return static_cast<std::int64_t>(value);
}

std::int64_t checksum(const Gap& g) {
  return Checksum()
      .add(wide(g.robot))
      .add(source_name(g.source))
      .add(wide(g.session))
      .add(wide(g.seq_from))
      .add(wide(g.seq_count))
      .add(g.t_from_us)
      .add(g.t_to_us)
      .add(cause_name(g.cause))
      .add(wide(g.partial))
      .add(std::string_view(g.detail))
      .value();
}

std::int64_t checksum(const BlockRow& b) {
  return Checksum()
      .add(wide(b.robot))
      .add(b.source)
      .add(wide(b.session))
      .add(wide(b.seq_from))
      .add(wide(b.seq_to))
      .add(b.row_from)
      .add(b.row_to)
      .add(b.t_from_us)
      .add(b.t_to_us)
      .add(wide(b.rows))
      .value();
}

std::int64_t checksum(const Event& e) {
  return Checksum()
      .add(wide(e.robot))
      .add(source_name(e.source))
      .add(wide(e.session))
      .add(event_kind_name(e.kind))
      .add(wide(e.seq))
      .add(e.t_from_us)
      .add(e.t_us)
      .add(std::string_view(e.subject))
      .add(std::string_view(e.old_value))
      .add(std::string_view(e.new_value))
      .add(std::string_view(e.detail))
      .value();
}

std::int64_t checksum(const ClockPoint& c) {
  return Checksum()
      .add(wide(c.robot))
      .add(wide(c.session))
      .add(c.wall_us)
      .add(c.mono_us)
      .add(wide(c.robot_us.has_value()))
      .add(c.robot_us.value_or(0))
      .value();
}

std::int64_t checksum(const Rollup& r, std::int64_t source, std::int64_t field) {
  Checksum sum;
  sum.add(wide(r.robot)).add(source).add(r.minute).add(field).add(wide(r.rows));
  for (const double value : {r.min, r.max, r.sum, r.last}) {
    sum.add(std::bit_cast<std::int64_t>(value + 0.0));  // SQLite keeps no negative zero
  }
  return sum.value();
}

}  // namespace

std::int64_t checksum(const HotRow& row) {
  return Checksum()
      .add(row.id)
      .add(wide(row.robot))
      .add(row.source)
      .add(wide(row.session))
      .add(wide(row.seq))
      .add(row.t_send_us)
      .add(row.base)
      .add(wide(row.rows))
      .add(row.data)
      .value();
}

std::optional<Source> source_of(const HotRow& row, const Vocabulary& vocabulary) {
  const auto number = static_cast<std::uint64_t>(row.source);
  return number < vocabulary.source.size() ? vocabulary.source[static_cast<std::size_t>(number)] : std::nullopt;
}

void write(Statement& insert, const Robot& r) {
  insert.run(r.id, r.name, r.address, r.vehicle_id, r.mac, r.model_md5, r.firmware);
}

void write(Statement& insert, const Session& s) {
  const std::optional<Micros> t_end = s.t_end_us == 0 ? std::nullopt : std::optional(s.t_end_us);
  insert.run(s.id, s.t_start_us, t_end, s.clean, s.software, s.config, s.host);
}

void write(Statement& insert, const StreamRow& row) {
  const Stream& s = row.stream;
  insert.run(s.session, s.robot, source_name(s.source), s.period_us, word_order_name(s.word_order), s.request,
             row.seq_from, s.planned);
}

void write(Statement& insert, const HotRow& row) {
  const std::optional<std::int64_t> base = row.base == 0 ? std::nullopt : std::optional(row.base);
  insert.run(row.id, row.robot, row.source, row.session, row.seq, row.t_send_us, base, row.rows, checksum(row),
             Statement::Blob{row.data});
}

void write(Statement& insert, const BlockRow& b) {
  insert.run(std::nullopt, b.robot, b.source, b.session, b.seq_from, b.seq_to, b.row_from, b.row_to, b.t_from_us,
             b.t_to_us, b.rows, checksum(b), Statement::Blob{b.data});
}

void write(Statement& insert, const Gap& g) {
  insert.run(std::nullopt, g.robot, source_name(g.source), g.session, g.seq_from, g.seq_count, g.t_from_us, g.t_to_us,
             cause_name(g.cause), g.partial, g.detail, checksum(g));
}

void write(Statement& insert, const Event& e) {
  insert.run(std::nullopt, e.robot, source_name(e.source), e.session, event_kind_name(e.kind), e.seq, e.t_from_us,
             e.t_us, e.subject, e.old_value, e.new_value, e.detail, checksum(e));
}

void write(Statement& insert, const ClockPoint& c) {
  insert.run(std::nullopt, c.robot, c.session, c.wall_us, c.mono_us, c.robot_us, checksum(c));
}

void write(Statement& insert, const Rollup& r, std::int64_t source, std::int64_t field) {
  insert.run(r.robot, source, r.minute, field, r.rows, r.min, r.max, r.sum, r.last, checksum(r, source, field));
}

Robot read_robot(const Statement& row) {
  return {static_cast<RobotId>(row.integer(0)),
          row.text(1),
          row.text(2),
          row.text(3),
          row.text(4),
          row.text(5),
          row.text(6)};
}

Session read_session(const Statement& row) {
  return {static_cast<SessionId>(row.integer(0)),
          row.integer(1),
          row.integer(2),
          row.integer(3) != 0,
          row.text(4),
          row.text(5),
          row.text(6)};
}

std::optional<StreamRow> read_stream(const Statement& row) {
  StreamRow out;
  Stream& s = out.stream;
  s.session = static_cast<SessionId>(row.integer(0));
  s.robot = static_cast<RobotId>(row.integer(1));
  if (!parse_source(row.bytes(2), s.source) || !parse_word_order(row.bytes(4), s.word_order)) {
    return std::nullopt;
  }
  s.period_us = row.integer(3);
  s.request = row.text(5);
  out.seq_from = static_cast<std::uint64_t>(row.integer(6));
  if (!row.null(7)) {
    s.planned = static_cast<std::uint64_t>(row.integer(7));
  }
  return out;
}

HotRow read_hot(const Statement& row) {
  HotRow out;
  out.id = row.integer(0);
  out.robot = static_cast<RobotId>(row.integer(1));
  out.source = row.integer(2);
  out.session = static_cast<SessionId>(row.integer(3));
  out.seq = static_cast<std::uint64_t>(row.integer(4));
  out.t_send_us = row.integer(5);
  out.base = row.integer(6);
  out.rows = static_cast<std::uint64_t>(row.integer(7));
  out.crc = row.integer(8);
  out.data = row.bytes(9);
  return out;
}

std::optional<BlockRow> read_block_place(const Statement& row) {
  BlockRow b;
  b.id = row.integer(0);
  b.robot = static_cast<RobotId>(row.integer(1));
  b.source = row.integer(2);
  b.session = static_cast<SessionId>(row.integer(3));
  b.seq_from = static_cast<std::uint64_t>(row.integer(4));
  b.seq_to = static_cast<std::uint64_t>(row.integer(5));
  b.row_from = row.integer(6);
  b.row_to = row.integer(7);
  b.t_from_us = row.integer(8);
  b.t_to_us = row.integer(9);
  b.rows = static_cast<std::uint64_t>(row.integer(10));
  return checksum(b) == row.integer(11) ? std::optional(b) : std::nullopt;
}

std::optional<Gap> read_gap(const Statement& row) {
  Gap g;
  g.robot = static_cast<RobotId>(row.integer(1));
  g.session = static_cast<SessionId>(row.integer(3));
  g.seq_from = static_cast<std::uint64_t>(row.integer(4));
  g.seq_count = static_cast<std::uint64_t>(row.integer(5));
  g.t_from_us = row.integer(6);
  g.t_to_us = row.integer(7);
  const std::optional<Cause> cause = parse_cause(row.bytes(8));
  g.partial = row.integer(9) != 0;
  g.detail = row.text(10);
  if (!cause || !parse_source(row.bytes(2), g.source)) {
    return std::nullopt;
  }
  g.cause = *cause;
  return checksum(g) == row.integer(11) ? std::optional(g) : std::nullopt;
}

std::optional<Event> read_event(const Statement& row) {
  Event e;
  e.robot = static_cast<RobotId>(row.integer(1));
  e.session = static_cast<SessionId>(row.integer(3));
  const std::optional<EventKind> kind = parse_event_kind(row.bytes(4));
  e.seq = static_cast<std::uint64_t>(row.integer(5));
  e.t_from_us = row.integer(6);
  e.t_us = row.integer(7);
  e.subject = row.text(8);
  e.old_value = row.text(9);
  e.new_value = row.text(10);
  e.detail = row.text(11);
  if (!kind || !parse_source(row.bytes(2), e.source)) {
    return std::nullopt;
  }
  e.kind = *kind;
  return checksum(e) == row.integer(12) ? std::optional(e) : std::nullopt;
}

std::optional<ClockPoint> read_clock(const Statement& row) {
  ClockPoint c;
  c.robot = static_cast<RobotId>(row.integer(1));
  c.session = static_cast<SessionId>(row.integer(2));
  c.wall_us = row.integer(3);
  c.mono_us = row.integer(4);
  if (!row.null(5)) {
    c.robot_us = row.integer(5);
  }
  return checksum(c) == row.integer(6) ? std::optional(c) : std::nullopt;
}

std::optional<Rollup> read_rollup(const Statement& row, const Vocabulary& vocabulary) {
  Rollup r;
  r.robot = static_cast<RobotId>(row.integer(0));
  const std::int64_t source = row.integer(1);
  r.minute = row.integer(2);
  const std::int64_t field = row.integer(3);
  r.rows = static_cast<std::uint64_t>(row.integer(4));
  r.min = row.real(5);
  r.max = row.real(6);
  r.sum = row.real(7);
  r.last = row.real(8);
  const auto s = static_cast<std::size_t>(source);
  const auto f = static_cast<std::size_t>(field);
  if (checksum(r, source, field) != row.integer(9) || s >= vocabulary.source.size() || !vocabulary.source[s] ||
      f >= vocabulary.field.size()) {
    return std::nullopt;
  }
  r.source = *vocabulary.source[s];
  r.field = vocabulary.field[f];
  return r;
}

}  // namespace tacho::store
