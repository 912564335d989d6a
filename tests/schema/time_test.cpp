#include "schema/time.hpp"
#include "schema/text.hpp"

#include "tests/support/catch.hpp"

using namespace tacho;

namespace {
constexpr Micros kT = 1'767'957'112'705'000;  // 2026-01-09T11:11:52.705Z
}

TEST_CASE("a time printed in UTC or in a zone reads back as the same time") {
  CHECK(iso_utc(kT) == "2026-01-09T11:11:52.705Z");
  CHECK(iso_zone(kT, "-11:00") == "2026-01-09T00:11:52.705-11:00");
  for (const std::string zone : {"UTC", "-11:00", "+05:30", "Europe/Berlin", "America/New_York"}) {
    INFO(zone);
    CHECK(parse_time(iso_zone(kT, zone), "UTC") == kT);
  }
}

TEST_CASE("a robot's create_on stamp is understood, colon or no colon in its offset") {
  CHECK(parse_time("2026-01-09T00:11:52.705-1100", "UTC") == kT);
  CHECK(parse_time("2026-01-09T11:11:52.705Z", "Asia/Tokyo") == kT);
}

TEST_CASE("a time without a zone is in the zone of the site, summer time included") {
  CHECK(parse_time("2026-07-01 12:00", "Europe/Berlin") == parse_time("2026-07-01T10:00:00Z", "UTC"));
  CHECK(parse_time("2026-01-01", "Europe/Berlin") == parse_time("2025-12-31T23:00:00Z", "UTC"));
}

TEST_CASE("what is no time is refused") {
  for (const char* text : {"", "yesterday", "2026-13-01", "2026-02-30", "2026-01-01T25:00", "2026-01-01T10:00 nowhere",
                           "2026-01-01T10:00:00.Z", "26-01-01"}) {
    INFO(text);
    CHECK_FALSE(parse_time(text, "UTC"));
  }
  CHECK_FALSE(zone_offset_s("Mars/Olympus", kT));
}

TEST_CASE("times before 1970 print and read as well") {
  CHECK(iso_utc(-1'000'000) == "1969-12-31T23:59:59.000Z");
  CHECK(parse_time("1969-12-31T23:59:59Z", "UTC") == -1'000'000);
}

TEST_CASE("durations are a number and a unit") {
  CHECK(parse_duration("250ms") == 250'000);
  CHECK(parse_duration("90s") == 90'000'000);
  CHECK(parse_duration("1.5h") == 5'400'000'000);
  CHECK(parse_duration("30d") == 30 * 86'400'000'000LL);
  for (const char* text : {"", "10", "-5s", "5 parsecs", "1e300d"}) {
    INFO(text);
    CHECK_FALSE(parse_duration(text));
  }
  CHECK(duration_text(3'723'000'000) == "1 h 02 min 03 s");
  CHECK(duration_text(90'000) == "90 ms");
  CHECK(printable("a\x1b[31m\n\x7f \u009b31m \u202eb \u2068c ä障") == "a [31m    31m  b  c ä障");
  CHECK(printable("\xC2") == "\xC2");
  CHECK(offset_text(254'000) == "+0.25 s");
  CHECK(offset_text(-3'000) == "+0.00 s");
  CHECK(offset_text(-7'000) == "-0.01 s");
}
