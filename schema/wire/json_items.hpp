#pragma once
// Elements of the arrays in an answer that are more than a scalar: alarms in their four shapes, digital points in their
// two. Internal to schema/wire (the only folder that sees simdjson).

#include <simdjson.h>

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "schema/sample.hpp"

namespace tacho::wire {

/// The alarm arrays by level, and the texts that belong to them.
inline constexpr std::array<FieldIndex, 4> kAlarmFields{field("fatals"), field("errors"), field("warnings"),
                                                        field("notices")};
inline constexpr std::array<FieldIndex, 4> kSolutionFields{field("fatals_solution"), field("errors_solution"),
                                                           field("warnings_solution"), field("notices_solution")};
/// The same alarms once more, in reports of a fleet manager.
inline constexpr FieldIndex kNestedAlarmsField = field("alarms");
inline constexpr std::array<FieldIndex, 2> kPointFields{field("di"), field("do")};

/// An integer however it is spelt: 5, 5.0. Empty for anything else, also for a fraction or what does not fit.
std::optional<std::int64_t> to_integer(simdjson::dom::element value);
/// true, false, 0, 1.
std::optional<bool> to_flag(simdjson::dom::element value);

/// Collects paths no field names; does nothing unless asked to.
class UnknownKeys {
 public:
  UnknownKeys(bool collect, Sample& out) : out_(collect ? &out : nullptr) {}
  void add(std::string_view parent, std::string_view key);

 private:
  Sample* out_;
};

/// Appends the alarms of one array to `out` and sets its cell. An element that has no code is left out, and the level
/// marked in `alarms_incomplete`; an array of such elements only is wrong_type. False when an element was left out.
[[nodiscard]] bool decode_alarms(AlarmLevel level, simdjson::dom::element list, UnknownKeys& unknown, Sample& out);
/// Gives alarms of `level` that carry no words about what to do the words of a `*_solution` array.
void attach_solutions(AlarmLevel level, simdjson::dom::element list, Sample& out);
/// Appends DI or DO to `out` and sets its cell. Elements without id or level are left out as with alarms; no mark is
/// needed, because a point that is not told keeps its state. False when an element was left out.
[[nodiscard]] bool decode_points(bool output, simdjson::dom::element list, UnknownKeys& unknown, Sample& out);

}  // namespace tacho::wire
