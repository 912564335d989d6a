#pragma once
// Small makers of table cells and verdicts that several analyses need.

#include <optional>
#include <string>

#include "analyzer/math/poisson.hpp"
#include "analyzer/report/section.hpp"
#include "schema/fields.hpp"

namespace tacho::cells {

/// A value or the reason why there is none.
Value maybe(std::optional<double> value, const std::string& reason);
Value maybe(std::optional<std::int64_t> value, const std::string& reason);
/// Empty text becomes Missing.
Value text(std::string_view value, const std::string& reason);
/// The name of a code, or its number where the list does not know it.
Value code(FieldIndex f, const std::optional<std::int64_t>& code);

Quantity missing(const std::string& unit, const std::string& reason);
Quantity bounded(double value, double lo, double hi, const std::string& unit);
/// Events per `unit_exposure` of the exposure's own unit. Without exposure: missing.
Quantity rate(double k, double exposure, double unit_exposure, const std::string& unit, double dispersion = 1.0);

/// "12.5", "0.03": three significant digits, plain notation where it is shorter.
std::string short_number(double value);

/// Verdict by the whole interval [lo, hi] for a quantity that should be small: PASS when hi <= pass, FAIL when lo >
/// fail, UNKNOWN when it cannot decide because it is wider than the PASS band, else WARN.
Verdict judge_small(double lo, double hi, double pass, double fail);

}  // namespace tacho::cells
