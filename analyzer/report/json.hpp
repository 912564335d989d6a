#pragma once
// Sections as one JSON document (RFC 8259, UTF-8). Numbers of findings and tables are objects with value, unit, lo, hi,
// n and exposure; a value that is missing, NaN or infinite is null, with the reason beside it. Series and grids are
// packed: one unit, one array, null where nothing is known. Key order is fixed, and nothing depends on the time of day.

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "analyzer/report/section.hpp"
#include "schema/row_source.hpp"

namespace tacho::report {

inline constexpr const char* kJsonFormat = "tachograph-report";
inline constexpr int kJsonVersion = 1;  ///< a higher one may remove or rename; additions do not raise it

/// A threshold or fact as it was used.
struct UsedSetting {
  std::string name;  ///< "odometry.v_max_mps", or "NAME/..." for one robot
  Quantity value;
  std::string source;
};

/// What the sections were made from.
struct Origin {
  std::string tool;  ///< "tacho-analyzer 0.1.0"
  Window window;     ///< the period asked for; open ends are null in JSON
  std::string zone = "UTC";
  std::vector<std::string> robots;
  std::vector<UsedSetting> settings;
};

/// `text` as a JSON string with its quotes; broken UTF-8 becomes U+FFFD.
std::string json_string(std::string_view text);

std::string json_text(std::span<const Section> sections, const Origin& origin);

}  // namespace tacho::report
