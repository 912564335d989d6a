#pragma once
// CSV by RFC 4180: comma, CRLF, header row, UTF-8 without byte order mark, point as decimal mark whatever the locale.
// Numbers are the shortest text that reads back the same; no value is an empty field, never 0. Text that a spreadsheet
// would take for a formula (it starts with = + - @ TAB CR NUL) gets a leading apostrophe; numeric columns never.

#include <string>
#include <string_view>
#include <vector>

#include "analyzer/report/section.hpp"

namespace tacho::report {

/// One file of a report: its name inside the folder of its section, and its bytes.
struct File {
  std::string name;
  std::string bytes;
};

/// Appends rows to a text. Used row by row, so that an export needs no more memory than one row.
class CsvWriter {
 public:
  explicit CsvWriter(std::string& out) : out_(out) {}
  void text(std::string_view value);
  void number(double value);  ///< empty for NaN and infinities
  void integer(std::int64_t value);
  void flag(bool value);   ///< true, false
  void time(Micros t_us);  ///< two fields: ISO 8601 UTC with milliseconds, and unix milliseconds
  void empty();
  void end_row();

 private:
  std::string& out_;
  bool first_ = true;
  void separate();
};

/// A column as written: one ColumnSpec can become several.
struct CsvColumn {
  std::string name;
  std::string unit;
  std::string type;  ///< text, number, integer, boolean, time
  std::string description;
};

/// One row per column of every file: file,column,unit,type,description.
class CsvSchema {
 public:
  CsvSchema();
  void add(std::string_view file, const std::vector<CsvColumn>& columns);
  [[nodiscard]] const std::string& text() const { return text_; }

 private:
  std::string text_;
};

/// The columns of a table as its CSV has them.
std::vector<CsvColumn> csv_columns(const DataTable& table);
std::string csv_text(const DataTable& table);

/// findings.csv, evidence.csv, a file per table, per series name and per grid, and schema.csv.
std::vector<File> csv_files(const Section& section);

/// The findings as a table, in the order of the section.
DataTable findings_table(const Section& section);
DataTable evidence_table(const Section& section);

}  // namespace tacho::report
