#include "analyzer/commands/sql.hpp"

#include <fmt/format.h>

#include <optional>
#include <utility>

#include "analyzer/commands/output.hpp"
#include "analyzer/report/csv.hpp"
#include "schema/store/sql/sql_session.hpp"

namespace tacho::commands {
namespace {

using store::sql::SqlBlob;
using store::sql::SqlSession;
using store::sql::SqlValue;
using store::sql::StatementError;

std::string hex(const std::string& bytes) {
  std::string out;
  for (const char c : bytes) {
    out += fmt::format("{:02x}", static_cast<unsigned>(static_cast<unsigned char>(c)));
  }
  return out;
}

struct ToCell {
  Value operator()(std::monostate) const { return Missing{}; }
  Value operator()(std::int64_t value) const { return value; }
  Value operator()(double value) const { return value; }
  Value operator()(const std::string& value) const { return value; }
  Value operator()(const SqlBlob& value) const { return hex(value.bytes); }
};

struct ToCsv {
  report::CsvWriter& csv;
  void operator()(std::monostate) const { csv.empty(); }
  void operator()(std::int64_t value) const { csv.integer(value); }
  void operator()(double value) const { csv.number(value); }
  void operator()(const std::string& value) const { csv.text(value); }
  void operator()(const SqlBlob& value) const { csv.text(hex(value.bytes)); }
};

/// Streams: a result can be as long as the log.
void write_csv(SqlSession& session, const std::string& statement, const Options& options) {
  constexpr std::size_t kChunk = 1U << 16U;
  std::optional<Output> output;
  std::string text;
  const auto head = [&](const std::vector<std::string>& names) {
    output.emplace(options.output);  // not before the statement is known to be right
    report::CsvWriter csv(text);
    for (const std::string& name : names) {
      csv.text(name);
    }
    csv.end_row();
  };
  session.run(statement, head, [&](std::span<const SqlValue> row) {
    report::CsvWriter csv(text);
    for (const SqlValue& value : row) {
      std::visit(ToCsv{csv}, value);
    }
    csv.end_row();
    if (text.size() > kChunk) {
      output->write(text);
      text.clear();
    }
  });
  output->write(text);
  output->close();
}

Section result(SqlSession& session, const std::string& statement) {
  Section section;
  section.name = "sql";
  section.title = "SQL";
  section.question = statement;
  DataTable table;
  table.name = "result";
  const auto head = [&](const std::vector<std::string>& names) {
    for (const std::string& name : names) {
      table.columns.push_back({name, "", "", false, false, ColumnType::exact});
    }
  };
  session.run(statement, head, [&](std::span<const SqlValue> row) {
    std::vector<Value>& cells = table.rows.emplace_back();
    for (const SqlValue& value : row) {
      cells.push_back(std::visit(ToCell{}, value));
    }
  });
  table.title =
      table.rows.empty() ? "rows" : fmt::format("{} row{}", table.rows.size(), table.rows.size() == 1 ? "" : "s");
  section.tables.push_back(std::move(table));
  return section;
}

}  // namespace

int run_sql(Job& job, const std::string& statement) {
  try {
    SqlSession session(*job.log);
    if (job.options.format == "csv") {
      write_csv(session, statement, job.options);
      tell_problems(*job.log);
      return kExitOk;
    }
    const Section section = result(session, statement);
    tell_problems(*job.log);
    return emit(section, job.origin(), job.options);
  } catch (const StatementError& error) {
    throw UsageError(error.what());
  }
}

}  // namespace tacho::commands
