#include "schema/records.hpp"

#include <fmt/format.h>

#include <array>

#include "schema/time.hpp"

namespace tacho {

namespace {

constexpr std::array<std::string_view, 4> kWordOrderNames{"cdab", "abcd", "badc", "dcba"};

struct Words {
  std::string_view name;
  std::string_view meaning;
};

constexpr std::array<Words, kCauseCount> kCauses{{
    {"connect_refused", "nobody listens on the port"},
    {"connect_timeout", "no answer to the connection attempt"},
    {"unreachable", "no route to the robot"},
    {"timeout", "connected, but no answer in time"},
    {"closed", "the robot closed the connection"},
    {"malformed", "the answer was no valid frame"},
    {"wrong_sequence", "the answer carried another sequence number"},
    {"error_frame", "the robot refused the request"},
    {"client_limit", "too many clients on the robot's port"},
    {"modbus_exception", "the Modbus server refused the request"},
    {"overrun", "earlier polls took too long"},
    {"backoff", "waiting before the next connection attempt"},
    {"queue_full", "the recorder could not keep up with writing"},
    {"disk", "the log could not be written"},
    {"recorder_off", "nobody asked: the recorder was not running, or this source was off"},
    {"recorder_killed", "not yet committed when the recorder died"},
    {"shutdown", "the recorder was stopping, or its settings were changed"},
    {"damaged", "lost from the log that this one was recovered from"},
    {"other_robot", "another robot answered at this address"},
}};

constexpr std::array<std::string_view, kEventKindCount> kEventKinds{"link_up",
                                                                    "link_down",
                                                                    "client_limit",
                                                                    "error_frame",
                                                                    "no_sequence_echo",
                                                                    "alarm_raised",
                                                                    "alarm_cleared",
                                                                    "alarm_repeated",
                                                                    "blocked",
                                                                    "slowed",
                                                                    "emergency",
                                                                    "driver_emergency",
                                                                    "charging",
                                                                    "station",
                                                                    "task",
                                                                    "map",
                                                                    "localisation",
                                                                    "reboot",
                                                                    "digital_input",
                                                                    "digital_output",
                                                                    "control_owner",
                                                                    "identity",
                                                                    "rate",
                                                                    "word_order",
                                                                    "unknown_key",
                                                                    "undecodable",
                                                                    "clock_step",
                                                                    "mark",
                                                                    "part_removed",
                                                                    "config_changed",
                                                                    "identity_changed",
                                                                    "pose_jump",
                                                                    "ring_kept"};

}  // namespace

std::string_view word_order_name(WordOrder order) { return kWordOrderNames[static_cast<std::size_t>(order)]; }

bool parse_word_order(std::string_view name, WordOrder& out) {
  for (std::size_t i = 0; i < kWordOrderNames.size(); ++i) {
    if (kWordOrderNames[i] == name) {
      out = static_cast<WordOrder>(i);
      return true;
    }
  }
  return false;
}

std::string_view cause_name(Cause cause) { return kCauses[static_cast<std::size_t>(cause)].name; }
std::string_view cause_meaning(Cause cause) { return kCauses[static_cast<std::size_t>(cause)].meaning; }
std::string_view event_kind_name(EventKind kind) { return kEventKinds[static_cast<std::size_t>(kind)]; }

std::string rate_text(Micros period_us) {
  if (period_us <= 0) {
    return "off";
  }
  if (period_us % 1'000 != 0) {
    return fmt::format("{} us", period_us);
  }
  if (period_us < 1'000'000 || period_us % 100'000 != 0) {
    return fmt::format("{} ms", period_us / 1'000);
  }
  return fmt::format("{}.{} s", period_us / 1'000'000, period_us % 1'000'000 / 100'000);
}

std::optional<Micros> parse_rate(std::string_view text) { return text == "off" ? 0 : parse_duration(text); }

void Rollup::add(const Rollup& later) {
  rows += later.rows;
  min = std::min(min, later.min);
  max = std::max(max, later.max);
  sum += later.sum;
  last = later.last;
}

}  // namespace tacho
