#include "analyzer/report/terminal.hpp"

#include "analyzer/report/text.hpp"
#include "tests/analyzer/example_section.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/golden.hpp"

using namespace tacho;
using namespace tacho::test;
using namespace tacho::report;

TEST_CASE("a section on a terminal reads as documented") {
  check_golden("tests/golden/report-example.txt", terminal_text(example_section(), {}));
}

TEST_CASE("columns are aligned by what a terminal shows") {
  DataTable table;
  table.title = "Names";
  table.columns = {{"name", "", ""}, {"count", "", ""}};
  table.rows = {{std::string("süd"), std::int64_t{1}},
                {std::string("二階"), std::int64_t{22}},
                {std::string("abcd"), std::int64_t{333}}};
  Section section;
  section.title = "T";
  section.tables = {table};
  const std::string text = terminal_text(section, {});
  CHECK(text.find("  süd       1\n") != std::string::npos);
  CHECK(text.find("  二階     22\n") != std::string::npos);
  CHECK(text.find("  abcd    333\n") != std::string::npos);
}

TEST_CASE("findings come worst first") {
  const std::string text = terminal_text(example_section(), {});
  const std::size_t fail = text.find("EXA-03");
  const std::size_t unknown = text.find("EXA-02");
  const std::size_t pass = text.find("EXA-01");
  CHECK(fail < unknown);
  CHECK(unknown < pass);
}

TEST_CASE("a robot's text cannot steer the terminal") {
  Section section;
  section.title = "bad\x1b[2Jtitle";
  section.notes = {"a\nb\x07"};
  section.tables = {{"t", "t", {{"x", "", ""}}, {{std::string("\x1b]0;gone\x07")}}, false}};
  const std::string text = terminal_text(section, {});
  CHECK(text.find('\x1b') == std::string::npos);
  CHECK(text.find('\x07') == std::string::npos);
}

TEST_CASE("long tables are cut and say so, detail tables wait for --all") {
  Section section;
  section.title = "T";
  DataTable table{"rows", "Rows", {{"i", "", ""}}, {}, false};
  for (std::int64_t i = 0; i < 40; ++i) {
    table.rows.push_back({i});
  }
  section.tables = {table, table};
  section.tables[1].title = "Details";
  section.tables[1].detail = true;
  const std::string cut = terminal_text(section, {});
  CHECK(cut.find("15 more rows") != std::string::npos);
  CHECK(cut.find("Details: 40 rows, shown with --all") != std::string::npos);
  TerminalOptions all;
  all.all = true;
  const std::string whole = terminal_text(section, all);
  CHECK(whole.find("more rows") == std::string::npos);
  CHECK(whole.find("\n  39\n") != std::string::npos);
}

TEST_CASE("times are shown in the zone asked for") {
  TerminalOptions options;
  options.zone = "+02:00";
  options.all = true;
  CHECK(terminal_text(example_section(), options).find("2026-01-01T02:00:00.123+02:00") != std::string::npos);
}

TEST_CASE("numbers get as many digits as their interval deserves") {
  CHECK(brief(bounded(1.00234567, 1.0011, 1.0035, "1")) == "1.0023 [1.0011, 1.0035]");
  CHECK(brief(bounded(1234.5678, 1200.0, 1300.0, "m")) == "1235 [1200, 1300] m");
  CHECK(brief(bounded(0.0, 0.0, 0.0, "m")) == "0 [0, 0] m");
  CHECK(brief(quantity(0.1 + 0.2, "V")) == "0.3 V");
  CHECK(brief(unknown("no data")) == "(no data)");
  CHECK(brief(123456789.0) == "123456789");
  CHECK(brief(1e-7) == "1.0000e-07");
  CHECK(brief(-0.0) == "0");
  CHECK(brief(kNaN) == "-");
  Quantity open = bounded(2.0, 1.0, 3.0, "1/h");
  open.hi = std::numeric_limits<double>::infinity();
  CHECK(brief(open) == "2 [1, inf] 1/h");
}

TEST_CASE("widths count what is shown") {
  CHECK(display_width("abc") == 3);
  CHECK(display_width("süd") == 3);
  CHECK(display_width("二階") == 4);
  CHECK(display_width("e\xCC\x81") == 1);
  CHECK(display_width("\xFF\xC3") == 2);
  CHECK(shortened("abcdef", 4) == "abc…");
  CHECK(shortened("二階建て", 5) == "二階…");
  CHECK(shortened("abc", 3) == "abc");
}

TEST_CASE("file names hold nothing that a file system or a shell minds") {
  CHECK(file_stem("AMB-01 / Süd") == "amb-01___s__d");
  CHECK(file_stem("") == "unnamed");
  CHECK(file_stem("../x").find('/') == std::string::npos);
  CHECK(file_stem("..") != "..");
}
