#pragma once
// Reference text printed from the tables. The committed copies (schema/FIELDS.md, schema/schema.sql) are compared by a
// test.

#include <string>
#include <string_view>

#include "schema/fields.hpp"

namespace tacho {

std::string_view kind_name(Kind kind);

/// "u16 44", "f32 27-28 x 3600", "input 2"; empty when the field is in no register.
std::string register_text(const Field& field);

/// "battery_level", "time x 0.001, formerly x"; empty when the field is in no JSON answer.
std::string json_text(const Field& field);

/// schema/FIELDS.md
std::string fields_markdown();

}  // namespace tacho
