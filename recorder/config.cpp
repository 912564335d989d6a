#include "recorder/config.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <set>
#include <utility>

#include "schema/text.hpp"
#include "schema/time.hpp"

namespace tacho::recorder {

namespace {

constexpr std::array kSources{Source::status, Source::io, Source::registers, Source::inputs};
constexpr Micros kIoWhenAsked = 500'000;
constexpr Micros kShortestPeriod = 10'000;
constexpr Micros kLongestPeriod = 86'400'000'000;
constexpr Micros kShortestTimeout = 20'000;
constexpr Micros kLongestTimeout = 60'000'000;
constexpr Micros kShortestCommit = 50'000;
constexpr Micros kLongestCommit = 600'000'000;
constexpr Micros kShortestAge = 3'600'000'000;
constexpr Micros kLongestAge = Micros{36'500} * 86'400'000'000;

std::vector<std::string> split(std::string_view text, char separator) {
  std::vector<std::string> parts;
  while (true) {
    const std::size_t at = text.find(separator);
    std::string_view part = text.substr(0, at);
    while (!part.empty() && part.front() == ' ') {
      part.remove_prefix(1);
    }
    while (!part.empty() && part.back() == ' ') {
      part.remove_suffix(1);
    }
    parts.emplace_back(part);
    if (at == std::string_view::npos) {
      return parts;
    }
    text.remove_prefix(at + 1);
  }
}

std::optional<double> number(std::string_view text, std::string_view& rest) {
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || !std::isfinite(value) || value < 0.0) {
    return std::nullopt;
  }
  rest = text.substr(static_cast<std::size_t>(end - text.data()));
  while (!rest.empty() && rest.front() == ' ') {
    rest.remove_prefix(1);
  }
  return value;
}

Source source_of(std::string_view name, const std::string& what) {
  Source source{};
  if (!parse_source(name, source)) {
    std::vector<std::string> names;
    for (const Source s : kSources) {
      names.emplace_back(source_name(s));
    }
    throw UsageError(what, fmt::format("no source '{}'{}", name, did_you_mean(name, names)),
                     "the sources are status, io, registers, inputs");
  }
  return source;
}

std::uint16_t parse_port(std::string_view text, const std::string& what) {
  unsigned value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size() || value < 1 || value > 65535) {
    throw UsageError(what, fmt::format("'{}' is no port", text), "give a number from 1 to 65535");
  }
  return static_cast<std::uint16_t>(value);
}

/// Splits "host:1:2" and "[::1]:1:2" into host and ports.
std::vector<std::string> split_address(std::string_view text) {
  if (text.empty() || text.front() != '[') {
    return split(text, ':');
  }
  const std::size_t close = text.find(']');
  const std::string_view rest = close == std::string_view::npos ? text : text.substr(close + 1);
  if (!rest.empty() && rest.front() != ':') {
    return {std::string()};  // no host: refused by the caller
  }
  std::vector<std::string> parts{std::string(text.substr(1, close - 1))};
  if (!rest.empty()) {
    for (std::string& port : split(rest.substr(1), ':')) {
      parts.push_back(std::move(port));
    }
  }
  return parts;
}

template <class F>
void for_all_settings(Config& config, const F& change) {
  change(config.defaults);
  for (RobotConfig& robot : config.robots) {
    change(robot.settings);
  }
}

void apply_sources(const std::string& list, Config& config) {
  std::array<bool, kSourceCount> chosen{};
  for (const std::string& name : split(list, ',')) {
    chosen[static_cast<std::size_t>(source_of(name, "--sources"))] = true;
  }
  const Settings usual;
  for_all_settings(config, [&](Settings& settings) {
    for (std::size_t i = 0; i < kSourceCount; ++i) {
      if (!chosen[i]) {
        settings.period_us[i] = 0;
      } else if (settings.period_us[i] == 0) {
        settings.period_us[i] = usual.period_us[i] != 0 ? usual.period_us[i] : kIoWhenAsked;
      }
    }
  });
}

void apply_periods(const std::string& list, Config& config) {
  for (const std::string& item : split(list, ',')) {
    const std::size_t equals = item.find('=');
    if (equals == std::string::npos) {
      throw UsageError("--period " + list, fmt::format("'{}' is not SOURCE=PERIOD", item),
                       "for example status=1s,io=2Hz,inputs=off");
    }
    const Source source = source_of(item.substr(0, equals), "--period");
    const Micros period = parse_period(item.substr(equals + 1), "--period " + item);
    for_all_settings(config, [&](Settings& s) { s.period_us[static_cast<std::size_t>(source)] = period; });
  }
}

std::string named(const RobotConfig& robot) {
  return fmt::format("{}{}robot {}", robot.where, robot.where.empty() ? "" : ": ", robot.name);
}

void check_rates(const RobotConfig& robot, Source a, Source b, Micros spacing_us, std::string_view what) {
  double share = 0.0;
  for (const Source source : {a, b}) {
    const Micros period = robot.settings.period(source);
    share += period > 0 ? static_cast<double>(spacing_us) / static_cast<double>(period) : 0.0;
  }
  if (share > 1.0) {
    throw UsageError(named(robot),
                     fmt::format("{} and {} together ask more often than the spacing of {} on one connection allows",
                                 source_name(a), source_name(b), duration_text(spacing_us)),
                     fmt::format("ask less often, or lower `spacing` of [{}]", what));
  }
}

}  // namespace

std::string RobotConfig::address() const {
  const bool v6 = host.find(':') != std::string::npos;
  return fmt::format("{}{}{}:{}:{}", v6 ? "[" : "", host, v6 ? "]" : "", status_port, modbus_port);
}

Micros parse_period(std::string_view text, const std::string& what) {
  if (text == "off") {
    return 0;
  }
  std::string_view unit;
  const std::optional<double> value = number(text, unit);
  if (value && *value > 0.0 && (unit == "Hz" || unit == "hz")) {
    const double period = std::round(1e6 / *value);
    if (period >= static_cast<double>(kShortestPeriod) && period <= static_cast<double>(kLongestPeriod)) {
      return static_cast<Micros>(period);
    }
  } else if (const auto length = parse_duration(text);
             length && *length >= kShortestPeriod && *length <= kLongestPeriod) {
    return *length;
  }
  throw UsageError(what, fmt::format("'{}' is no period", text),
                   "give a duration (1s, 200ms, 5min), a rate (2Hz) or off; from 10 ms to 24 h");
}

Micros parse_length(std::string_view text, const std::string& what, Micros least, Micros most) {
  const std::optional<Micros> length = parse_duration(text);
  if (!length) {
    throw UsageError(what, fmt::format("'{}' is no duration", text), "write for example 500ms, 1s, 5min, 2h");
  }
  if (*length < least || *length > most) {
    throw UsageError(what, fmt::format("{} is out of range", text),
                     fmt::format("allowed is {} to {}", duration_text(least), duration_text(most)));
  }
  return *length;
}

std::uint64_t parse_size(std::string_view text, const std::string& what) {
  std::string_view unit;
  const std::optional<double> value = number(text, unit);
  const double factor = unit == "KB" ? 0x1p10 : unit == "MB" ? 0x1p20 : unit == "GB" ? 0x1p30 : 0.0;
  const double bytes = value.value_or(0.0) * factor;
  if (bytes < 0x1p20 || bytes > 0x1p40) {
    throw UsageError(what, fmt::format("'{}' is no size", text), "write for example 64MB or 1GB; at least 1MB");
  }
  return static_cast<std::uint64_t>(bytes);
}

Micros parse_age(std::string_view text, const std::string& what) {
  return text == "off" ? 0 : parse_length(text, what, kShortestAge, kLongestAge);
}

std::uint64_t parse_limit(std::string_view text, const std::string& what) {
  return text == "off" ? 0 : parse_size(text, what);
}

std::string parse_listen(std::string_view text, const std::string& what) {
  if (text == "off") {
    return "";
  }
  std::vector<std::string> parts = split_address(text);
  if (parts.size() == 1) {
    parts.insert(parts.begin(), "127.0.0.1");
  }
  if (parts.size() != 2 || parts[0].empty()) {
    throw UsageError(what, fmt::format("'{}' is no place to listen at", text),
                     "write PORT for this computer alone, or ADDRESS:PORT, as in 127.0.0.1:9460");
  }
  const bool v6 = parts[0].find(':') != std::string::npos;
  return fmt::format("{}{}{}:{}", v6 ? "[" : "", parts[0], v6 ? "]" : "", parse_port(parts[1], what));
}

std::optional<WordOrder> parse_order(std::string_view text, const std::string& what) {
  if (text == "auto") {
    return std::nullopt;
  }
  WordOrder order{};
  if (!parse_word_order(text, order)) {
    throw UsageError(what, fmt::format("no word order '{}'", text), "the orders are auto, cdab, abcd, badc, dcba");
  }
  return order;
}

int check_unit(std::int64_t unit, const std::string& what) {
  if (unit < 0 || (unit > 247 && unit != 255)) {
    throw UsageError(what, fmt::format("{} is no unit id", unit), "allowed is 0 to 247 or 255; robots use 1");
  }
  return static_cast<int>(unit);
}

RobotConfig parse_robot(std::string_view text, const Settings& defaults) {
  const std::string what = fmt::format("--robot {}", text);
  const std::size_t equals = text.find('=');
  const std::vector<std::string> parts =
      split_address(equals == std::string_view::npos ? std::string_view() : text.substr(equals + 1));
  if (equals == std::string_view::npos || equals == 0 || parts.front().empty() || parts.size() > 3) {
    throw UsageError(what, "not of the form NAME=HOST[:STATUS_PORT[:MODBUS_PORT]]",
                     "for example --robot amr-1=192.168.192.5");
  }
  RobotConfig robot;
  robot.name = std::string(text.substr(0, equals));
  robot.host = parts[0];
  robot.settings = defaults;
  if (parts.size() > 1) {
    robot.status_port = parse_port(parts[1], what);
  }
  if (parts.size() > 2) {
    robot.modbus_port = parse_port(parts[2], what);
  }
  return robot;
}

void apply(const Overrides& overrides, Config& config) {
  if (overrides.log) {
    config.log = *overrides.log;
  }
  if (overrides.commit) {
    config.commit_us = parse_length(*overrides.commit, "--commit", kShortestCommit, kLongestCommit);
  }
  if (overrides.sources) {
    apply_sources(*overrides.sources, config);
  }
  if (overrides.periods) {
    apply_periods(*overrides.periods, config);
  }
  if (overrides.timeout) {
    const Micros timeout = parse_length(*overrides.timeout, "--timeout", kShortestTimeout, kLongestTimeout);
    for_all_settings(config, [&](Settings& s) { s.status.timeout_us = s.modbus.timeout_us = timeout; });
  }
  if (overrides.metrics) {
    config.metrics = parse_listen(*overrides.metrics, "--metrics");
  }
  if (overrides.unit) {
    const int unit = check_unit(*overrides.unit, "--unit");
    for_all_settings(config, [&](Settings& s) { s.modbus.unit = unit; });
  }
  if (overrides.word_order) {
    const std::optional<WordOrder> order = parse_order(*overrides.word_order, "--word-order");
    for_all_settings(config, [&](Settings& s) { s.modbus.word_order = order; });
  }
  for (const std::string& text : overrides.robots) {
    config.robots.push_back(parse_robot(text, config.defaults));
  }
}

bool Overrides::any() const {
  return !robots.empty() || log || periods || sources || commit || timeout || word_order || unit || metrics;
}

void validate(const Config& config) {
  if (config.robots.empty()) {
    throw UsageError("robots", "none given", "use --robot NAME=HOST, or [[robot]] in a --config file");
  }
  if (config.retention.size_bytes > 0 && config.retention.size_bytes < 2 * config.part_bytes) {
    throw UsageError("[retention] size",
                     fmt::format("{} is less than two parts of {}, and the part that is written is never removed",
                                 store::size_text(config.retention.size_bytes), store::size_text(config.part_bytes)),
                     "allow more, or lower part_size");
  }
  std::set<std::string> names;
  for (const RobotConfig& robot : config.robots) {
    if (!names.insert(robot.name).second) {
      throw UsageError(named(robot), "given twice", "every robot needs its own name");
    }
    const auto& periods = robot.settings.period_us;
    if (std::all_of(periods.begin(), periods.end(), [](Micros p) { return p == 0; })) {
      throw UsageError(named(robot), "every source is off", "switch one on, or drop the robot");
    }
    check_rates(robot, Source::status, Source::io, robot.settings.status.spacing_us, "status");
    check_rates(robot, Source::registers, Source::inputs, robot.settings.modbus.spacing_us, "modbus");
  }
}

}  // namespace tacho::recorder
