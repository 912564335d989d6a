#pragma once
// The field table as a Section: what every column means and where it comes from.

#include "analyzer/report/section.hpp"

namespace tacho::commands {

Section fields();

/// Every setting of every analysis with its default.
Section settings();

}  // namespace tacho::commands
