#include "schema/store/scavenge.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <fstream>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "schema/store/block/block_decoder.hpp"
#include "schema/store/hot_scan.hpp"
#include "schema/store/page_scan.hpp"
#include "schema/store/part_head.hpp"
#include "schema/store/schema_sql.hpp"

namespace tacho::store {

namespace {

namespace fs = std::filesystem;

constexpr std::size_t kFileHeader = 100;
/// Of the 32 hexadecimal digits of a log's identity: parts of different logs share some four of them.
constexpr std::size_t kLikeDigits = 24;
constexpr const char* kUnknown = "unknown: this row of the log was damaged";

std::optional<std::uint32_t> number_in_name(const fs::path& path) {
  const std::string name = path.filename().string();
  std::uint32_t number = 0;
  const auto [end, error] =
      std::from_chars(name.data() + std::min<std::size_t>(5, name.size()), name.data() + name.size(), number);
  const bool good = error == std::errc() && name.rfind("part-", 0) == 0 && std::string_view(end) == ".db";
  return good ? std::optional(number) : std::nullopt;
}

/// The rows of one table as they look in a page.
class Shape {
 public:
  Shape(Connection& out, const char* table, const char* on_conflict)
      : name_(table),
        insert_(out, insert_sql(table, on_conflict) + " RETURNING 1"),
        // The values of a record as a row, so that it is read and checked like one of the table itself.
        row_(out, "SELECT " + parameters(out, table)) {
    Statement columns(out, fmt::format("SELECT type, \"notnull\", pk, (SELECT wr FROM pragma_table_list('{0}')) FROM "
                                       "pragma_table_info('{0}') ORDER BY cid",
                                       table));
    while (columns.step()) {
      without_rowid_ = columns.integer(3) != 0;
      const bool rowid = !without_rowid_ && columns.integer(2) != 0 && columns.bytes(0) == "INTEGER";
      columns_.push_back({type_of(columns.bytes(0)), columns.integer(1) == 0, rowid});
    }
  }

  [[nodiscard]] const char* name() const { return name_; }

  [[nodiscard]] bool fits(const RawRecord& record) const {
    const auto fits = [](const Column& column, const RawValue& value) {
      return value.type == RawValue::Type::null ? column.rowid || column.nullable
                                                : !column.rowid && value.type == column.type;
    };
    return record.table != without_rowid_ && record.values.size() == columns_.size() &&
           std::equal(columns_.begin(), columns_.end(), record.values.begin(), fits);
  }

  /// The record as a row of the table; valid until the next call.
  const Statement& row(const RawRecord& record) {
    bind(row_, record, record.rowid);
    row_.step();
    return row_;
  }
  /// False: nothing was inserted, the row id is taken.
  bool insert(const RawRecord& record, std::optional<std::int64_t> rowid) {
    bind(insert_, record, rowid);
    const bool inserted = insert_.step();
    insert_.reset();
    return inserted;
  }

 private:
  struct Column {
    RawValue::Type type;
    bool nullable;
    bool rowid;
  };
  const char* name_;
  bool without_rowid_ = false;
  std::vector<Column> columns_;
  Statement insert_;
  Statement row_;

  static RawValue::Type type_of(std::string_view declared) {
    return declared == "TEXT"   ? RawValue::Type::text
           : declared == "BLOB" ? RawValue::Type::blob
           : declared == "REAL" ? RawValue::Type::real
                                : RawValue::Type::integer;
  }
  static std::string parameters(Connection& out, const char* table) {
    std::string text;
    for (int i = 1; i <= Statement(out, select_sql(table)).columns(); ++i) {
      text += fmt::format("{}?{}", i > 1 ? ", " : "", i);
    }
    return text;
  }
  void bind(Statement& statement, const RawRecord& record, std::optional<std::int64_t> rowid) const {
    statement.reset();
    for (std::size_t i = 0; i < columns_.size(); ++i) {
      const int index = static_cast<int>(i) + 1;
      const RawValue& value = record.values[i];
      if (columns_[i].rowid && rowid) {
        statement.set(index, *rowid);
      } else if (value.type == RawValue::Type::null) {
        statement.set(index, std::nullopt);
      } else if (value.type == RawValue::Type::integer) {
        statement.set(index, value.integer);
      } else if (value.type == RawValue::Type::real) {
        statement.set(index, value.real);
      } else if (value.type == RawValue::Type::text) {
        statement.set(index, value.bytes);
      } else {
        statement.set(index, Statement::Blob{value.bytes});
      }
    }
  }
};

/// What the whole parts of the log say.
struct Known {
  std::string log;
  std::map<RobotId, Robot> robots;
  std::map<SessionId, Session> sessions;
  std::map<StreamKey, StreamRow> streams;
};

StreamKey key_of(const Stream& stream) { return {stream.session, stream.robot, stream.source}; }

Known ask(std::span<const fs::path> parts) {
  Known known;
  for (const fs::path& path : parts) {
    PartHead head;
    try {
      head = read_head(path);
    } catch (const Error&) {
      continue;  // no part
    }
    if (!head.damage.empty()) {
      continue;
    }
    known.log = head.row.log;
    for (const Robot& robot : head.robots) {
      known.robots[robot.id] = robot;
    }
    for (const Session& session : head.sessions) {
      known.sessions[session.id] = session;
    }
    for (const StreamRow& row : head.streams) {
      known.streams[key_of(row.stream)] = row;
    }
  }
  return known;
}

/// What the rows of a part say of one stream.
struct Trace {
  std::uint64_t seq_from = std::numeric_limits<std::uint64_t>::max();
  std::uint64_t seq_to = 0;  ///< after the last
  Micros t_from_us = std::numeric_limits<Micros>::max();
  Micros t_to_us = std::numeric_limits<Micros>::min();
  StreamCount count;
};

Connection scratch(const fs::path& path) {
  fs::remove(path);
  Connection connection(path, OpenMode::create);
  connection.exec("PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF");
  connection.exec(schema_sql());
  // Fingerprints of the records taken so far: a record lies in the file more than once when SQLite has moved it.
  connection.exec("CREATE TEMP TABLE taken (fingerprint INTEGER PRIMARY KEY)");
  return connection;
}

class Rebuild {
 public:
  Rebuild(const fs::path& damaged, const fs::path& target, Known known)
      : damaged_(damaged),
        known_(std::move(known)),
        out_(scratch(target)),
        take_(out_, "INSERT OR IGNORE INTO taken VALUES(?1) RETURNING 1") {
    result_.part = target;
    vocabulary_.source.fill(std::nullopt);
    for (std::size_t i = 0; i < kSourceCount; ++i) {
      vocabulary_.source[i] = static_cast<Source>(i);
    }
  }

  Scavenged run(const fs::path& file) {
    {
      Transaction transaction(out_);
      write_vocabulary(out_);
      collect(file);
      if (rows_ == 0) {
        return {};
      }
      read_seal();
      if (!is_of_this_log()) {
        return {};
      }
      drop_moved_rows();
      drop_bodiless_rows();
      trace();
      mend();
      transaction.commit();
    }
    return std::move(result_);
  }

 private:
  const fs::path& damaged_;
  const Known known_;
  Connection out_;
  Statement take_;
  Vocabulary vocabulary_;
  Scavenged result_;
  std::uint64_t rows_ = 0;
  PartRow part_;
  bool sealed_ = false;
  Seal seal_;
  std::map<StreamKey, Trace> traces_;
  std::map<SessionId, Micros> sessions_;  ///< that left rows -> first time in them
  std::set<RobotId> robots_;              ///< likewise

  void note(std::string text) { result_.notes.push_back(std::move(text)); }
  [[nodiscard]] bool trusted(const char* table) const { return sealed_ ? seal_.damaged.count(table) == 0 : true; }

  void collect(const fs::path& file);
  bool take(std::uint64_t fingerprint);
  void take_record(Shape& shape, const RawRecord& record, PageScan& scan);
  void take_block(Shape& shape, RawRecord record, PageScan& scan);
  void read_seal();
  [[nodiscard]] bool is_newer() const;
  bool is_of_this_log();
  void drop_moved_rows();
  void drop_bodiless_rows();
  void trace();
  void saw(SessionId session, RobotId robot, Micros t_us);
  void mend();
  void mend_sessions();
  void mend_robots();
  void mend_streams();
  template <class Id, class Row, class Made>
  std::map<Id, Row> mended(const char* table, std::map<Id, Row> found, const std::map<Id, Row>& known,
                           const std::set<Id>& used, Made made);
};

bool Rebuild::take(std::uint64_t fingerprint) {
  take_.query(fingerprint);
  const bool fresh = take_.step();
  take_.reset();
  return fresh;
}

void Rebuild::collect(const fs::path& file) {
  using Good = std::function<bool(const Statement&)>;
  struct Table {
    Shape shape;
    Good good;  ///< by checksum
  };
  std::vector<Table> tables;
  const auto with_checksum = [&](const char* name, Good good) {
    tables.push_back({Shape(out_, name, "OR IGNORE"), std::move(good)});
  };
  with_checksum("hot", [this](const Statement& row) {
    const HotRow hot = read_hot(row, vocabulary_);
    return hot.source >= 0 && hot.source < static_cast<std::int64_t>(kSourceCount) && checksum(hot) == hot.crc;
  });
  with_checksum("block", [](const Statement& row) { return read_block_place(row).has_value(); });
  with_checksum("gap", [](const Statement& row) { return read_gap(row).has_value(); });
  with_checksum("event", [](const Statement& row) { return read_event(row).has_value(); });
  with_checksum("clock", [](const Statement& row) { return read_clock(row).has_value(); });
  std::vector<Shape> small;
  for (const char* name : {"part", "robot", "session", "stream", "seal"}) {
    small.emplace_back(out_, name, "OR REPLACE");
  }
  PageScan scan(file);
  scan.records([&](const RawRecord& record) {
    for (Table& table : tables) {
      if (table.shape.fits(record) && table.good(table.shape.row(record))) {
        take_record(table.shape, record, scan);
        return;
      }
    }
    for (Shape& shape : small) {
      if (record.live && shape.fits(record)) {
        shape.insert(record, record.rowid);
        return;
      }
    }
  });
  if (scan.unreadable() > 0) {
    note(fmt::format("{} pages cannot be read from the disk", scan.unreadable()));
  }
}

void Rebuild::take_record(Shape& shape, const RawRecord& record, PageScan& scan) {
  const std::string_view name = shape.name();
  ++rows_;
  if (name == "hot") {  // its checksum covers its id
    shape.insert(record, record.rowid);
    return;
  }
  // Copies that SQLite left behind when it moved rows have the same values; ids of copies may be damaged.
  const std::uint64_t values = std::hash<std::string_view>()(record.payload) ^ std::hash<std::string_view>()(name);
  const std::uint64_t values_and_id = values * 31 + static_cast<std::uint64_t>(record.rowid);
  const bool fresh = take(values);
  if (!take(values_and_id) || (!record.live && !fresh)) {
    return;
  }
  if (name == "block") {
    take_block(shape, record, scan);
  } else if (!shape.insert(record, record.rowid)) {
    shape.insert(record, std::nullopt);
  }
}

/// Of all ways to put the block together the first that is whole, else the first.
void Rebuild::take_block(Shape& shape, RawRecord record, PageScan& scan) {
  BlockDecoder decoder;
  std::vector<std::int64_t> places;
  const auto whole = [&](std::string_view data) {
    return decoder.open(data).empty() && decoder.places(places).empty() &&
           decoder.answers([](std::size_t, const Answer&) {}).empty();
  };
  std::string_view& data = record.values.back().bytes;
  std::string other;
  bool good = whole(data);
  for (std::size_t way = 0; !good; ++way) {
    std::optional<std::string> payload = scan.other_payload(way);
    if (!payload) {
      break;
    }
    if (whole(std::string_view(*payload).substr(payload->size() - data.size()))) {
      other = payload->substr(payload->size() - data.size());
      data = other;
      good = true;
    }
  }
  if (!shape.insert(record, record.rowid)) {
    shape.insert(record, std::nullopt);
  }
}

void Rebuild::read_seal() {
  Statement row(out_, "SELECT count(*) FROM seal");
  sealed_ = row.step() && row.integer(0) > 0;
  row.reset();
  if (sealed_) {
    seal_ = check_seal(out_, true);
  }
  part_ = read_part_row(out_);
  result_.whole = sealed_;
  for (const char* table : {"part", "robot", "session", "stream"}) {
    if (!trusted(table)) {
      note(fmt::format("table {} is damaged; its rows are taken from other parts, or as they were found", table));
      result_.whole = false;
    }
  }
  for (const char* table : {"gap", "event", "clock"}) {
    const std::int64_t found = out_.integer(fmt::format("SELECT count(*) FROM {}", table));
    const auto sealed = seal_.rows.find(table);
    const bool all = sealed != seal_.rows.end() && sealed->second == found;
    result_.whole = result_.whole && all;
    if (sealed != seal_.rows.end() && !all) {
      note(fmt::format("{} rows of table {} were found, but it had {}", found, table, sealed->second));
    }
  }
  if (!sealed_) {
    note("was not closed, or has lost its seal: whether small tables and newest rows are complete cannot be told");
  }
}

/// A header that says so may be damaged, but not when another version wrote the rest of the part too.
bool Rebuild::is_newer() const {
  constexpr std::size_t kVersionAt = 60;
  std::array<unsigned char, kFileHeader> header{};
  std::ifstream(damaged_, std::ios::binary).read(reinterpret_cast<char*>(header.data()), header.size());
  std::int64_t version = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    version = version << 8U | header[kVersionAt + i];
  }
  return version > kSchemaVersion && !part_.software.empty() && part_.software != "tachograph " TACHO_VERSION;
}

bool Rebuild::is_of_this_log() {
  const std::string& mine = part_.log;
  const std::string& other = known_.log;
  std::size_t like = 0;
  for (std::size_t i = 0; i < std::min(mine.size(), other.size()); ++i) {
    like += mine[i] == other[i] ? 1U : 0U;
  }
  if ((!mine.empty() && !other.empty() && like < kLikeDigits) || is_newer()) {
    return false;
  }
  const std::optional<std::uint32_t> name = number_in_name(damaged_);
  const bool believe_row = !mine.empty() && (!name || (sealed_ && trusted("part")));
  part_.number = believe_row ? part_.number : name.value_or(1);
  part_.log = other.empty() ? mine.empty() ? std::string(32, '0') : mine : other;
  return true;
}

/// Hot rows that blocks give back are copies from before they were moved.
void Rebuild::drop_moved_rows() {
  Statement block(out_, "SELECT data FROM block");
  Statement drop(out_, "DELETE FROM hot WHERE id = ?1");
  BlockDecoder decoder;
  std::vector<std::int64_t> places;
  while (out_.integer("SELECT EXISTS (SELECT 1 FROM hot)") != 0 && block.step()) {
    if (decoder.open(block.bytes(0)).empty() && decoder.places(places).empty()) {
      static_cast<void>(decoder.answers([&](std::size_t i, const Answer&) { drop.run(places[i]); }));
    }
  }
  block.reset();
}

/// Hot rows whose chain of bases is broken say nothing.
void Rebuild::drop_bodiless_rows() {
  Statement ids(out_, "SELECT id FROM hot ORDER BY id");
  Statement fetch(out_, select_sql("hot") + " WHERE id = ?1");
  BodyChain chain(out_, vocabulary_);
  std::vector<std::int64_t> lost;
  while (ids.step()) {
    fetch.query(ids.integer(0));
    if (fetch.step() && chain.body(read_hot(fetch, vocabulary_)) == nullptr) {
      lost.push_back(ids.integer(0));
    }
  }
  fetch.reset();
  Statement drop(out_, "DELETE FROM hot WHERE id = ?1");
  for (const std::int64_t id : lost) {
    drop.run(id);
  }
}

void Rebuild::saw(SessionId session, RobotId robot, Micros t_us) {
  const auto known = sessions_.try_emplace(session, t_us).first;
  known->second = std::min(known->second, t_us);
  if (robot != 0) {
    robots_.insert(robot);
  }
}

void Rebuild::trace() {
  const auto polls = [&](const char* sql, bool stored, const auto& source_of) {
    Statement row(out_, sql);
    while (row.step()) {
      StreamKey key{static_cast<SessionId>(row.integer(0)), static_cast<RobotId>(row.integer(1)), Source::status};
      if (!source_of(row, key.source)) {
        continue;
      }
      Trace& trace = traces_[key];
      const auto next = static_cast<std::uint64_t>(row.integer(4)) + 1;
      trace.seq_from = std::min(trace.seq_from, static_cast<std::uint64_t>(row.integer(3)));
      trace.seq_to = std::max(trace.seq_to, next);
      trace.t_from_us = std::min(trace.t_from_us, row.integer(5));
      trace.t_to_us = std::max(trace.t_to_us, row.integer(6));
      saw(key.session, key.robot, row.integer(5));
      if (stored) {
        trace.count.stored += static_cast<std::uint64_t>(row.integer(7));
        trace.count.bytes += static_cast<std::uint64_t>(row.integer(8));
        trace.count.next_seq = std::max(trace.count.next_seq, next);
      }
    }
  };
  const auto by_number = [](const Statement& row, Source& source) {
    source = static_cast<Source>(row.integer(2));
    return row.integer(2) >= 0 && row.integer(2) < static_cast<std::int64_t>(kSourceCount);
  };
  const auto by_name = [](const Statement& row, Source& source) { return parse_source(row.bytes(2), source); };
  polls(
      "SELECT session, robot, source, min(seq_from), max(seq_to), min(t_from_us), max(t_to_us), sum(rows), 0 "
      "FROM block GROUP BY 1, 2, 3",
      true, by_number);
  polls(
      "SELECT session, robot, source, min(seq), max(seq), min(t_send_us), max(t_send_us), count(*), sum(length) "
      "FROM hot GROUP BY 1, 2, 3",
      true, by_number);
  polls(
      "SELECT session, robot, source, min(seq_from), max(seq_from + seq_count - 1), min(t_from_us), max(t_to_us) "
      "FROM gap WHERE partial = 0 AND seq_count > 0 GROUP BY 1, 2, 3",
      false, by_name);
  for (const char* sql : {"SELECT session, robot, min(t_us) FROM event GROUP BY 1, 2",
                          "SELECT session, robot, min(wall_us) FROM clock GROUP BY 1, 2",
                          "SELECT session, robot, min(t_to_us) FROM gap GROUP BY 1, 2"}) {
    Statement row(out_, sql);
    while (row.step()) {
      saw(static_cast<SessionId>(row.integer(0)), static_cast<RobotId>(row.integer(1)), row.integer(2));
    }
  }
}

/// What was found, without what nothing speaks for when the table is damaged, and what is missing.
template <class Id, class Row, class Made>
std::map<Id, Row> Rebuild::mended(const char* table, std::map<Id, Row> found, const std::map<Id, Row>& known,
                                  const std::set<Id>& used, Made made) {
  if (!trusted(table)) {
    std::erase_if(found, [&](const auto& row) { return used.count(row.first) == 0; });
    for (const auto& [id, row] : known) {
      found[id] = row;
    }
  }
  for (const Id& id : used) {
    if (found.count(id) > 0) {
      continue;
    }
    const auto other = known.find(id);
    found[id] = other == known.end() ? made(id) : other->second;
    result_.whole = false;
  }
  return found;
}

void Rebuild::mend_sessions() {
  std::map<SessionId, Session> found;
  Statement row(out_, select_sql("session"));
  while (row.step()) {
    const Session session = read_session(row);
    found[session.id] = session;
  }
  std::set<SessionId> used;
  for (const auto& [id, t_us] : sessions_) {
    used.insert(id);
  }
  const auto made = [&](SessionId id) {
    note(fmt::format("session {}: its row is lost; it begins with the first row that names it", id));
    Session session;
    session.id = id;
    session.t_start_us = sessions_.at(id);
    session.software = session.config = session.host = kUnknown;
    return session;
  };
  out_.exec("DELETE FROM session");
  Statement insert(out_, insert_sql("session"));
  for (const auto& [id, session] : mended<SessionId, Session>("session", found, known_.sessions, used, made)) {
    write(insert, session);
  }
}

void Rebuild::mend_robots() {
  std::map<RobotId, Robot> found;
  Statement row(out_, select_sql("robot"));
  while (row.step()) {
    const Robot robot = read_robot(row);
    found[robot.id] = robot;
  }
  const auto made = [&](RobotId id) {
    note(fmt::format("robot {}: its row is lost; it is called robot-{}", id, id));
    Robot robot;
    robot.id = id;
    robot.name = fmt::format("robot-{}", id);
    return robot;
  };
  out_.exec("DELETE FROM robot");
  Statement insert(out_, insert_sql("robot", "OR REPLACE"));
  for (const auto& [id, robot] : mended<RobotId, Robot>("robot", found, known_.robots, robots_, made)) {
    write(insert, robot);
  }
}

void Rebuild::mend_streams() {
  std::map<StreamKey, StreamRow> found;
  Statement row(out_, select_sql("stream"));
  while (row.step()) {
    if (std::optional<StreamRow> stream = read_stream(row)) {
      found[key_of(stream->stream)] = std::move(*stream);
    }
  }
  std::set<StreamKey> used;
  for (const auto& [key, trace] : traces_) {
    used.insert(key);
  }
  const auto made = [&](const StreamKey& key) {
    const Trace& trace = traces_.at(key);
    note(fmt::format("robot {} {} session {}: the row of the stream is lost; period and order of words are estimated",
                     key.robot, source_name(key.source), key.session));
    StreamRow stream;
    stream.stream.session = key.session;
    stream.stream.robot = key.robot;
    stream.stream.source = key.source;
    const auto steps = static_cast<Micros>(trace.seq_to - trace.seq_from) - 1;
    stream.stream.period_us = steps > 0 ? (trace.t_to_us - trace.t_from_us) / steps : 0;
    return stream;
  };
  out_.exec("DELETE FROM stream");
  Statement insert(out_, insert_sql("stream"));
  const bool trust = trusted("stream");
  for (auto& [key, stream] : mended<StreamKey, StreamRow>("stream", found, known_.streams, used, made)) {
    const auto trace = traces_.find(key);
    if (trace != traces_.end() && (!trust || found.count(key) == 0)) {
      // Its numbers may be the damage: the polls that are here know better.
      stream.seq_from = part_.number == 1 ? 0 : trace->second.seq_from;
      stream.stream.planned.reset();
    }
    if (trace != traces_.end() || trust) {
      write(insert, stream);
    }
  }
}

void Rebuild::mend() {
  mend_sessions();
  mend_robots();
  mend_streams();
  Statement coverage(out_, insert_sql("coverage"));
  for (auto& [key, trace] : traces_) {
    trace.count.first_us = trace.t_from_us;
    trace.count.last_us = trace.t_to_us;
    write(coverage, key, trace.count);
  }
  part_.counted_to = std::max(out_.integer("SELECT ifnull(max(id), 0) FROM hot"),
                              out_.integer("SELECT ifnull(max(row_to), 0) FROM block"));
  out_.exec("DELETE FROM part; DELETE FROM seal");
  Statement part(out_, insert_sql("part"));
  part.run(part_.log, part_.number, part_.software, false, part_.counted_to);
}

/// A copy with everything of the WAL in the file itself. SQLite does that page by page and needs no more than the
/// header, which is made anew when it is damaged.
void copy_with_wal(const fs::path& damaged, const fs::path& copy) {
  fs::copy_file(damaged, copy, fs::copy_options::overwrite_existing);
  fs::copy_file(damaged.string() + "-wal", copy.string() + "-wal", fs::copy_options::overwrite_existing);
  const auto empty_wal = [&] { return Connection(copy, OpenMode::write).checkpoint_truncate(); };
  try {
    empty_wal();
  } catch (const SqliteError&) {
    const fs::path model = copy.string() + "-model";
    { scratch(model).exec("PRAGMA journal_mode = WAL"); }
    std::array<char, kFileHeader> header{};
    std::ifstream(model, std::ios::binary).read(header.data(), header.size());
    std::fstream(copy, std::ios::in | std::ios::out | std::ios::binary).write(header.data(), header.size());
    fs::remove(model);
    try {
      empty_wal();
    } catch (const SqliteError&) {
      // What is in the file itself is left.
    }
  }
}

}  // namespace

bool may_be_part(const fs::path& path) {
  if (number_in_name(path)) {
    return true;
  }
  std::string start(65536, '\0');
  std::ifstream file(path, std::ios::binary);
  file.read(start.data(), static_cast<std::streamsize>(start.size()));
  // The schema stands at the end of the first page; either mark may be damaged.
  constexpr std::string_view kMark("TACH");
  return start.compare(68, kMark.size(), kMark) == 0 || start.find("CREATE TABLE hot (") != std::string::npos;
}

Scavenged scavenge(const fs::path& damaged, std::span<const fs::path> others, const fs::path& folder) {
  const fs::path target = folder / ("found-" + damaged.filename().string());
  const fs::path copy = folder / ("copy-" + damaged.filename().string());
  std::error_code none;
  const bool wal = fs::file_size(damaged.string() + "-wal", none) > 0 && !none;
  if (wal) {
    copy_with_wal(damaged, copy);
  }
  Scavenged found = Rebuild(damaged, target, ask(others)).run(wal ? copy : damaged);
  for (const char* suffix : {"", "-wal", "-shm"}) {
    fs::remove(copy.string() + suffix);
  }
  if (found.part.empty()) {
    fs::remove(target);
  }
  return found;
}

}  // namespace tacho::store
