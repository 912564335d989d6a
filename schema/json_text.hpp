#pragma once
// Alarms, digital points and states of a row as JSON text, the same in every export and in SQL.

#include <string>
#include <string_view>

#include "schema/row_source.hpp"

namespace tacho {

/// Appends `text` as a JSON string. Bytes that are no UTF-8 are passed on: decoders have refused those already.
void append_json_string(std::string& out, std::string_view text);

/// [{"code":52201,"stamp_s":1767225600,"times":1,"desc":"blocked"}]: the alarms of one level in one row. `array` is the
/// name of the field: fatals, errors, warnings or notices.
std::string alarms_json(const Batch& batch, std::size_t row, std::string_view array);

/// [{"id":3,"status":true,"valid":null,"source":"normal"}]: the inputs or the outputs of one row.
std::string points_json(const Batch& batch, std::size_t row, bool output);

/// {"block_reason":"not_meaningful"}: why the columns of one row have no value; absent fields are left out.
std::string states_json(const Batch& batch, std::size_t row);

}  // namespace tacho
