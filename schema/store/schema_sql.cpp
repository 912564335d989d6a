#include "schema/store/schema_sql.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cassert>

namespace tacho::store {

namespace {

struct Table {
  std::string_view name;
  std::string_view meaning;
  std::string_view key;      // table constraint, empty when a column is the key
  std::string_view options;  // after the closing bracket
};

struct Column {
  std::string_view table;
  std::string_view name;
  std::string_view type;
  std::string_view meaning;
};

// clang-format off
constexpr auto kTables = std::to_array<Table>({
  // First of all, so that its root is page 2: readers find it there without the schema.
  {"summary",     "the head of a closed part as one row; no row while the part is written", "", "STRICT"},
  {"part",        "this file: one row", "", "STRICT"},
  {"robot",       "robots, as configured and as they say they are", "", "STRICT"},
  {"session",     "starts of the recorder that wrote into this part", "", "STRICT"},
  {"stream",      "one source of one robot in one session", "PRIMARY KEY (session, robot, source)", "STRICT, WITHOUT ROWID"},
  {"field",       "every field the decoder knows; names are the identity of a column", "", "STRICT"},
  {"code",        "numbers and their names: code lists of fields, and the lists of this schema", "PRIMARY KEY (list, value)", "STRICT, WITHOUT ROWID"},
  {"coverage",    "what this part holds of each stream, counted up to part.counted_to", "PRIMARY KEY (session, robot, source)", "STRICT, WITHOUT ROWID"},
  {"unknown_key", "keys of answers that no field names", "PRIMARY KEY (robot, source, key)", "STRICT, WITHOUT ROWID"},
  {"seal",        "what the small tables have; of a closed part also how many other rows", "", "STRICT, WITHOUT ROWID"},
  {"hot",         "stored answers in order of arrival: those of one stream between two commits", "", "STRICT"},
  {"block",       "stored answers of one stream that were moved out of hot", "", "STRICT"},
  {"gap",         "planned polls without an answer", "", "STRICT"},
  {"event",       "what happened, seen while recording", "", "STRICT"},
  {"rollup",      "what fields did per minute, of answers that are in blocks", "PRIMARY KEY (robot, source, minute, field)", "STRICT, WITHOUT ROWID"},
  {"manifest",    "how many answers there are per hour, and a sum over them, of answers that are in blocks", "PRIMARY KEY (robot, source, hour_us)", "STRICT, WITHOUT ROWID"},
  {"clock",       "host wall clock, host monotonic clock and robot clock at one instant", "", "STRICT"},
});

constexpr auto kColumns = std::to_array<Column>({
  {"summary", "id",   "INTEGER PRIMARY KEY", "1"},
  {"summary", "data", "BLOB NOT NULL",       "part, robot, session, stream, coverage, unknown_key and sums of gap again; see summary.cpp"},

  {"part", "log",        "TEXT NOT NULL",    "identity of the log, the same in all its parts"},
  {"part", "number",     "INTEGER NOT NULL", "number of this part, from 1; order of parts"},
  {"part", "software",   "TEXT NOT NULL",    "what created the part"},
  {"part", "closed",     "INTEGER NOT NULL", "1: complete and checkpointed"},
  {"part", "counted_to", "INTEGER NOT NULL", "place of the newest answer that the coverage rows count; all of every block"},
  {"part", "ended_us",   "INTEGER",          "when it was closed by a clock known to be right, UTC microseconds; NULL: not known"},

  {"robot", "id",         "INTEGER PRIMARY KEY", "the same in all parts"},
  {"robot", "name",       "TEXT NOT NULL UNIQUE","the user's name for it"},
  {"robot", "address",    "TEXT NOT NULL",       "where it was found: host:status_port:modbus_port"},
  {"robot", "vehicle_id", "TEXT NOT NULL",       "as the robot says; empty until known"},
  {"robot", "mac",        "TEXT NOT NULL",       "as the robot says; empty until known"},
  {"robot", "model_md5",  "TEXT NOT NULL",       "as the robot says; empty until known"},
  {"robot", "firmware",   "TEXT NOT NULL",       "input registers 37-40; empty until known"},

  {"session", "id",         "INTEGER PRIMARY KEY", "number of the recorder start, the same in all parts"},
  {"session", "t_start_us", "INTEGER NOT NULL",    "UTC microseconds"},
  {"session", "t_end_us",   "INTEGER",             "UTC microseconds; NULL while running"},
  {"session", "clean",      "INTEGER NOT NULL",    "1: ended as asked, 0: running or killed"},
  {"session", "software",   "TEXT NOT NULL",       "name and version of the recorder"},
  {"session", "config",     "TEXT NOT NULL",       "configuration text, verbatim"},
  {"session", "host",       "TEXT NOT NULL",       "host name and zone offset"},

  {"stream", "session",    "INTEGER NOT NULL", "session.id"},
  {"stream", "robot",      "INTEGER NOT NULL", "robot.id"},
  {"stream", "source",     "TEXT NOT NULL",    "code list source"},
  {"stream", "period_us",  "INTEGER NOT NULL", "planned period"},
  {"stream", "word_order", "TEXT NOT NULL",    "order of 16-bit words and bytes in 32-bit registers"},
  {"stream", "request",    "TEXT NOT NULL",    "request body, or register ranges"},
  {"stream", "seq_from",   "INTEGER NOT NULL", "first poll number that belongs to this part"},
  {"stream", "planned",    "INTEGER",          "polls the schedule asked for since the session began; NULL until it ended"},

  {"field", "id",             "INTEGER PRIMARY KEY", "row of the field table; bit in coverage.seen and coverage.valued"},
  {"field", "name",           "TEXT NOT NULL",       "canonical name"},
  {"field", "kind",           "TEXT NOT NULL",       "code list kind"},
  {"field", "unit",           "TEXT NOT NULL",       "SI unit"},
  {"field", "json_key",       "TEXT NOT NULL",       "key in the 11100 or 11013 answer; empty: not in JSON"},
  {"field", "json_scale",     "REAL NOT NULL",       "JSON number times this = SI value"},
  {"field", "former_key",     "TEXT NOT NULL",       "spelling of older firmware"},
  {"field", "register",       "INTEGER NOT NULL",    "documented address; 0: in no register"},
  {"field", "register_type",  "TEXT NOT NULL",       "code list register_type"},
  {"field", "register_scale", "REAL NOT NULL",       "register value times this = SI value"},
  {"field", "discrete",       "INTEGER NOT NULL",    "1: discrete input [1x], 0: input register [3x]"},
  {"field", "condition",      "TEXT NOT NULL",       "name of a flag; while it is false the field means nothing"},
  {"field", "code_list",      "TEXT NOT NULL",       "code.list"},
  {"field", "sentinel",       "TEXT NOT NULL",       "code list sentinel: the value that means not supplied"},
  {"field", "retired",        "INTEGER NOT NULL",    "1: struck out in the vendor's document"},
  {"field", "meaning",        "TEXT NOT NULL",       "one clause"},

  {"code", "list",    "TEXT NOT NULL",    "name of the list"},
  {"code", "value",   "INTEGER NOT NULL", "the number"},
  {"code", "name",    "TEXT NOT NULL",    "its name"},
  {"code", "meaning", "TEXT NOT NULL",    "one clause"},

  {"coverage", "session",     "INTEGER NOT NULL", "session.id"},
  {"coverage", "robot",       "INTEGER NOT NULL", "robot.id"},
  {"coverage", "source",      "TEXT NOT NULL",    "code list source"},
  {"coverage", "stored",      "INTEGER NOT NULL", "answers in this part; 0: only last_us means something"},
  {"coverage", "bytes",       "INTEGER NOT NULL", "sum of their lengths as received"},
  {"coverage", "undecodable", "INTEGER NOT NULL", "answers that are stored but could not be decoded"},
  {"coverage", "first_us",    "INTEGER NOT NULL", "smallest send time, UTC microseconds"},
  {"coverage", "last_us",     "INTEGER NOT NULL", "largest send time, also of earlier parts when stored is 0"},
  {"coverage", "next_seq",    "INTEGER NOT NULL", "number after the last stored poll; 0: none stored"},
  {"coverage", "seen",        "BLOB NOT NULL",    "bit field.id (lowest first): the field was ever not absent"},
  {"coverage", "valued",      "BLOB NOT NULL",    "bit field.id (lowest first): the field ever had a value (state present)"},

  {"unknown_key", "robot",    "INTEGER NOT NULL", "robot.id"},
  {"unknown_key", "source",   "TEXT NOT NULL",    "code list source"},
  {"unknown_key", "key",      "TEXT NOT NULL",    "path of the key"},
  {"unknown_key", "first_us", "INTEGER NOT NULL", "first answer of this part that had it, UTC microseconds"},

  {"seal", "name", "TEXT PRIMARY KEY", "of the table; 'field names', 'code names': of the columns that opening a log needs"},
  {"seal", "rows", "INTEGER NOT NULL", "how many it has"},
  {"seal", "crc",  "INTEGER",          "CRC-32C of all their columns; NULL: each row has its own"},

  {"hot", "id",        "INTEGER PRIMARY KEY", "place of the first answer in the order of arrival of all answers of this part"},
  {"hot", "robot",     "INTEGER NOT NULL",    "robot.id"},
  {"hot", "source",    "INTEGER NOT NULL",    "code list source"},
  {"hot", "session",   "INTEGER NOT NULL",    "session.id"},
  {"hot", "seq",       "INTEGER NOT NULL",    "number of the first planned poll in its stream, from 0"},
  {"hot", "t_send_us", "INTEGER NOT NULL",    "its request handed to the kernel, UTC microseconds"},
  {"hot", "base",      "INTEGER",             "hot.id of the row whose last body these are compressed against; NULL: a keyframe"},
  {"hot", "rows",      "INTEGER NOT NULL",    "answers"},
  {"hot", "crc",       "INTEGER NOT NULL",    "CRC-32C of the other columns"},
  {"hot", "data",      "BLOB NOT NULL",       "their places, polls, times, lengths and bodies, see schema/store/block/FORMAT.md"},

  {"block", "id",        "INTEGER PRIMARY KEY", "order of moving"},
  {"block", "robot",     "INTEGER NOT NULL",    "robot.id"},
  {"block", "source",    "INTEGER NOT NULL",    "code list source"},
  {"block", "session",   "INTEGER NOT NULL",    "session.id"},
  {"block", "seq_from",  "INTEGER NOT NULL",    "first poll; polls in between may be missing"},
  {"block", "seq_to",    "INTEGER NOT NULL",    "last poll"},
  {"block", "row_from",  "INTEGER NOT NULL",    "place of the first answer in the order of arrival; each answer keeps its own"},
  {"block", "row_to",    "INTEGER NOT NULL",    "place of the last answer"},
  {"block", "t_from_us", "INTEGER NOT NULL",    "smallest send time, UTC microseconds"},
  {"block", "t_to_us",   "INTEGER NOT NULL",    "largest send time, UTC microseconds"},
  {"block", "rows",      "INTEGER NOT NULL",    "answers"},
  {"block", "crc",       "INTEGER NOT NULL",    "CRC-32C of the other columns but id and data, which has its own"},
  {"block", "data",      "BLOB NOT NULL",       "see schema/store/block/FORMAT.md"},

  {"gap", "id",        "INTEGER PRIMARY KEY", "order of arrival"},
  {"gap", "robot",     "INTEGER NOT NULL",    "robot.id"},
  {"gap", "source",    "TEXT NOT NULL",       "code list source"},
  {"gap", "session",   "INTEGER NOT NULL",    "session.id"},
  {"gap", "seq_from",  "INTEGER NOT NULL",    "first poll concerned"},
  {"gap", "seq_count", "INTEGER NOT NULL",    "polls concerned"},
  {"gap", "t_from_us", "INTEGER NOT NULL",    "UTC microseconds"},
  {"gap", "t_to_us",   "INTEGER NOT NULL",    "UTC microseconds"},
  {"gap", "cause",     "TEXT NOT NULL",       "code list cause"},
  {"gap", "partial",   "INTEGER NOT NULL",    "1: the polls are stored, but some register ranges are not"},
  {"gap", "detail",    "TEXT NOT NULL",       "words of the system or the robot"},
  {"gap", "crc",       "INTEGER NOT NULL",    "CRC-32C of the other columns but id"},

  {"event", "id",        "INTEGER PRIMARY KEY", "order of arrival"},
  {"event", "robot",     "INTEGER NOT NULL",    "robot.id"},
  {"event", "source",    "TEXT NOT NULL",       "code list source"},
  {"event", "session",   "INTEGER NOT NULL",    "session.id"},
  {"event", "kind",      "TEXT NOT NULL",       "code list event"},
  {"event", "seq",       "INTEGER NOT NULL",    "poll it was seen in"},
  {"event", "t_from_us", "INTEGER NOT NULL",    "it happened after this, UTC microseconds"},
  {"event", "t_us",      "INTEGER NOT NULL",    "and not later than this"},
  {"event", "subject",   "TEXT NOT NULL",       "what it is about"},
  {"event", "old_value", "TEXT NOT NULL",       "before; empty when unknown"},
  {"event", "new_value", "TEXT NOT NULL",       "after"},
  {"event", "detail",    "TEXT NOT NULL",       "the robot's own words"},
  {"event", "crc",       "INTEGER NOT NULL",    "CRC-32C of the other columns but id"},

  {"rollup", "robot",  "INTEGER NOT NULL", "robot.id"},
  {"rollup", "source", "INTEGER NOT NULL", "code list source"},
  {"rollup", "minute", "INTEGER NOT NULL", "UTC minutes since 1970, of the middle of the answer; datetime(minute * 60, 'unixepoch')"},
  {"rollup", "field",  "INTEGER NOT NULL", "field.id"},
  {"rollup", "rows",   "INTEGER NOT NULL", "answers that had a value; absent, not meaningful and not supplied are none"},
  {"rollup", "min",    "REAL NOT NULL",    "in the unit of the field; flags are 0 and 1, alarm lists their length"},
  {"rollup", "max",    "REAL NOT NULL",    "likewise"},
  {"rollup", "sum",    "REAL NOT NULL",    "over rows: the mean"},
  {"rollup", "last",   "REAL NOT NULL",    "in order of arrival"},
  {"rollup", "crc",    "INTEGER NOT NULL", "CRC-32C of the other columns"},

  {"manifest", "robot",   "INTEGER NOT NULL", "robot.id"},
  {"manifest", "source",  "INTEGER NOT NULL", "code list source"},
  {"manifest", "hour_us", "INTEGER NOT NULL", "start of the UTC hour of the send time, UTC microseconds"},
  {"manifest", "rows",    "INTEGER NOT NULL", "answers"},
  {"manifest", "hash",    "INTEGER NOT NULL", "sum of their hashes modulo 2^64, see schema/store/block/FORMAT.md"},
  {"manifest", "crc",     "INTEGER NOT NULL", "CRC-32C of the other columns"},

  {"clock", "id",       "INTEGER PRIMARY KEY", "order of arrival"},
  {"clock", "robot",    "INTEGER NOT NULL",    "robot.id; 0: host clocks only"},
  {"clock", "session",  "INTEGER NOT NULL",    "session.id"},
  {"clock", "wall_us",  "INTEGER NOT NULL",    "host wall clock, UTC microseconds"},
  {"clock", "mono_us",  "INTEGER NOT NULL",    "host monotonic clock, microseconds"},
  {"clock", "robot_us", "INTEGER",             "robot clock, UTC microseconds"},
  {"clock", "crc",      "INTEGER NOT NULL",    "CRC-32C of the other columns but id"},
});
// clang-format on

std::string create_sql(const Table& table) {
  std::string out = fmt::format("-- {}\nCREATE TABLE {} (\n", table.meaning, table.name);
  const auto last =
      std::find_if(kColumns.rbegin(), kColumns.rend(), [&](const Column& c) { return c.table == table.name; });
  for (const Column& column : kColumns) {
    if (column.table == table.name) {
      const bool comma = &column != &*last || !table.key.empty();
      out += fmt::format("  {:<40} -- {}\n", fmt::format("{} {}{}", column.name, column.type, comma ? "," : ""),
                         column.meaning);
    }
  }
  if (!table.key.empty()) {
    out += fmt::format("  {}\n", table.key);
  }
  return out + fmt::format(") {};\n", table.options);
}

struct Names {
  std::string columns;
  std::string parameters;
};

Names names_of(std::string_view table) {
  Names names;
  int count = 0;
  for (const Column& column : kColumns) {
    if (column.table == table) {
      names.columns += fmt::format("{}{}", count > 0 ? ", " : "", column.name);
      names.parameters += fmt::format("{}?{}", count > 0 ? ", " : "", count + 1);
      ++count;
    }
  }
  assert(count > 0);
  return names;
}

}  // namespace

std::string schema_sql() {
  std::string out = fmt::format("PRAGMA application_id = {};  -- \"TACH\"\nPRAGMA user_version = {};\n", kApplicationId,
                                kSchemaVersion);
  for (const Table& table : kTables) {
    out += "\n";
    out += create_sql(table);
  }
  return out;
}

std::string table_sql(std::string_view table) {
  const auto* found = std::find_if(kTables.begin(), kTables.end(), [&](const Table& t) { return t.name == table; });
  assert(found != kTables.end());
  return create_sql(*found);
}

std::string insert_sql(std::string_view table, std::string_view on_conflict) {
  const Names names = names_of(table);
  return fmt::format("INSERT {} INTO {}({}) VALUES({})", on_conflict, table, names.columns, names.parameters);
}

std::string select_sql(std::string_view table) {
  return fmt::format("SELECT {} FROM {}", names_of(table).columns, table);
}

}  // namespace tacho::store
