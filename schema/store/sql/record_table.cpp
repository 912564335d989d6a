#include "schema/store/sql/record_table.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <map>
#include <optional>
#include <utility>
#include <variant>
#include <vector>

namespace tacho::store::sql {

namespace {

using Value = std::variant<std::monostate, std::int64_t, double, std::string>;
using Row = std::vector<Value>;

struct RecordColumn {
  std::string_view name;
  std::string_view type;
};

// A row holds robot.id here; SQL shows the name, and the id in a hidden column after the others.
constexpr std::string_view kRobot = "robot";
constexpr std::string_view kRobotId = "robot_id";

/// `robot` is null for tables that are not kept per robot.
struct RecordSpec {
  std::string_view name;
  std::vector<RecordColumn> columns;
  std::vector<Row> (*rows)(RowSource& log, const Robot* robot, std::size_t portion);
  bool per_robot = false;
  std::size_t (*portions)(const RowSource& log) = [](const RowSource&) { return std::size_t{1}; };
};

template <class Number>
Value number(Number n) {
  return static_cast<std::int64_t>(n);
}

/// NULL when there is none.
template <class Number>
Value number(const std::optional<Number>& n) {
  Value value;
  if (n) {
    value = static_cast<std::int64_t>(*n);
  }
  return value;
}

std::optional<Micros> when(bool known, Micros t) { return known ? std::optional(t) : std::nullopt; }

Value text(std::string_view t) { return std::string(t); }

std::vector<Row> robot_rows(RowSource& log, const Robot*, std::size_t) {
  std::vector<Row> rows;
  for (const Robot& r : log.robots()) {
    rows.push_back({number(r.id), r.name, r.address, r.vehicle_id, r.mac, r.model_md5, r.firmware});
  }
  return rows;
}

std::vector<Row> session_rows(RowSource& log, const Robot*, std::size_t) {
  std::vector<Row> rows;
  for (const Session& s : log.sessions()) {
    rows.push_back({number(s.id), s.t_start_us, number(when(s.t_end_us != 0, s.t_end_us)), number(s.clean), s.software,
                    s.config, s.host});
  }
  return rows;
}

std::vector<Row> stream_rows(RowSource& log, const Robot*, std::size_t) {
  std::vector<Row> rows;
  for (const Stream& s : log.streams()) {
    rows.push_back({number(s.session), number(s.robot), text(source_name(s.source)), s.period_us,
                    text(word_order_name(s.word_order)), s.request, number(s.planned)});
  }
  return rows;
}

std::vector<Row> coverage_rows(RowSource& log, const Robot*, std::size_t) {
  std::vector<Row> rows;
  for (const Coverage& c : log.coverage()) {
    const bool any = c.stored > 0;
    rows.push_back({number(c.robot), text(source_name(c.source)), number(c.stored), number(c.missed), number(c.planned),
                    number(c.partial), number(c.undecodable), number(c.bytes), number(when(any, c.first_us)),
                    number(when(any, c.last_us)), c.period_us});
  }
  return rows;
}

std::vector<Row> unknown_key_rows(RowSource& log, const Robot*, std::size_t) {
  std::vector<Row> rows;
  for (const UnknownKey& k : log.unknown_keys()) {
    rows.push_back({number(k.robot), text(source_name(k.source)), k.key, k.first_us});
  }
  return rows;
}

std::vector<Row> problem_rows(RowSource& log, const Robot*, std::size_t) {
  std::vector<Row> rows;
  for (const ReadProblem& p : log.problems()) {
    rows.push_back({p.where, p.what});
  }
  return rows;
}

/// Slices of a robot without any answer: gaps, events and clock points, each once.
template <class Use>
void each_slice(RowSource& log, const Robot& robot, Use use) {
  log.read(robot.id, Window{}, Selection{}, use);
}

std::vector<Row> gap_rows(RowSource& log, const Robot* robot, std::size_t) {
  std::vector<Row> rows;
  each_slice(log, *robot, [&](const Slice& slice) {
    for (const Gap& g : slice.gaps) {
      rows.push_back({number(g.robot), text(source_name(g.source)), number(g.session), number(g.seq_from),
                      number(g.seq_count), g.t_from_us, g.t_to_us, text(cause_name(g.cause)), number(g.partial),
                      g.detail});
    }
  });
  return rows;
}

bool is_first(const RowSource& log, const Robot& robot) {
  const std::vector<Robot> robots = log.robots();
  return !robots.empty() && robots.front().id == robot.id;
}

/// Events of no robot (parts that were removed) are given with the first one.
std::vector<Row> event_rows(RowSource& log, const Robot* robot, std::size_t) {
  std::vector<Row> rows;
  const auto take = [&](const Slice& slice) {
    for (const Event& e : slice.events) {
      rows.push_back({number(e.robot), text(source_name(e.source)), number(e.session), text(event_kind_name(e.kind)),
                      number(e.seq), e.t_from_us, e.t_us, e.subject, e.old_value, e.new_value, e.detail});
    }
  };
  if (is_first(log, *robot)) {
    each_slice(log, Robot{}, take);
  }
  each_slice(log, *robot, take);
  return rows;
}

std::vector<Row> rollup_rows(RowSource& log, const Robot* robot, std::size_t portion) {
  std::vector<Row> rows;
  for (const Rollup& r : log.rollups(robot->id, portion)) {
    rows.push_back({number(r.robot), text(source_name(r.source)), r.minute, text(field_at(r.field).name),
                    number(r.rows), r.min, r.max, r.sum, r.last});
  }
  return rows;
}

/// Points of no robot (host clocks only) come with every robot; they are given with the first.
std::vector<Row> clock_rows(RowSource& log, const Robot* robot, std::size_t) {
  const bool first = is_first(log, *robot);
  std::vector<Row> rows;
  each_slice(log, *robot, [&](const Slice& slice) {
    for (const ClockPoint& c : slice.clock) {
      if (c.robot != 0 || first) {
        rows.push_back({number(c.robot), number(c.session), c.wall_us, c.mono_us, number(c.robot_us)});
      }
    }
  });
  return rows;
}

// clang-format off
const std::array<RecordSpec, 10>& specs() {
  static const std::array<RecordSpec, 10> kSpecs{{
      {"robot", {{"id", "INTEGER"}, {"name", "TEXT"}, {"address", "TEXT"}, {"vehicle_id", "TEXT"}, {"mac", "TEXT"},
                 {"model_md5", "TEXT"}, {"firmware", "TEXT"}}, robot_rows},
      {"session", {{"id", "INTEGER"}, {"t_start_us", "INTEGER"}, {"t_end_us", "INTEGER"}, {"clean", "INTEGER"},
                   {"software", "TEXT"}, {"config", "TEXT"}, {"host", "TEXT"}}, session_rows},
      {"stream", {{"session", "INTEGER"}, {kRobot, "TEXT"}, {"source", "TEXT"}, {"period_us", "INTEGER"},
                  {"word_order", "TEXT"}, {"request", "TEXT"}, {"planned", "INTEGER"}}, stream_rows},
      {"coverage", {{kRobot, "TEXT"}, {"source", "TEXT"}, {"stored", "INTEGER"}, {"missed", "INTEGER"},
                    {"planned", "INTEGER"}, {"partial", "INTEGER"}, {"undecodable", "INTEGER"}, {"bytes", "INTEGER"},
                    {"first_us", "INTEGER"}, {"last_us", "INTEGER"}, {"period_us", "INTEGER"}}, coverage_rows},
      {"unknown_key", {{kRobot, "TEXT"}, {"source", "TEXT"}, {"key", "TEXT"}, {"first_us", "INTEGER"}},
       unknown_key_rows},
      {"problem", {{"place", "TEXT"}, {"what", "TEXT"}}, problem_rows},
      {"gap", {{kRobot, "TEXT"}, {"source", "TEXT"}, {"session", "INTEGER"}, {"seq_from", "INTEGER"},
               {"seq_count", "INTEGER"}, {"t_from_us", "INTEGER"}, {"t_to_us", "INTEGER"}, {"cause", "TEXT"},
               {"partial", "INTEGER"}, {"detail", "TEXT"}}, gap_rows, true},
      {"event", {{kRobot, "TEXT"}, {"source", "TEXT"}, {"session", "INTEGER"}, {"kind", "TEXT"}, {"seq", "INTEGER"},
                 {"t_from_us", "INTEGER"}, {"t_us", "INTEGER"}, {"subject", "TEXT"}, {"old_value", "TEXT"},
                 {"new_value", "TEXT"}, {"detail", "TEXT"}}, event_rows, true},
      {"clock", {{kRobot, "TEXT"}, {"session", "INTEGER"}, {"wall_us", "INTEGER"}, {"mono_us", "INTEGER"},
                 {"robot_us", "INTEGER"}}, clock_rows, true},
      {"rollup", {{kRobot, "TEXT"}, {"source", "TEXT"}, {"minute", "INTEGER"}, {"field", "TEXT"}, {"rows", "INTEGER"},
                  {"min", "REAL"}, {"max", "REAL"}, {"sum", "REAL"}, {"last", "REAL"}}, rollup_rows, true,
       [](const RowSource& log) { return log.rollup_portions(); }},
  }};
  return kSpecs;
}
// clang-format on

const RecordSpec& spec_of(std::string_view table) {
  const auto* found =
      std::find_if(specs().begin(), specs().end(), [&](const RecordSpec& spec) { return spec.name == table; });
  assert(found != specs().end());
  return *found;
}

/// Place of the column `robot`; -1 where there is none.
int place_of_robot(const RecordSpec& spec) {
  const auto found =
      std::find_if(spec.columns.begin(), spec.columns.end(), [](const RecordColumn& c) { return c.name == kRobot; });
  return found == spec.columns.end() ? -1 : static_cast<int>(found - spec.columns.begin());
}

class RecordTable final : public Table {
 public:
  RecordTable(const RecordSpec& spec, std::shared_ptr<SharedLog> log)
      : spec_(&spec), robot_column_(place_of_robot(spec)), log_(std::move(log)) {}

  [[nodiscard]] std::string declaration() const override {
    std::string sql;
    for (const RecordColumn& column : spec_->columns) {
      sql += fmt::format("{}\"{}\" {}", sql.empty() ? "CREATE TABLE x(" : ", ", column.name, column.type);
    }
    return sql + (robot_column_ >= 0 ? fmt::format(", {} INTEGER HIDDEN)", kRobotId) : ")");
  }
  /// The plan is "r" when the name of the robot is given, "i" when its id is, else empty.
  [[nodiscard]] std::string plan(sqlite3_index_info& info) const override;
  std::unique_ptr<TableCursor> open() override;

  [[nodiscard]] const RecordSpec& spec() const { return *spec_; }
  [[nodiscard]] int robot_column() const { return robot_column_; }
  [[nodiscard]] int robot_id_column() const { return static_cast<int>(spec_->columns.size()); }
  [[nodiscard]] SharedLog& log() const { return *log_; }

 private:
  const RecordSpec* spec_;
  int robot_column_;
  std::shared_ptr<SharedLog> log_;
};

std::string RecordTable::plan(sqlite3_index_info& info) const {
  info.estimatedCost = spec_->per_robot ? 100'000 : 100;
  info.estimatedRows = spec_->per_robot ? 10'000 : 20;
  for (int i = 0; spec_->per_robot && i < info.nConstraint; ++i) {
    const auto& constraint = info.aConstraint[i];
    const bool name = constraint.iColumn == robot_column_;
    if (constraint.usable != 0 && constraint.op == SQLITE_INDEX_CONSTRAINT_EQ &&
        (name || constraint.iColumn == robot_id_column()) &&
        std::string_view(sqlite3_vtab_collation(&info, i)) == "BINARY") {
      info.aConstraintUsage[i].argvIndex = 1;
      info.estimatedCost /= 4;
      info.estimatedRows /= 4;
      return name ? "r" : "i";
    }
  }
  return {};
}

class RecordCursor final : public TableCursor {
 public:
  explicit RecordCursor(const RecordTable& table) : table_(&table), in_use_(table.log().use()) {}

  void start(std::string_view plan, std::span<sqlite3_value* const> values) override {
    RowSource& log = table_->log().get();
    next_robot_ = 0;
    next_portion_ = portions_ = table_->spec().portions(log);
    before_ = 0;
    robots_.clear();
    names_.clear();
    for (const Robot& robot : log.robots()) {
      names_[robot.id] = robot.name;
    }
    if (table_->spec().per_robot) {
      robots_ = log.robots();
    }
    if (plan == "r") {
      const std::string_view wanted = text_of(values[0]);
      std::erase_if(robots_, [&](const Robot& r) { return r.name != wanted; });
    }
    if (plan == "i") {
      const std::int64_t wanted = sqlite3_value_int64(values[0]);
      // No such robot can still be 0, the clock points of the host: then all are read, and SQLite chooses.
      if (std::any_of(robots_.begin(), robots_.end(), [&](const Robot& r) { return r.id == wanted; })) {
        std::erase_if(robots_, [&](const Robot& r) { return r.id != wanted; });
      }
    }
    at_ = 0;
    rows_.clear();
    if (!table_->spec().per_robot) {
      rows_ = table_->spec().rows(log, nullptr, 0);
    }
    skip_empty();
  }
  [[nodiscard]] bool at_end() const override { return at_ >= rows_.size(); }
  void next() override {
    ++at_;
    skip_empty();
  }
  /// Number of the row within its robot, and the robot.
  [[nodiscard]] std::int64_t row_id() const override {
    constexpr unsigned kRowBits = 40;
    const RobotId robot = next_robot_ > 0 ? robots_[next_robot_ - 1].id : 0;
    return static_cast<std::int64_t>(std::uint64_t{robot} << kRowBits | (before_ + at_));
  }
  void column(sqlite3_context* out, int column) override {
    if (column == table_->robot_column()) {
      if (const auto name = names_.find(robot_of_row()); name != names_.end()) {
        give(out, name->second);
      }
      return;  // of no robot: NULL
    }
    if (column == table_->robot_id_column()) {
      return give(out, robot_of_row());
    }
    const Value& value = rows_[at_][static_cast<std::size_t>(column)];
    if (const auto* n = std::get_if<std::int64_t>(&value)) {
      give(out, *n);
    } else if (const auto* r = std::get_if<double>(&value)) {
      give(out, *r);
    } else if (const auto* t = std::get_if<std::string>(&value)) {
      give(out, *t);
    }
  }

 private:
  const RecordTable* table_;
  std::shared_ptr<void> in_use_;
  std::map<std::int64_t, std::string> names_;  // of all robots, by id
  std::vector<Robot> robots_;                  // that are read
  std::size_t next_robot_ = 0;
  std::size_t next_portion_ = 0;  // of the robot before next_robot_
  std::size_t portions_ = 0;
  std::size_t before_ = 0;  // rows of earlier portions of that robot
  std::vector<Row> rows_;
  std::size_t at_ = 0;

  [[nodiscard]] std::int64_t robot_of_row() const {
    return std::get<std::int64_t>(rows_[at_][static_cast<std::size_t>(table_->robot_column())]);
  }

  void skip_empty() {
    while (at_ >= rows_.size() && (next_portion_ < portions_ || next_robot_ < robots_.size())) {
      before_ += rows_.size();
      if (next_portion_ >= portions_) {
        ++next_robot_;
        next_portion_ = 0;
        before_ = 0;
      }
      rows_.clear();
      if (next_portion_ < portions_) {
        rows_ = table_->spec().rows(table_->log().get(), &robots_[next_robot_ - 1], next_portion_++);
      }
      at_ = 0;
    }
  }
};

std::unique_ptr<TableCursor> RecordTable::open() { return std::make_unique<RecordCursor>(*this); }

}  // namespace

const std::vector<std::string>& record_table_names() {
  static const std::vector<std::string> kNames = [] {
    std::vector<std::string> names;
    for (const RecordSpec& spec : specs()) {
      names.emplace_back(spec.name);
    }
    return names;
  }();
  return kNames;
}

std::vector<std::string> record_column_names(std::string_view table) {
  std::vector<std::string> names;
  for (const RecordColumn& column : spec_of(table).columns) {
    names.emplace_back(column.name);
  }
  return names;
}

std::unique_ptr<Table> make_record_table(std::string_view table, std::shared_ptr<SharedLog> log) {
  return std::make_unique<RecordTable>(spec_of(table), std::move(log));
}

}  // namespace tacho::store::sql
