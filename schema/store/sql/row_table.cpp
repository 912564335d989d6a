#include "schema/store/sql/row_table.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iterator>
#include <limits>
#include <optional>
#include <utility>

#include "schema/json_text.hpp"
#include "schema/store/sql/row_columns.hpp"
#include "schema/store/sql/row_scan.hpp"
#include "schema/store/sql/time_text.hpp"
#include "schema/time.hpp"

namespace tacho::store::sql {

namespace {

// A plan is text: the columns the statement uses (hex), the constraints in the order of their values (a letter for the
// column, one for the operator), and columns past the 63 of SQLite's bit set that a condition names: "1f s>sl 70,81".

constexpr int kLastBit = 63;  // of sqlite3_index_info::colUsed: this column or any after it

/// Columns whose constraints narrow what is read, by the letter they have in a plan.
struct Pushed {
  RowValue value;
  char letter;
  bool ordered;           ///< also < <= > >=
  const char* collation;  ///< that the comparison must use; others mean another order
};
constexpr Pushed kPushed[] = {
    {RowValue::robot, 'r', false, "BINARY"},
    {RowValue::robot_id, 'i', false, "BINARY"},
    {RowValue::t_send_us, 's', true, "BINARY"},
    {RowValue::time, 't', true, kTimeCollation},
};

char operator_letter(unsigned char op) {
  switch (op) {
    case SQLITE_INDEX_CONSTRAINT_EQ:
      return '=';
    case SQLITE_INDEX_CONSTRAINT_GT:
    case SQLITE_INDEX_CONSTRAINT_GE:
      return '>';
    case SQLITE_INDEX_CONSTRAINT_LT:
    case SQLITE_INDEX_CONSTRAINT_LE:
      return '<';
    default:
      return 0;
  }
}

Micros to_micros(double value) {
  constexpr double kLimit = 9.2e18;
  return static_cast<Micros>(std::clamp(value, -kLimit, kLimit));
}

/// Cuts `window` to what `column op value` can be true for. SQLite looks at each row again, so a little more is no
/// harm.
void narrow(Window& window, char op, Micros low, Micros high) {
  if (op != '<') {
    window.from_us = std::max(window.from_us, low);
  }
  if (op != '>') {
    window.to_us = std::min(window.to_us, high == std::numeric_limits<Micros>::max() ? high : high + 1);
  }
}

void narrow_by_number(Window& window, char op, sqlite3_value* value) {
  switch (sqlite3_value_numeric_type(value)) {
    case SQLITE_INTEGER: {
      const Micros t = sqlite3_value_int64(value);
      narrow(window, op, t, t);
      return;
    }
    case SQLITE_FLOAT: {
      const double t = sqlite3_value_double(value);
      narrow(window, op, to_micros(std::floor(t)), to_micros(std::ceil(t)));
      return;
    }
    default:
      return;
  }
}

void narrow_by_time(Window& window, char op, sqlite3_value* value) {
  if (sqlite3_value_type(value) != SQLITE_TEXT) {
    return;
  }
  constexpr Micros kMillisecond = 1000;  // the column shows no more
  if (const std::optional<Micros> t = time_of_key(time_key(text_of(value)))) {
    narrow(window, op, *t - kMillisecond, *t + kMillisecond);
  }
}

class RowTable final : public Table {
 public:
  RowTable(Source source, std::shared_ptr<SharedLog> log)
      : source_(source), columns_(&row_columns(source)), log_(std::move(log)) {}

  [[nodiscard]] std::string declaration() const override;
  [[nodiscard]] std::string plan(sqlite3_index_info& info) const override;
  std::unique_ptr<TableCursor> open() override;

  [[nodiscard]] Source source() const { return source_; }
  [[nodiscard]] const std::vector<RowColumn>& columns() const { return *columns_; }
  [[nodiscard]] SharedLog& log() const { return *log_; }

 private:
  Source source_;
  const std::vector<RowColumn>* columns_;
  std::shared_ptr<SharedLog> log_;

  [[nodiscard]] double rows() const;
};

std::string RowTable::declaration() const {
  std::string sql = "CREATE TABLE x(";
  for (const RowColumn& column : *columns_) {
    fmt::format_to(std::back_inserter(sql), "{}\"{}\" {}{}{}", &column == columns_->data() ? "" : ", ", column.name,
                   column.type, column.value == RowValue::time ? fmt::format(" COLLATE {}", kTimeCollation) : "",
                   column.hidden ? " HIDDEN" : "");
  }
  return sql + ")";
}

double RowTable::rows() const {
  double rows = 1;
  for (const Coverage& c : log_->get().coverage()) {
    rows += c.source == source_ ? static_cast<double>(c.stored) : 0.0;
  }
  return rows;
}

std::string RowTable::plan(sqlite3_index_info& info) const {
  std::string constraints;
  std::string named;
  double rows_left = rows();
  for (int i = 0; i < info.nConstraint; ++i) {
    const auto& constraint = info.aConstraint[i];
    if (constraint.iColumn < 0) {
      continue;
    }
    if (constraint.iColumn >= kLastBit) {
      named += fmt::format("{}{}", named.empty() ? "" : ",", constraint.iColumn);
    }
    const RowValue value = (*columns_)[static_cast<std::size_t>(constraint.iColumn)].value;
    const char op = operator_letter(constraint.op);
    const auto* pushed = std::find_if(std::begin(kPushed), std::end(kPushed), [&](const Pushed& p) {
      return p.value == value && op != 0 && (p.ordered || op == '=');
    });
    if (constraint.usable == 0 || pushed == std::end(kPushed) ||
        std::string_view(sqlite3_vtab_collation(&info, i)) != pushed->collation) {
      continue;
    }
    constraints += {pushed->letter, op};
    info.aConstraintUsage[i].argvIndex = static_cast<int>(constraints.size() / 2);
    rows_left = std::max(1.0, rows_left / (pushed->ordered ? 8.0 : 4.0));
  }
  constexpr double kOpening = 1000.0;  // in rows
  info.estimatedCost = kOpening + rows_left;
  info.estimatedRows = static_cast<sqlite3_int64>(rows_left);
  return fmt::format("{:x} {} {}", info.colUsed, constraints.empty() ? "-" : constraints, named);
}

class RowCursor final : public TableCursor {
 public:
  explicit RowCursor(const RowTable& table) : table_(&table), in_use_(table.log().use()) {}

  void start(std::string_view plan, std::span<sqlite3_value* const> values) override;
  [[nodiscard]] bool at_end() const override { return at_end_; }
  void next() override { at_end_ = !scan_->next(); }
  [[nodiscard]] std::int64_t row_id() const override;
  void column(sqlite3_context* out, int column) override;

 private:
  const RowTable* table_;
  std::shared_ptr<void> in_use_;
  std::optional<RowScan> scan_;
  bool at_end_ = true;

  void add_column(FieldSet& fields, std::size_t column) const;
  [[nodiscard]] FieldSet fields_of(std::string_view used, std::string_view named) const;
  [[nodiscard]] bool choose(RowScan::Query& query, std::string_view constraints,
                            std::span<sqlite3_value* const> values) const;
  void field(sqlite3_context* out, FieldIndex f);
  void code_name(sqlite3_context* out, FieldIndex f);
};

void RowCursor::add_column(FieldSet& fields, std::size_t column) const {
  if (column < table_->columns().size() && table_->columns()[column].field != kNoField) {
    fields.set(table_->columns()[column].field);
  }
}

/// Columns past the bit set are read when they are asked for (RowScan::column), except where all of them must be meant:
/// `select *`.
FieldSet RowCursor::fields_of(std::string_view used, std::string_view named) const {
  std::uint64_t bits = 0;
  std::from_chars(used.data(), used.data() + used.size(), bits, 16);
  FieldSet fields;
  const bool all = bits == std::numeric_limits<std::uint64_t>::max();
  for (std::size_t i = 0; i < table_->columns().size(); ++i) {
    if (i < kLastBit ? (bits >> i & 1U) != 0 : all && !table_->columns()[i].hidden) {
      add_column(fields, i);
    }
  }
  const char* at = named.data();
  const char* const end = named.data() + named.size();
  while (at != end) {
    std::size_t column = 0;
    at = std::from_chars(at, end, column).ptr;
    add_column(fields, column);
    at += at != end ? 1 : 0;  // the comma
  }
  return fields;
}

/// False when no row can be meant.
bool RowCursor::choose(RowScan::Query& query, std::string_view constraints,
                       std::span<sqlite3_value* const> values) const {
  for (std::size_t i = 0; i < values.size(); ++i) {
    sqlite3_value* value = values[i];
    const char op = constraints[2 * i + 1];
    if (sqlite3_value_type(value) == SQLITE_NULL) {
      return false;  // no comparison with NULL is true
    }
    switch (constraints[2 * i]) {
      case 'r':
        std::erase_if(query.robots, [&](const Robot& r) { return r.name != text_of(value); });
        break;
      case 'i':
        std::erase_if(query.robots, [&](const Robot& r) { return r.id != sqlite3_value_int64(value); });
        break;
      case 's':
        narrow_by_number(query.window, op, value);
        break;
      default:
        narrow_by_time(query.window, op, value);
        break;
    }
  }
  return true;
}

void RowCursor::start(std::string_view plan, std::span<sqlite3_value* const> values) {
  const std::size_t first = plan.find(' ');
  const std::size_t second = plan.find(' ', first + 1);
  RowSource& log = table_->log().get();
  RowScan::Query query{table_->source(), log.robots(), {}, fields_of(plan.substr(0, first), plan.substr(second + 1))};
  at_end_ = !choose(query, plan.substr(first + 1, second - first - 1), values);
  if (!at_end_) {
    scan_.emplace(log, std::move(query));
    next();
  }
}

/// Robot, session and seq, which are a row's identity: 1023 robots, 131071 starts of the recorder, 68 000 million
/// polls.
std::int64_t RowCursor::row_id() const {
  constexpr unsigned kSeqBits = 36;
  constexpr unsigned kSessionBits = 17;
  const std::uint64_t seq = scan_->batch().seq[scan_->row()] & ((std::uint64_t{1} << kSeqBits) - 1);
  const std::uint64_t session = scan_->session() & ((std::uint64_t{1} << kSessionBits) - 1);
  const std::uint64_t robot = scan_->robot().id & 1023U;
  return static_cast<std::int64_t>(robot << (kSeqBits + kSessionBits) | session << kSeqBits | seq);
}

void RowCursor::column(sqlite3_context* out, int index) {
  const RowColumn& column = table_->columns()[static_cast<std::size_t>(index)];
  const std::size_t row = scan_->row();
  switch (column.value) {
    case RowValue::robot:
      return give(out, scan_->robot().name);
    case RowValue::robot_id:
      return give(out, std::int64_t{scan_->robot().id});
    case RowValue::session:
      return give(out, std::int64_t{scan_->session()});
    case RowValue::seq:
      return give(out, static_cast<std::int64_t>(scan_->batch().seq[row]));
    case RowValue::t_send_us:
      return give(out, scan_->batch().t_send_us[row]);
    case RowValue::t_recv_us:
      return give(out, scan_->batch().t_recv_us[row]);
    case RowValue::time:
      return give(out, iso_utc(scan_->batch().t_send_us[row]));
    case RowValue::field:
      return field(out, column.field);
    case RowValue::code_name:
      return code_name(out, column.field);
    case RowValue::states: {
      FieldSet all;
      for (std::size_t i = 0; i < table_->columns().size(); ++i) {
        add_column(all, i);
      }
      scan_->need(all);
      return give(out, states_json(scan_->batch(), row));
    }
  }
}

void RowCursor::field(sqlite3_context* out, FieldIndex f) {
  const Column* column = scan_->column(f);
  const std::size_t row = scan_->row();
  if (column == nullptr || !column->has(row)) {
    return;
  }
  const Field& field = field_at(f);
  switch (field.kind) {
    case Kind::real:
      return give(out, column->real[row]);
    case Kind::integer:
    case Kind::flag:
    case Kind::code:
      return give(out, column->integer[row]);
    case Kind::text:
    case Kind::list:
    case Kind::structured:
      return give(out, scan_->batch().text(*column, row));
    case Kind::alarms:
      return give(out, alarms_json(scan_->batch(), row, field.name));
    case Kind::points:
      return give(out, points_json(scan_->batch(), row, field.name == "do"));
  }
}

void RowCursor::code_name(sqlite3_context* out, FieldIndex f) {
  const Column* column = scan_->column(f);
  if (column == nullptr || !column->has(scan_->row())) {
    return;
  }
  const std::string_view name = tacho::code_name(field_at(f), column->integer[scan_->row()]);
  if (!name.empty()) {
    give(out, name);
  }
}

std::unique_ptr<TableCursor> RowTable::open() { return std::make_unique<RowCursor>(*this); }

}  // namespace

std::unique_ptr<Table> make_row_table(Source source, std::shared_ptr<SharedLog> log) {
  return std::make_unique<RowTable>(source, std::move(log));
}

}  // namespace tacho::store::sql
