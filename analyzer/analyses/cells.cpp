#include "analyzer/analyses/cells.hpp"

#include <fmt/format.h>

#include <cmath>

namespace tacho::cells {

Value maybe(std::optional<double> value, const std::string& reason) {
  return value ? Value(*value) : Value(Missing{reason});
}

Value maybe(std::optional<std::int64_t> value, const std::string& reason) {
  return value ? Value(*value) : Value(Missing{reason});
}

Value text(std::string_view value, const std::string& reason) {
  return value.empty() ? Value(Missing{reason}) : Value(std::string(value));
}

Quantity missing(const std::string& unit, const std::string& reason) {
  Quantity q;
  q.unit = unit;
  q.reason = reason;
  return q;
}

Quantity bounded(double value, double lo, double hi, const std::string& unit) {
  Quantity q;
  q.value = value;
  q.unit = unit;
  q.lo = lo;
  q.hi = hi;
  return q;
}

Quantity rate(double k, double exposure, double unit_exposure, const std::string& unit, double dispersion) {
  if (!(exposure > 0.0)) {
    return missing(unit, "no exposure was observed");
  }
  const math::Rate r = math::poisson_rate(k, exposure / unit_exposure, dispersion);
  Quantity q = bounded(r.value, r.lo, r.hi, unit);
  q.n = static_cast<std::int64_t>(k);
  q.exposure = exposure;
  if (k <= 0.0) {
    q.reason = fmt::format("none seen: below 3.69 / exposure = {} {}", short_number(r.hi), unit);
  } else if (r.widened) {
    q.reason =
        fmt::format("limits widened by {:.2f}, the root of the dispersion of daily counts", std::sqrt(dispersion));
  }
  return q;
}

Value code(FieldIndex f, const std::optional<std::int64_t>& code) {
  if (!code) {
    return Missing{"not given"};
  }
  const std::string_view name = code_name(field_at(f), *code);
  return name.empty() ? std::to_string(*code) : std::string(name);
}

std::string short_number(double value) { return fmt::format("{:.3g}", value); }

Verdict judge_small(double lo, double hi, double pass, double fail) {
  if (hi <= pass) {
    return Verdict::pass;
  }
  if (lo > fail) {
    return Verdict::fail;
  }
  return hi - lo > pass ? Verdict::unknown : Verdict::warn;
}

}  // namespace tacho::cells
