#include "schema/fields.hpp"

#include "schema/docs.hpp"
#include "schema/store/schema_sql.hpp"
#include "schema/text.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/golden.hpp"

using namespace tacho;

TEST_CASE("every field is found under its own name") {
  for (std::size_t i = 0; i < kFieldCount; ++i) {
    CHECK(find_field(kFields[i].name) == i);
  }
}

TEST_CASE("names are lower case words, so that they work as SQL columns and CSV headers") {
  for (const Field& f : kFields) {
    INFO(f.name);
    CHECK(f.name.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789_") == std::string_view::npos);
    CHECK(f.name.find_first_of("0123456789") != 0);
  }
}

TEST_CASE("the first argument of a program is a command, an option, or answered with what was meant") {
  const std::vector<std::string> commands{"run", "check"};
  CHECK(not_a_command("check", commands).empty());
  CHECK(not_a_command("--help", commands).empty());
  CHECK(not_a_command("chekc", commands) == "no command 'chekc'; did you mean 'check'?; the commands are run, check");
  CHECK(not_a_command("", commands) == "no command given; the commands are run, check");
}

TEST_CASE("a misspelt field is answered with the nearest name") {
  CHECK(nearest_field("batery_level") == "battery_level");
  CHECK(nearest_field("BLOCKED") == "blocked");
  CHECK(nearest_field("zzzzzzzzzzzz").empty());
}

TEST_CASE("one quantity in two spellings is one field with a factor per source") {
  CHECK(field_at(field("battery_level")).reg.scale == Approx(0.01));
  CHECK(field_at(field("total_time")).json.scale == Approx(1e-3));
  CHECK(field_at(field("total_time")).reg.scale == Approx(3600.0));
  CHECK(field_at(field("jack_height")).reg.scale == Approx(1e-3));
  CHECK(field_at(field("today_time")).reg.scale == Approx(60.0));
}

TEST_CASE("unknown codes have no name and known ones have theirs") {
  const Field& reason = field_at(field("block_reason"));
  CHECK(code_name(reason, 1) == "laser");
  CHECK(code_name(reason, 10) == "di_ultrasonic");
  CHECK(code_name(reason, 11).empty());
}

TEST_CASE("reasons and positions of obstacles mean something only while the robot is stopped or slowed by one") {
  for (const char* name : {"block_reason", "block_x", "block_y", "block_di", "block_ultrasonic_id"}) {
    CHECK(field_at(find_field(name)).condition == "blocked");
  }
  for (const char* name : {"slow_reason", "slow_x", "slow_y", "slow_di", "slow_ultrasonic_id"}) {
    CHECK(field_at(find_field(name)).condition == "slowed");
  }
}

TEST_CASE("the SQL of a log is what the table of columns prints") {
  test::check_golden("schema/schema.sql", store::schema_sql());
}

TEST_CASE("the field reference is what the table prints") { test::check_golden("schema/FIELDS.md", fields_markdown()); }
