#pragma once
// The states whose change is an event (schema/events.hpp), in one table: a new one is a row here.

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "schema/records.hpp"
#include "schema/sample.hpp"

namespace tacho {

/// One state. `read` gives its value as text, empty when the sample does not tell it.
struct Signal {
  EventKind kind;
  std::string_view subject;
  std::vector<FieldIndex> fields;
  std::optional<std::string> (*read)(const Sample& sample, const std::vector<FieldIndex>& fields);
};

/// All of them, in the order their events are emitted.
const std::vector<Signal>& signals();

/// "3.4.7.0" from the version registers; empty when the sample does not give all four parts.
std::optional<std::string> firmware_text(const Sample& sample);

/// "true" / "false"
std::string flag_text(bool on);

}  // namespace tacho
