#pragma once
// What `run` shows on a terminal: a line for the recording and a line per robot. Pure; console.* draws it.

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "recorder/snapshot.hpp"

namespace tacho::recorder {

struct Screen {
  std::size_t columns = 80;
  std::size_t rows = 24;
};

/// Lines that fit the screen: none wider, none more than there are rows less one for the cursor. On a narrow screen the
/// less important columns are left out; on a low one the robots with trouble come first, and the rest is counted.
std::vector<std::string> dashboard(const Snapshot& snapshot, Screen screen);

/// Columns that a terminal needs for UTF-8 text: Chinese and the like take two each.
std::size_t shown_width(std::string_view text);
/// The text cut and padded to `width` columns, without control characters.
std::string fitted(std::string_view text, std::size_t width);

}  // namespace tacho::recorder
