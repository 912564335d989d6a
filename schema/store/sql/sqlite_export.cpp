#include "schema/store/sql/sqlite_export.hpp"

#include <fmt/format.h>

#include <array>
#include <deque>
#include <iterator>
#include <optional>
#include <stdexcept>
#include <string>
#include <system_error>
#include <utility>

#include "schema/json_text.hpp"
#include "schema/store/rows.hpp"
#include "schema/store/schema_sql.hpp"
#include "schema/store/sql/row_columns.hpp"
#include "schema/store/sqlite.hpp"
#include "schema/store/vocabulary.hpp"

namespace tacho::store::sql {

namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kRowsPerTransaction = 20'000;

/// The same text as the column `time` of the virtual tables, computed when it is read: 24 bytes a row saved.
constexpr std::string_view kTimeColumn =
    "time TEXT GENERATED ALWAYS AS (strftime('%Y-%m-%dT%H:%M:%S', t_send_us / 1000000, 'unixepoch') || "
    "printf('.%03dZ', t_send_us / 1000 % 1000)) VIRTUAL";

void refuse_existing(const fs::path& path) {
  std::error_code ignored;
  if (fs::exists(path, ignored)) {
    throw Error(path.string(), "exists already", "nothing is ever written over: give another name, or remove the file");
  }
}

/// The columns of one wide table that are stored: no hidden ones, no computed ones.
std::vector<RowColumn> stored_columns(Source source, const FieldSet& fields) {
  std::vector<RowColumn> columns;
  for (const RowColumn& column : row_columns(source)) {
    const bool wanted = column.value != RowValue::field || fields[column.field];
    if (!column.hidden && column.value != RowValue::time && wanted) {
      columns.push_back(column);
    }
  }
  return columns;
}

std::string create_sql(Source source, const std::vector<RowColumn>& columns) {
  std::string sql = fmt::format("CREATE TABLE {} (", source_name(source));
  for (const RowColumn& column : columns) {
    const bool key = column.value != RowValue::field;
    fmt::format_to(std::back_inserter(sql), "\"{}\" {}{}, ", column.name, column.type, key ? " NOT NULL" : "");
  }
  return sql + std::string(kTimeColumn) + ") STRICT";
}

std::string insert_sql(Source source, const std::vector<RowColumn>& columns) {
  std::string names;
  std::string values;
  for (const RowColumn& column : columns) {
    fmt::format_to(std::back_inserter(names), "{}\"{}\"", names.empty() ? "" : ", ", column.name);
    values += values.empty() ? "?" : ", ?";
  }
  return fmt::format("INSERT INTO {}({}) VALUES({})", source_name(source), names, values);
}

/// One of the tables `status`, `io`, `registers`, `inputs` while it is written.
class WideTable {
 public:
  /// The table must exist.
  WideTable(Connection& connection, Source source, std::vector<RowColumn> columns)
      : columns_(std::move(columns)), insert_(connection, sql::insert_sql(source, columns_)) {}

  void add(const Robot& robot, SessionId session, const Batch& batch, std::size_t row) {
    insert_.reset();
    texts_.clear();
    for (std::size_t i = 0; i < columns_.size(); ++i) {
      const int index = static_cast<int>(i) + 1;
      switch (columns_[i].value) {
        case RowValue::robot:
          insert_.set(index, robot.name);
          break;
        case RowValue::session:
          insert_.set(index, session);
          break;
        case RowValue::seq:
          insert_.set(index, batch.seq[row]);
          break;
        case RowValue::t_send_us:
          insert_.set(index, batch.t_send_us[row]);
          break;
        case RowValue::t_recv_us:
          insert_.set(index, batch.t_recv_us[row]);
          break;
        default:
          set_field(index, columns_[i].field, batch, row);
          break;
      }
    }
    while (insert_.step()) {
    }
  }

 private:
  std::vector<RowColumn> columns_;
  Statement insert_;
  std::deque<std::string> texts_;  ///< of the row: a bound text must live until it is written, where it is

  void set_field(int index, FieldIndex f, const Batch& batch, std::size_t row) {
    const Column* column = batch.find(f);
    if (column == nullptr || !column->has(row)) {
      insert_.set(index, std::nullopt);
      return;
    }
    switch (field_at(f).kind) {
      case Kind::real:
        insert_.set(index, column->real[row]);
        return;
      case Kind::integer:
      case Kind::flag:
      case Kind::code:
        insert_.set(index, column->integer[row]);
        return;
      case Kind::text:
      case Kind::list:
      case Kind::structured:
        insert_.set(index, batch.text(*column, row));
        return;
      case Kind::alarms:
        insert_.set(index, texts_.emplace_back(alarms_json(batch, row, field_at(f).name)));
        return;
      case Kind::points:
        insert_.set(index, texts_.emplace_back(points_json(batch, row, field_at(f).name == "do")));
        return;
    }
  }
};

/// The file while it is made; removed again when that does not end well.
class Unfinished {
 public:
  explicit Unfinished(const fs::path& final) : final_(final), path_(final.string() + ".unfinished") {
    std::error_code ignored;
    fs::remove(path_, ignored);  // of an export that was killed
  }
  ~Unfinished() {
    if (!done_) {
      std::error_code ignored;
      fs::remove(path_, ignored);
    }
  }
  Unfinished(const Unfinished&) = delete;
  Unfinished& operator=(const Unfinished&) = delete;
  [[nodiscard]] const fs::path& path() const { return path_; }
  void finish() {
    refuse_existing(final_);  // somebody may have been quicker
    std::error_code error;
    fs::rename(path_, final_, error);
    if (error) {
      throw Error(final_.string(), error.message(), "check that this user may write the folder");
    }
    done_ = true;
  }

 private:
  fs::path final_;
  fs::path path_;
  bool done_ = false;
};

class Exporter {
 public:
  Exporter(RowSource& log, const SqliteExport& what, const fs::path& path)
      : log_(&log), what_(&what), connection_(path, OpenMode::create) {
    // Nothing to protect: a file that is not finished is removed.
    connection_.exec("PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF; BEGIN");
    for (const Source source : what.sources) {
      std::vector<RowColumn> columns = stored_columns(source, what.fields);
      for (const RowColumn& column : columns) {
        if (column.field != kNoField) {
          selection_.add(source, column.field);
        }
      }
      selection_.rows[static_cast<std::size_t>(source)] = true;
      connection_.exec(create_sql(source, columns));
      wide_[static_cast<std::size_t>(source)].emplace(connection_, source, std::move(columns));
    }
    for (const char* table : {"robot", "session", "gap", "event", "clock", "field", "code"}) {
      connection_.exec(table_sql(table));
    }
  }

  std::uint64_t run() {
    write_heads();
    gaps_.emplace(connection_, store::insert_sql("gap"));
    events_.emplace(connection_, store::insert_sql("event"));
    clock_.emplace(connection_, store::insert_sql("clock"));
    read(Robot{}, Selection{});  // what belongs to no robot
    for (const Robot& robot : what_->robots) {
      read(robot, selection_);
    }
    name_robots();
    for (const Source source : what_->sources) {
      connection_.exec(fmt::format("CREATE INDEX {0}_time ON {0}(robot, t_send_us)", source_name(source)));
    }
    connection_.exec("CREATE INDEX event_time ON event(robot, t_us); COMMIT; PRAGMA synchronous = FULL");
    connection_.exec("PRAGMA user_version = 1");  // written and synchronised, and with it all before it
    return rows_;
  }

 private:
  RowSource* log_;
  const SqliteExport* what_;
  Connection connection_;
  Selection selection_;
  std::array<std::optional<WideTable>, kSourceCount> wide_;
  std::optional<Statement> gaps_;
  std::optional<Statement> events_;
  std::optional<Statement> clock_;
  std::uint64_t rows_ = 0;

  void read(const Robot& robot, const Selection& selection) {
    log_->read(robot.id, what_->window, selection, [&](const Slice& slice) {
      try {
        write_slice(robot, slice);
      } catch (const SqliteError& error) {
        // The reader takes errors of SQLite for damage of the log and goes on; this is the other file.
        throw std::runtime_error(error.what());
      }
    });
  }

  void write_slice(const Robot& robot, const Slice& slice) {
    for (const Batch& batch : slice.batches) {
      write_rows(robot, slice.session, batch);
    }
    for (const Gap& gap : slice.gaps) {
      write(*gaps_, gap);
    }
    for (const Event& event : slice.events) {
      write(*events_, event);
    }
    for (const ClockPoint& point : slice.clock) {
      if (point.robot == robot.id) {  // points of no robot come with every robot
        write(*clock_, point);
      }
    }
  }

  /// `robot` is a name in every table; its number stays beside it. Events and clock points of no robot have no name.
  void name_robots() {
    for (std::optional<Statement>* insert : {&gaps_, &events_, &clock_}) {
      insert->reset();  // a table in use cannot be altered
    }
    for (const char* table : {"gap", "event", "clock"}) {
      connection_.exec(
          fmt::format("ALTER TABLE {0} RENAME COLUMN robot TO robot_id; ALTER TABLE {0} ADD COLUMN robot TEXT; "
                      "UPDATE {0} SET robot = (SELECT name FROM robot WHERE id = robot_id)",
                      table));
    }
  }

  void write_heads() {
    Statement robots(connection_, store::insert_sql("robot"));
    for (const Robot& robot : what_->robots) {
      write(robots, robot);
    }
    Statement sessions(connection_, store::insert_sql("session"));
    for (const Session& session : log_->sessions()) {
      write(sessions, session);
    }
    write_vocabulary(connection_);
  }

  void write_rows(const Robot& robot, SessionId session, const Batch& batch) {
    std::optional<WideTable>& table = wide_[static_cast<std::size_t>(batch.source)];
    for (std::size_t row = 0; table && row < batch.rows(); ++row) {
      table->add(robot, session, batch, row);
      if (++rows_ % kRowsPerTransaction == 0) {
        connection_.exec("COMMIT; BEGIN");
      }
    }
  }
};

}  // namespace

std::uint64_t export_sqlite(RowSource& log, const SqliteExport& what, const fs::path& path) {
  refuse_existing(path);
  Unfinished file(path);
  std::uint64_t rows = 0;
  {
    Exporter exporter(log, what, file.path());
    rows = exporter.run();
  }
  file.finish();
  return rows;
}

}  // namespace tacho::store::sql
