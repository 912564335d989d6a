#include "analyzer/report/terminal.hpp"

#include <algorithm>

#include "analyzer/report/text.hpp"
#include "schema/time.hpp"

namespace tacho::report {
namespace {

constexpr std::size_t kTextWidth = 110;

std::string padded(const std::string& text, std::size_t width, bool right) {
  const std::size_t have = display_width(text);
  const std::string space(width > have ? width - have : 0, ' ');
  return right ? space + text : text + space;
}

std::string wrapped(const std::string& text, std::size_t indent) {
  std::string out;
  std::size_t used = 0;
  std::string_view rest = text;
  while (!rest.empty()) {
    const std::size_t end = std::min(rest.find(' '), rest.size());
    const std::string_view word = rest.substr(0, end);
    rest.remove_prefix(std::min(end + 1, rest.size()));
    if (word.empty()) {
      continue;
    }
    const std::size_t width = display_width(word);
    if (used == 0 || used + 1 + width > kTextWidth - indent) {
      out += out.empty() ? "" : "\n";
      out.append(indent, ' ');
      used = 0;
    } else {
      out += ' ';
      ++used;
    }
    out += word;
    used += width;
  }
  return out.empty() ? out : out + "\n";
}

std::string time_text(Micros t_us, const std::string& zone) {
  return zone == "UTC" ? iso_utc(t_us) : iso_zone(t_us, zone);
}

std::string coloured(Verdict verdict, bool colour) {
  const std::string name(verdict_name(verdict));
  if (!colour) {
    return name;
  }
  const char* code = verdict == Verdict::fail      ? "\x1b[1;31m"
                     : verdict == Verdict::warn    ? "\x1b[1;33m"
                     : verdict == Verdict::unknown ? "\x1b[1;35m"
                     : verdict == Verdict::pass    ? "\x1b[32m"
                                                   : "";
  return *code == '\0' ? name : code + name + "\x1b[0m";
}

struct CellText {
  const TerminalOptions& options;
  const ColumnSpec& column;
  std::string operator()(const Missing&) const { return "-"; }
  std::string operator()(bool value) const { return value ? "yes" : "no"; }
  std::string operator()(std::int64_t value) const { return exact(value); }
  std::string operator()(double value) const { return column.type == ColumnType::exact ? exact(value) : brief(value); }
  std::string operator()(const std::string& value) const {
    const std::string line = one_line(value);
    return options.all ? line : shortened(line, options.cell);
  }
  std::string operator()(const Time& value) const { return time_text(value.us, options.zone); }
  std::string operator()(const Quantity& value) const {
    if (!value.value) {
      return value.reason.empty() ? "-" : (*this)(brief(value));
    }
    Quantity shown = value;
    shown.unit = value.unit == column.unit ? "" : value.unit;  // the header has said it
    return brief(shown);
  }
};

bool numeric(const Value& value) {
  return std::holds_alternative<std::int64_t>(value) || std::holds_alternative<double>(value) ||
         std::holds_alternative<Quantity>(value);
}

/// Reasons of missing values, each once: a "-" without its reason would be a riddle.
std::vector<std::string> reasons(const DataTable& table, std::size_t rows) {
  std::vector<std::string> out;
  for (std::size_t r = 0; r < rows; ++r) {
    for (const Value& value : table.rows[r]) {
      const auto* missing = std::get_if<Missing>(&value);
      if (missing != nullptr && !missing->reason.empty() &&
          std::find(out.begin(), out.end(), missing->reason) == out.end()) {
        out.push_back(missing->reason);
      }
    }
  }
  return out;
}

std::string column_title(const ColumnSpec& column) {
  const bool named = column.unit.empty() || column.unit == "1" || column.name.ends_with("_" + column.unit);
  return named ? column.name : column.name + " [" + column.unit + "]";
}

struct Grid2D {
  std::vector<std::vector<std::string>> rows;  // the first one is the header
  std::vector<std::size_t> width;
  std::vector<bool> right;
};

Grid2D cells_of(const DataTable& table, const TerminalOptions& options, std::size_t shown) {
  Grid2D grid;
  grid.rows.emplace_back();
  for (const ColumnSpec& column : table.columns) {
    grid.rows[0].push_back(column_title(column));
  }
  grid.right.assign(table.columns.size(), false);
  for (std::size_t r = 0; r < shown; ++r) {
    grid.rows.emplace_back();
    for (std::size_t c = 0; c < table.columns.size(); ++c) {
      grid.rows.back().push_back(std::visit(CellText{options, table.columns[c]}, table.rows[r][c]));
      grid.right[c] = grid.right[c] || numeric(table.rows[r][c]);
    }
  }
  grid.width.assign(table.columns.size(), 0);
  for (const std::vector<std::string>& row : grid.rows) {
    for (std::size_t c = 0; c < row.size(); ++c) {
      grid.width[c] = std::max(grid.width[c], display_width(row[c]));
    }
  }
  return grid;
}

std::string table_text(const DataTable& table, const TerminalOptions& options) {
  const std::string title = "\n" + one_line(table.title.empty() ? table.name : table.title);
  if (table.rows.empty()) {
    return title + ": none\n";
  }
  if (table.detail && !options.all) {
    return title + ": " + std::to_string(table.rows.size()) + " rows, shown with --all\n";
  }
  const std::size_t shown = options.all ? table.rows.size() : std::min(table.rows.size(), options.rows);
  const Grid2D grid = cells_of(table, options, shown);
  std::string out = title + "\n";
  for (std::size_t r = 0; r < grid.rows.size(); ++r) {
    std::string line = " ";
    for (std::size_t c = 0; c < grid.rows[r].size(); ++c) {
      line += " " + padded(grid.rows[r][c], grid.width[c], grid.right[c]) + " ";
    }
    line.erase(line.find_last_not_of(' ') + 1);
    out += line + "\n";
    if (r == 0) {
      std::string rule = " ";
      for (const std::size_t width : grid.width) {
        rule += " " + std::string(width, '-') + " ";
      }
      rule.erase(rule.find_last_not_of(' ') + 1);
      out += rule + "\n";
    }
  }
  if (shown < table.rows.size()) {
    out += "  ... " + std::to_string(table.rows.size() - shown) + " more rows, shown with --all\n";
  }
  for (const std::string& reason : reasons(table, shown)) {
    out += wrapped("-: " + one_line(reason), 2);
  }
  return out;
}

}  // namespace

std::string terminal_text(const Finding& f, const TerminalOptions& options) {
  std::string out = "  " + coloured(f.verdict, options.colour);
  out.append(9 - verdict_name(f.verdict).size(), ' ');
  out += padded(f.id, 8, false) + one_line(f.title);
  if (!f.robot.empty()) {
    out += " (" + one_line(f.robot) + ")";
  }
  if (f.value.value) {
    out += ": " + brief(f.value);
  }
  out += "\n";
  constexpr std::size_t indent = 11;
  if ((!f.value.value || f.verdict == Verdict::unknown) && !f.value.reason.empty()) {
    out += wrapped("reason: " + one_line(f.value.reason), indent);
  }
  if (!f.threshold.empty()) {
    const std::string source = f.threshold_source.empty() ? "" : " (" + f.threshold_source + ")";
    out += wrapped("limits: " + one_line(f.threshold) + source, indent);
  }
  const std::size_t shown = options.all ? f.evidence.size() : std::min<std::size_t>(f.evidence.size(), 3);
  for (std::size_t i = 0; i < shown; ++i) {
    const Evidence& e = f.evidence[i];
    out += wrapped("seen: " + time_text(e.from_us, options.zone) + " to " + time_text(e.to_us, options.zone) +
                       (e.source.empty() ? "" : ", " + e.source) + (e.note.empty() ? "" : ": " + one_line(e.note)),
                   indent);
  }
  if (shown < f.evidence.size()) {
    out += wrapped("... " + std::to_string(f.evidence.size() - shown) + " more", indent);
  }
  if (!f.advice.empty() && f.verdict != Verdict::pass) {
    out += wrapped("do: " + one_line(f.advice), indent);
  }
  return out;
}

std::string terminal_text(const Section& section, const TerminalOptions& options) {
  const std::string head = section.title + (section.question.empty() ? "" : " - " + section.question);
  std::string out = one_line(head) + "\n" + std::string(display_width(one_line(head)), '=') + "\n";
  if (!section.findings.empty()) {
    out += "\n";
    for (const Finding& finding : worst_first(section.findings)) {
      out += terminal_text(finding, options);
    }
  }
  for (const DataTable& table : section.tables) {
    out += table_text(table, options);
  }
  std::string curves;
  for (const Series& series : section.series) {
    const std::string name = series.name + (series.robot.empty() ? "" : " of " + series.robot);
    curves += (curves.empty() ? "" : ", ") + name;
  }
  std::string maps;
  for (const Grid& grid : section.grids) {
    maps += (maps.empty() ? "" : ", ") + grid.name;
  }
  out += curves.empty() && maps.empty() ? "" : "\n";
  if (!curves.empty()) {
    out += wrapped("Curves (--format csv or json with -o): " + one_line(curves), 0);
  }
  if (!maps.empty()) {
    out += wrapped("Maps (--format csv, json or png with -o): " + one_line(maps), 0);
  }
  if (!section.notes.empty()) {
    out += "\nNotes\n";
    for (const std::string& note : section.notes) {
      out += wrapped("- " + one_line(note), 2);
    }
  }
  return out;
}

}  // namespace tacho::report
