#include "analyzer/commands/export.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>

#include "analyzer/commands/output.hpp"
#include "analyzer/report/csv.hpp"
#include "analyzer/report/folder.hpp"
#include "analyzer/report/text.hpp"
#include "schema/docs.hpp"
#include "schema/error.hpp"
#include "schema/json_text.hpp"
#include "schema/store/sql/sqlite_export.hpp"
#include "schema/text.hpp"
#include "schema/time.hpp"

namespace tacho::commands {
namespace {

namespace fs = std::filesystem;
using report::CsvColumn;
using report::CsvWriter;

std::vector<Coverage> coverage_of(const Job& job) {
  std::vector<Coverage> all = job.log->coverage();
  std::erase_if(all, [&](const Coverage& c) {
    return c.stored == 0 ||
           std::none_of(job.robots.begin(), job.robots.end(), [&](const Robot& r) { return r.id == c.robot; });
  });
  return all;
}

Source choose_source(const Job& job, const std::string& name) {
  Source source = Source::status;
  if (!name.empty() && !parse_source(name, source)) {
    throw UsageError("--source " + name + ": no such source" + did_you_mean(name, source_names()));
  }
  const std::vector<Coverage> all = coverage_of(job);
  const auto has = [&](Source s) {
    return std::any_of(all.begin(), all.end(), [&](const Coverage& c) { return c.source == s; });
  };
  if (name.empty() && !has(Source::status) && !all.empty()) {
    source = all.front().source;
  }
  if (!all.empty() && !has(source)) {
    throw Error("source " + std::string(source_name(source)), "these robots have no answers of it in this log",
                "`tacho-analyzer info` lists what there is");
  }
  return source;
}

FieldSet choose_fields(const Job& job, Source source, const std::vector<std::string>& wanted,
                       std::vector<FieldIndex>& order) {
  FieldSet set;
  for (const std::string& name : wanted) {
    const FieldIndex f = find_field(name);
    if (f == kNoField) {
      const std::string_view near = nearest_field(name);
      throw UsageError(
          "--fields " + name + ": no such field" +
          (near.empty() ? "; `tacho-analyzer fields` lists them" : "; did you mean '" + std::string(near) + "'?"));
    }
    if (!set.test(f)) {
      order.push_back(f);
    }
    set.set(f);
  }
  if (!wanted.empty()) {
    return set;
  }
  for (const Coverage& c : coverage_of(job)) {
    set |= c.source == source ? c.seen : FieldSet{};
  }
  for (std::size_t f = 0; f < kFieldCount; ++f) {
    if (set.test(f)) {
      order.push_back(static_cast<FieldIndex>(f));
    }
  }
  return set;
}

std::string alarm_codes(const Batch& batch, std::size_t row, std::string_view array) {
  std::string out;
  for (const AlarmItem& item : batch.alarms_of(row)) {
    if (std::string(alarm_level_name(item.level)) + "s" == array) {
      out += (out.empty() ? "" : " ") + std::to_string(item.code);
    }
  }
  return out;
}

std::string point_states(const Batch& batch, std::size_t row, bool output) {
  std::string out;
  for (const IoPoint& p : batch.points_of(row)) {
    if (p.output == output) {
      out += fmt::format("{}{}={}", out.empty() ? "" : " ", p.id, p.status ? 1 : 0);
    }
  }
  return out;
}

struct Row {
  const Robot& robot;
  SessionId session;
  const Batch& batch;
  std::size_t at;
};

/// One format of exported rows.
class RowFormat {
 public:
  RowFormat(std::vector<FieldIndex> fields, bool states) : fields_(std::move(fields)), states_(states) {}
  virtual ~RowFormat() = default;
  virtual void header(std::string& out) = 0;
  virtual void row(std::string& out, const Row& row) = 0;

 protected:
  std::vector<FieldIndex> fields_;
  bool states_;

  /// Null when the row cannot have the field.
  static const Column* present(const Row& row, FieldIndex f) {
    const Column* column = row.batch.find(f);
    return column != nullptr && column->has(row.at) ? column : nullptr;
  }
  static State state(const Row& row, FieldIndex f) {
    const Column* column = row.batch.find(f);
    return column == nullptr ? State::absent : column->state[row.at];
  }
};

class CsvRows final : public RowFormat {
 public:
  using RowFormat::RowFormat;

  [[nodiscard]] std::vector<CsvColumn> columns() const {
    std::vector<CsvColumn> out{{"robot", "", "text", "robot"},
                               {"session", "", "integer", "start of the recorder"},
                               {"seq", "", "integer", "number of the planned poll"},
                               {"t_utc", "", "time", "middle of the poll (ISO 8601, UTC)"},
                               {"t_unix_ms", "ms", "integer", "middle of the poll (since 1970-01-01 UTC)"},
                               {"t_send_us", "us", "integer", "request sent (since 1970-01-01 UTC)"},
                               {"t_recv_us", "us", "integer", "answer received (since 1970-01-01 UTC)"}};
    for (const FieldIndex f : fields_) {
      const Field& field = kFields[f];
      out.push_back({std::string(field.name), std::string(field.unit), std::string(kind_name(field.kind)),
                     std::string(field.meaning)});
      if (states_) {
        out.push_back({std::string(field.name) + "_state", "", "text", "whether there is a value, and why not"});
      }
    }
    return out;
  }

  void header(std::string& out) override {
    CsvWriter csv(out);
    for (const CsvColumn& column : columns()) {
      csv.text(column.name);
    }
    csv.end_row();
  }

  void row(std::string& out, const Row& row) override {
    CsvWriter csv(out);
    csv.text(row.robot.name);
    csv.integer(row.session);
    csv.integer(static_cast<std::int64_t>(row.batch.seq[row.at]));
    csv.time(row.batch.t_mid_us(row.at));
    csv.integer(row.batch.t_send_us[row.at]);
    csv.integer(row.batch.t_recv_us[row.at]);
    for (const FieldIndex f : fields_) {
      cell(csv, row, f);
      if (states_) {
        csv.text(state_name(state(row, f)));
      }
    }
    csv.end_row();
  }

 private:
  static void cell(CsvWriter& csv, const Row& row, FieldIndex f) {
    const Column* column = present(row, f);
    if (column == nullptr) {
      csv.empty();
      return;
    }
    switch (kFields[f].kind) {
      case Kind::real:
        csv.number(column->real[row.at]);
        return;
      case Kind::flag:
        csv.flag(column->integer[row.at] != 0);
        return;
      case Kind::integer:
      case Kind::code:
        csv.integer(column->integer[row.at]);
        return;
      case Kind::alarms:
        csv.text(alarm_codes(row.batch, row.at, kFields[f].name));
        return;
      case Kind::points:
        csv.text(point_states(row.batch, row.at, kFields[f].name == "do"));
        return;
      case Kind::text:
      case Kind::list:
      case Kind::structured:
        csv.text(row.batch.text(*column, row.at));
        return;
    }
  }
};

class JsonRows final : public RowFormat {
 public:
  using RowFormat::RowFormat;
  void header(std::string&) override {}

  void row(std::string& out, const Row& row) override {
    out += "{\"robot\":" + report::json_string(row.robot.name);
    out += fmt::format(",\"session\":{},\"seq\":{},\"t_utc\":\"{}\",\"t_send_us\":{},\"t_recv_us\":{}", row.session,
                       row.batch.seq[row.at], iso_utc(row.batch.t_mid_us(row.at)), row.batch.t_send_us[row.at],
                       row.batch.t_recv_us[row.at]);
    std::string states;
    for (const FieldIndex f : fields_) {
      const State s = state(row, f);
      if (s == State::absent) {
        continue;
      }
      out += fmt::format(",\"{}\":", kFields[f].name);
      if (s == State::present) {
        cell(out, row, f);
        continue;
      }
      out += "null";
      states += fmt::format("{}\"{}\":\"{}\"", states.empty() ? "" : ",", kFields[f].name, state_name(s));
    }
    if (states_) {
      out += ",\"states\":{" + states + "}";
    }
    out += "}\n";
  }

 private:
  static void cell(std::string& out, const Row& row, FieldIndex f) {
    const Column& column = *present(row, f);
    switch (kFields[f].kind) {
      case Kind::real: {
        const std::string number = report::exact(column.real[row.at]);
        out += number.empty() ? "null" : number;
        return;
      }
      case Kind::flag:
        out += column.integer[row.at] != 0 ? "true" : "false";
        return;
      case Kind::integer:
      case Kind::code:
        out += report::exact(column.integer[row.at]);
        return;
      case Kind::alarms:
        out += alarms_json(row.batch, row.at, kFields[f].name);
        return;
      case Kind::points:
        out += points_json(row.batch, row.at, kFields[f].name == "do");
        return;
      case Kind::text:
        out += report::json_string(row.batch.text(column, row.at));
        return;
      case Kind::list:
      case Kind::structured:
        json(out, row.batch.text(column, row.at));
        return;
    }
  }

  /// JSON text as it was sent, on one line: a line break can only be white space between its tokens.
  static void json(std::string& out, std::string_view text) {
    for (const char c : text) {
      out += c == '\n' || c == '\r' ? ' ' : c;
    }
  }
};

void write_rows(Job& job, Source source, const FieldSet& fields, RowFormat& format, Output& output) {
  Selection selection;
  selection.fields[static_cast<std::size_t>(source)] = fields;
  selection.rows[static_cast<std::size_t>(source)] = true;
  std::string text;
  format.header(text);
  for (const Robot& robot : job.robots) {
    job.log->read(robot.id, job.window, selection, [&](const Slice& slice) {
      if (const Batch* batch = slice.find(source)) {
        for (std::size_t i = 0; i < batch->rows(); ++i) {
          format.row(text, {robot, slice.session, *batch, i});
        }
      }
      output.write(text);
      text.clear();
    });
  }
  output.write(text);
  output.close();
}

std::string schema_path(const std::string& output) {
  const fs::path path(output);
  return (path.parent_path() / (path.stem().string() + ".schema.csv")).string();
}

}  // namespace

void export_rows(Job& job, const ExportOptions& options) {
  if (job.robots.empty()) {
    throw Error("export", "this log holds no robot", "`tacho-analyzer info` says what it holds");
  }
  const Source source = choose_source(job, options.source);
  std::vector<FieldIndex> order;
  const FieldSet fields = choose_fields(job, source, options.fields, order);
  Output output(job.options.output);
  if (job.options.format == "json") {
    JsonRows rows(std::move(order), options.states);
    write_rows(job, source, fields, rows, output);
    return;
  }
  CsvRows rows(std::move(order), options.states);
  write_rows(job, source, fields, rows, output);
  if (!job.options.output.empty()) {
    report::CsvSchema schema;
    schema.add(fs::path(job.options.output).filename().string(), rows.columns());
    report::write_file(schema_path(job.options.output), schema.text());
  }
}

void export_database(Job& job, const ExportOptions& options) {
  if (job.options.output.empty()) {
    throw UsageError("--format sqlite writes a file: give its name with -o");
  }
  if (options.states) {
    throw UsageError("--states: the wide tables have no place for them; `tacho-analyzer sql` has a column states");
  }
  store::sql::SqliteExport what;
  what.robots = job.robots;
  what.window = job.window;
  what.fields.set();
  if (!options.fields.empty()) {
    std::vector<FieldIndex> order;
    what.fields = choose_fields(job, Source::status, options.fields, order);
  }
  if (options.source.empty()) {
    what.sources.assign(all_sources().begin(), all_sources().end());
  } else {
    what.sources = {choose_source(job, options.source)};
  }
  const std::uint64_t rows = store::sql::export_sqlite(*job.log, what, job.options.output);
  std::fprintf(stderr, "tacho-analyzer: %s: %llu rows\n", job.options.output.c_str(),
               static_cast<unsigned long long>(rows));
}

void export_raw(Job& job, const ExportOptions& options) {
  if (job.robots.size() != 1) {
    throw UsageError(job.robots.empty() ? "--raw: this log holds no robot"
                                        : "--raw: answers do not say whose they are; choose one robot with --robot");
  }
  const Source source = choose_source(job, options.source);
  const bool json = source_info(source).encoding == Encoding::json;
  job.log->read_raw(job.robots.front().id, source, job.window, [&](const Answer& answer) {
    if (job.options.output.empty()) {
      write_stdout(answer.body + "\n");
      return;
    }
    const std::string name =
        fmt::format("{:04}-{:010}.{}", answer.meta.session, answer.meta.seq, json ? "json" : "bin");
    report::write_file(fs::path(job.options.output) / name, answer.body);
  });
}

}  // namespace tacho::commands
