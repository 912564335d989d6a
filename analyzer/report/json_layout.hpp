#pragma once
// JSON text that a person can read and a diff can compare: what fits on a line stays on a line.

#include <nlohmann/json.hpp>
#include <string>

namespace tacho::report {

/// `document` as text with a final newline. Containers longer than a line are broken, one member per line; arrays of
/// numbers are filled into lines. Text that is not UTF-8 gets U+FFFD in place of each broken byte.
std::string laid_out(const nlohmann::ordered_json& document);

}  // namespace tacho::report
