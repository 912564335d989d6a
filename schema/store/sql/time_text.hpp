#pragma once
// How the column `time` compares: as ISO 8601 text in UTC of which any end may be missing, with 'T' or a space in the
// middle and with or without 'Z'. So `time >= '2026-01-12 14:30'` means what it says, though the column reads
// 2026-01-12T14:30:00.000Z. Texts with another zone ("+02:00") are not understood.

#include <optional>
#include <string>
#include <string_view>

#include "schema/sample.hpp"

namespace tacho::store::sql {

/// The name of the collation.
inline constexpr const char* kTimeCollation = "tacho_time";

/// "2026-01-12 14:30:00.000": what is compared, byte by byte. A text that is no time gives some key all the same.
std::string time_key(std::string_view text);

/// The time of a key; empty when it is none.
std::optional<Micros> time_of_key(const std::string& key);

}  // namespace tacho::store::sql
