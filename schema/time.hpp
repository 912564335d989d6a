#pragma once
// Times as text and back. UTC microseconds inside; ISO 8601 outside; zones as fixed offsets or IANA names.

#include <optional>
#include <string>
#include <string_view>

#include "schema/sample.hpp"

namespace tacho {

/// "2026-01-08T23:11:52.705Z"
std::string iso_utc(Micros t_us);
/// "2026-01-08T12:11:52.705-11:00" in the zone, see zone_offset.
std::string iso_zone(Micros t_us, std::string_view zone);

/// Offset of `zone` from UTC at `t_us`, seconds. `zone`: "UTC", "+02:00", or an IANA name known to the system. Empty
/// when the zone is not known.
std::optional<int> zone_offset_s(std::string_view zone, Micros t_us);

/// Parses "2026-01-08", "2026-01-08 23:11[:52[.705]]", "...T...Z", "...-1100", "...+02:00". A time without zone is in
/// `zone`. Empty when it is no time.
std::optional<Micros> parse_time(std::string_view text, std::string_view zone);

/// Parses "90s", "5min", "2h", "30d", "250ms". Empty when it is no duration.
std::optional<Micros> parse_duration(std::string_view text);

/// "1 h 02 min 03 s", "250 ms": at most three units.
std::string duration_text(Micros us);

/// "+0.25 s": how far a clock is ahead; never "-0.00 s".
std::string offset_text(Micros us);

constexpr Micros middle(Micros a, Micros b) { return a + (b - a) / 2; }
constexpr double to_seconds(Micros us) { return static_cast<double>(us) / 1e6; }

/// The host's clocks.
Micros wall_now_us();
Micros mono_now_us();

}  // namespace tacho
