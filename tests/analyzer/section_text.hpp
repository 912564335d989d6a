#pragma once
// Ways into a Section for tests: tables, cells and findings by name, and a text in which every digit counts.

#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>

#include "analyzer/report/section.hpp"

namespace tacho::test {

inline const DataTable& table(const Section& section, std::string_view name) {
  for (const DataTable& t : section.tables) {
    if (t.name == name) {
      return t;
    }
  }
  throw std::runtime_error("no table " + std::string(name));
}

inline std::size_t column(const DataTable& table, std::string_view name) {
  for (std::size_t c = 0; c < table.columns.size(); ++c) {
    if (table.columns[c].name == name) {
      return c;
    }
  }
  throw std::runtime_error("no column " + std::string(name));
}

inline const Value& cell(const DataTable& table, std::size_t row, std::string_view name) {
  return table.rows.at(row).at(column(table, name));
}

/// `robot` empty: the finding about the whole log.
inline const Finding& finding(const Section& section, std::string_view id, std::string_view robot) {
  for (const Finding& f : section.findings) {
    if (f.id == id && f.robot == robot) {
      return f;
    }
  }
  throw std::runtime_error("no finding " + std::string(id) + " of " + std::string(robot));
}

inline const Grid& grid(const Section& section, std::size_t index = 0) { return section.grids.at(index); }

inline const GridLayer& layer(const Grid& grid, std::string_view name) {
  for (const GridLayer& l : grid.layers) {
    if (l.name == name) {
      return l;
    }
  }
  throw std::runtime_error("no layer " + std::string(name));
}

inline bool has_note(const Section& section, std::string_view part) {
  for (const std::string& note : section.notes) {
    if (note.find(part) != std::string::npos) {
      return true;
    }
  }
  return false;
}

inline double number(const Value& value) {
  if (const auto* d = std::get_if<double>(&value)) {
    return *d;
  }
  if (const auto* i = std::get_if<std::int64_t>(&value)) {
    return static_cast<double>(*i);
  }
  return std::get<Quantity>(value).value.value();
}

inline std::optional<Micros> time(const Value& value) {
  const auto* t = std::get_if<Time>(&value);
  return t != nullptr ? std::optional(t->us) : std::nullopt;
}

inline void print(std::ostream& out, const Quantity& q) {
  const auto number = [&](const std::optional<double>& d) { d ? out << *d << ' ' : out << "- "; };
  number(q.value);
  number(q.lo);
  number(q.hi);
  number(q.exposure);
  out << q.n.value_or(-1) << q.unit << q.reason;
}

inline void print(std::ostream& out, const Value& value) {
  if (const auto* missing = std::get_if<Missing>(&value)) {
    out << '-' << missing->reason;
  } else if (const auto* flag = std::get_if<bool>(&value)) {
    out << *flag;
  } else if (const auto* integer = std::get_if<std::int64_t>(&value)) {
    out << *integer;
  } else if (const auto* real = std::get_if<double>(&value)) {
    out << *real;
  } else if (const auto* string = std::get_if<std::string>(&value)) {
    out << *string;
  } else if (const auto* at = std::get_if<Time>(&value)) {
    out << at->us;
  } else {
    print(out, std::get<Quantity>(value));
  }
}

/// Everything in it, numbers with 17 digits: equal texts are equal results.
inline std::string text(const Section& section) {
  std::ostringstream out;
  out.precision(17);
  for (const std::string& note : section.notes) {
    out << note << '\n';
  }
  for (const Finding& f : section.findings) {
    out << f.id << f.robot << static_cast<int>(f.verdict) << f.threshold;
    print(out, f.value);
    for (const Evidence& e : f.evidence) {
      out << e.from_us << ' ' << e.to_us << e.source << e.note;
    }
    out << '\n';
  }
  for (const DataTable& t : section.tables) {
    out << t.name << '\n';
    for (const auto& row : t.rows) {
      for (const Value& value : row) {
        print(out, value);
        out << ';';
      }
      out << '\n';
    }
  }
  for (const Series& s : section.series) {
    for (std::size_t i = 0; i < s.value.size(); ++i) {
      out << s.name << s.robot << s.t_us[i] << ' ' << s.value[i] << '\n';
    }
  }
  for (const Grid& g : section.grids) {
    out << g.name << g.map << g.cell_m << ' ' << g.i0 << ' ' << g.j0 << ' ' << g.width << ' ' << g.height << '\n';
    for (const GridLayer& l : g.layers) {
      out << l.name;
      for (const double v : l.value) {
        out << ' ' << v;
      }
      out << '\n';
    }
  }
  return out.str();
}

}  // namespace tacho::test
