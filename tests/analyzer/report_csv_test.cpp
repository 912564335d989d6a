#include "analyzer/report/csv.hpp"

#include <charconv>
#include <clocale>
#include <cstring>
#include <random>

#include "tests/analyzer/example_section.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/golden.hpp"

using namespace tacho;
using namespace tacho::test;
using report::CsvWriter;

namespace {

using Rows = std::vector<std::vector<std::string>>;

/// RFC 4180, strictly: CRLF ends a record, quotes only around whole fields. Fails the test on anything else.
Rows parse(const std::string& text) {
  Rows rows;
  std::vector<std::string> row;
  std::string field;
  std::size_t i = 0;
  while (i < text.size()) {
    field.clear();
    if (text[i] == '"') {
      for (++i; i < text.size() && (text[i] != '"' || (i + 1 < text.size() && text[i + 1] == '"')); ++i) {
        i += text[i] == '"' ? 1U : 0U;
        field += text[i];
      }
      ++i;
    } else {
      for (; i < text.size() && text[i] != ',' && text[i] != '\r'; ++i) {
        REQUIRE(text[i] != '"');
        REQUIRE(text[i] != '\n');
        field += text[i];
      }
    }
    row.push_back(field);
    REQUIRE(i < text.size());
    if (text[i] == ',') {
      ++i;
      if (i == text.size() || text[i] == '\r') {
        row.emplace_back();
      }
    }
    if (text[i] == '\r') {
      REQUIRE(text[i + 1] == '\n');
      i += 2;
      rows.push_back(row);
      row.clear();
    }
  }
  return rows;
}

double number(const std::string& text) {
  double value = 0.0;
  const auto end = std::from_chars(text.data(), text.data() + text.size(), value);
  REQUIRE(end.ptr == text.data() + text.size());
  return value;
}

std::string one_text(std::string_view value) {
  std::string out;
  CsvWriter csv(out);
  csv.text(value);
  csv.end_row();
  return out;
}

}  // namespace

TEST_CASE("a table is written as documented") {
  check_golden("tests/golden/report-episodes.csv", report::csv_text(example_table()));
}

TEST_CASE("times are two columns, intervals three, a missing value is empty and never 0") {
  const Rows rows = parse(report::csv_text(example_table()));
  REQUIRE(rows.size() == 4);
  const std::vector<std::string> header{"start_utc",  "start_unix_ms", "robot",   "loaded", "polls",
                                        "duration_s", "rate",          "rate_lo", "rate_hi"};
  CHECK(rows[0] == header);
  CHECK(rows[1][0] == "2026-01-01T00:00:00.123Z");
  CHECK(rows[1][1] == "1767225600123");
  CHECK(rows[1][4] == "9007199254740993");
  CHECK(rows[2][2] == "halle, \"süd\"\n二");
  CHECK(rows[2][5].empty());
  CHECK(rows[2][6].empty());
  CHECK(rows[3][0].empty());
  CHECK(rows[3][3].empty());
  CHECK(rows[3][4] == "-3");
  CHECK(rows[3][5] == "-0.25");
}

TEST_CASE("text that a spreadsheet would run gets an apostrophe, numbers never") {
  for (const char* text : {"=1+1", "+1", "-1", "@x", "\tx", "\rx"}) {
    CHECK(parse(one_text(text))[0][0] == std::string("'") + text);
  }
  CHECK(parse(one_text(std::string_view("\0x", 2)))[0][0] == std::string("'\0x", 3));
  CHECK(one_text("a=b") == "a=b\r\n");
  std::string out;
  CsvWriter csv(out);
  csv.number(-1.5);
  csv.integer(-7);
  csv.end_row();
  CHECK(out == "-1.5,-7\r\n");
}

TEST_CASE("any text comes back from CSV, whatever is in it") {
  std::mt19937 random(7);
  const std::string letters = "ab,\"\r\n ;\xC3\xBC";
  for (int round = 0; round < 500; ++round) {
    std::string text = "x";
    for (std::size_t n = random() % 12; n > 0; --n) {
      text += letters[random() % letters.size()];
    }
    const Rows rows = parse(one_text(text));
    REQUIRE(rows.size() == 1);
    CHECK(rows[0][0] == text);
  }
}

TEST_CASE("any number comes back from CSV bit for bit") {
  std::mt19937_64 random(11);
  for (int round = 0; round < 2000; ++round) {
    const std::uint64_t bits = random();
    double value = 0.0;
    std::memcpy(&value, &bits, sizeof value);
    if (!std::isfinite(value)) {
      continue;
    }
    std::string out;
    CsvWriter csv(out);
    csv.number(value);
    csv.end_row();
    const double back = number(parse(out)[0][0]);
    CHECK(std::memcmp(&back, &value, sizeof value) == 0);
  }
}

TEST_CASE("NaN and infinities are empty") {
  std::string out;
  CsvWriter csv(out);
  csv.number(kNaN);
  csv.number(std::numeric_limits<double>::infinity());
  csv.end_row();
  CHECK(out == ",\r\n");
}

TEST_CASE("the locale of the host changes nothing") {
  const std::string before = report::csv_text(example_table());
  const std::string old = std::setlocale(LC_ALL, nullptr);
  for (const char* name : {"de_DE.UTF-8", "fr_FR.UTF-8", "C.UTF-8"}) {
    std::setlocale(LC_ALL, name);  // one that is not installed changes nothing
    CHECK(report::csv_text(example_table()) == before);
  }
  std::setlocale(LC_ALL, old.c_str());
}

TEST_CASE("a time column keeps its two headers in a table without rows") {
  DataTable table = example_table();
  table.rows.clear();
  const Rows rows = parse(report::csv_text(table));
  REQUIRE(rows.size() == 1);
  CHECK(rows[0][0] == "start_utc");
  CHECK(rows[0].size() == 9);
}

TEST_CASE("the files of a section cover every table, curve and map, and schema.csv describes every column of them") {
  const std::vector<report::File> files = report::csv_files(example_section());
  std::vector<std::string> names;
  for (const report::File& file : files) {
    names.push_back(file.name);
  }
  CHECK(names == std::vector<std::string>{"findings.csv", "evidence.csv", "episodes.csv", "series_voltage.csv",
                                          "grid_blocked.csv", "schema.csv"});
  const Rows schema = parse(files.back().bytes);
  for (const report::File& file : files) {
    if (file.name == "schema.csv") {
      continue;
    }
    const Rows rows = parse(file.bytes);
    for (const std::vector<std::string>& row : rows) {
      CHECK(row.size() == rows[0].size());
    }
    for (const std::string& column : rows[0]) {
      INFO(file.name << " " << column);
      CHECK(std::count_if(schema.begin(), schema.end(), [&](const std::vector<std::string>& line) {
              return line[0] == file.name && line[1] == column;
            }) == 1);
    }
  }
}

TEST_CASE("a map is written as centres of visited cells") {
  const std::vector<report::File> files = report::csv_files(example_section());
  const Rows rows = parse(files[4].bytes);
  REQUIRE(rows.size() == 5);  // header and four visited cells
  CHECK(rows[0] == std::vector<std::string>{"x_m", "y_m", "lost_s", "rate", "opacity"});
  CHECK(rows[2] == std::vector<std::string>{"-0.25", "1.75", "10", "1", "1"});
  CHECK(rows[4][0] == "0.25");
  CHECK(rows[4][1] == "2.25");
}

TEST_CASE("curves of one name share a file, with the robot in a column and gaps empty") {
  const Rows rows = parse(report::csv_files(example_section())[3].bytes);
  REQUIRE(rows.size() == 4);
  CHECK(rows[1] == std::vector<std::string>{"amb-01", "2026-01-01T00:00:00.123Z", "1767225600123", "52.347"});
  CHECK(rows[2][3].empty());
  CHECK(rows[3][0] == "amb-02");
}

TEST_CASE("a column whose cells bring their own units gets a unit column") {
  DataTable table;
  table.name = "measures";
  table.columns = {{"measure", "", "what"}, {"value", "", "how much", false, false, ColumnType::own_units}};
  table.rows = {{std::string("length"), quantity(2.0, "m")}, {std::string("share"), unknown("no data")}};
  const Rows rows = parse(report::csv_text(table));
  CHECK(rows[0] == std::vector<std::string>{"measure", "value", "value_unit"});
  CHECK(rows[1] == std::vector<std::string>{"length", "2", "m"});
  CHECK(rows[2] == std::vector<std::string>{"share", "", ""});
}

TEST_CASE("columns and their types are the same whatever the rows hold") {
  Section filled = example_section();
  Section empty = example_section();
  empty.findings = {finding("EXA-01", Verdict::unknown, 0, unknown("no data"))};
  for (DataTable& table : empty.tables) {
    table.rows.clear();
  }
  const std::vector<report::File> with = report::csv_files(filled);
  const std::vector<report::File> without = report::csv_files(empty);
  REQUIRE(with.size() == without.size());
  for (std::size_t i = 0; i < with.size(); ++i) {
    INFO(with[i].name);
    CHECK(with[i].name == without[i].name);
    CHECK(parse(with[i].bytes)[0] == parse(without[i].bytes)[0]);
  }
  CHECK(with.back().name == "schema.csv");
  CHECK(with.back().bytes == without.back().bytes);
  CHECK(with.back().bytes.find("findings.csv,value_unit,,text,") != std::string::npos);
  CHECK(with.back().bytes.find("findings.csv,exposure,,number,") != std::string::npos);
  CHECK(with.back().bytes.find("episodes.csv,loaded,,boolean,") != std::string::npos);
}
