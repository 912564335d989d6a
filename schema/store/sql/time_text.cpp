#include "schema/store/sql/time_text.hpp"

#include "schema/time.hpp"

namespace tacho::store::sql {

namespace {

constexpr std::string_view kEarliest = "0000-01-01 00:00:00.000";
constexpr std::size_t kMiddle = 10;

}  // namespace

std::string time_key(std::string_view text) {
  if (text.ends_with('Z')) {
    text.remove_suffix(1);
  }
  std::string key(text);
  if (key.size() > kMiddle && key[kMiddle] == 'T') {
    key[kMiddle] = ' ';
  }
  if (key.size() < kEarliest.size()) {
    key += kEarliest.substr(key.size());
  }
  return key;
}

std::optional<Micros> time_of_key(const std::string& key) {
  return key.size() == kEarliest.size() ? parse_time(key, "UTC") : std::nullopt;
}

}  // namespace tacho::store::sql
