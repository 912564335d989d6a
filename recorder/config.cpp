#include "recorder/config.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "schema/text.hpp"
#include "schema/time.hpp"

namespace tacho::recorder {

namespace {

/// Periods of sources that are off unless asked for, when they are only named.
constexpr std::array kWhenNamed{std::pair{Source::io, Micros{500'000}}, std::pair{Source::pose, Micros{200'000}},
                                std::pair{Source::push, Micros{500'000}}, std::pair{Source::ring, Micros{200'000}}};
/// What registers mean is told by the inputs before them; readers look back this far.
constexpr Micros kSlowestStandingInputs = 5'000'000;
constexpr Micros kFast = 100'000;
constexpr Micros kFastest = 50'000;
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
    const std::vector<std::string> names = source_names();
    throw UsageError(what, fmt::format("no source '{}'{}", name, did_you_mean(name, names)),
                     fmt::format("the sources are {}", fmt::join(names, ", ")));
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
        settings.period_us[i] = usual.period_us[i];
        for (const auto& [source, period] : kWhenNamed) {
          settings.period_us[i] = source == static_cast<Source>(i) ? period : settings.period_us[i];
        }
      }
    }
  });
}

void apply_periods(const std::string& list, Config& config) {
  for (const std::string& item : split(list, ',')) {
    const std::size_t equals = item.find('=');
    if (equals == std::string::npos) {
      throw UsageError("--period " + list, fmt::format("'{}' is not SOURCE=PERIOD", item),
                       "for example status=1s,status.idle=5s,io=2Hz,inputs=off");
    }
    const std::string what = "--period " + item;
    const std::string value = item.substr(equals + 1);
    const std::size_t dot = std::min(item.find('.'), equals);
    const Source source = source_of(item.substr(0, dot), "--period");
    if (dot < equals) {
      const std::string activity = item.substr(dot + 1, equals - dot - 1);
      for_all_settings(config, [&](Settings& s) { set_activity_period(s, source, activity, value, what); });
    } else {
      const Micros period = parse_period(value, what);
      for_all_settings(config, [&](Settings& s) {
        s.period_us[static_cast<std::size_t>(source)] = period;
        s.standing[static_cast<std::size_t>(source)] = {};
      });
    }
  }
}

std::string named(const RobotConfig& robot) {
  return fmt::format("{}{}robot {}", robot.where, robot.where.empty() ? "" : ": ", robot.name);
}

void check_rates(const RobotConfig& robot, Protocol protocol, Micros spacing_us, std::string_view what) {
  double share = 0.0;
  std::vector<std::string_view> names;
  for (const Source source : all_sources()) {
    const Micros period = source_info(source).protocol == protocol ? robot.settings.rates(source).fastest() : 0;
    if (period > 0) {
      share += static_cast<double>(spacing_us) / static_cast<double>(period);
      names.push_back(source_name(source));
    }
  }
  if (share > 1.0) {
    throw UsageError(named(robot),
                     fmt::format("{} together ask more often than the spacing of {} on one connection allows",
                                 fmt::join(names, " and "), duration_text(spacing_us)),
                     fmt::format("ask less often, or lower `spacing` of [{}]", what));
  }
}

void check_fast(const RobotConfig& robot, Source source) {
  const Micros fastest = robot.settings.rates(source).fastest();
  const bool allowed = robot.settings.status.allow_fast;
  if (fastest > 0 && fastest < (allowed ? kFastest : kFast)) {
    throw UsageError(
        named(robot),
        fmt::format("{} every {} is more often than {} Hz", source_name(source), rate_text(fastest), allowed ? 20 : 10),
        allowed ? "ask less often"
                : "ask less often, or set allow_fast = true in [status] for up to 20 Hz, which is more "
                  "than the vendor advises");
  }
}

/// Sources that are not asked at times of our own choosing.
void check_fixed(const RobotConfig& robot, Source source, std::string_view why) {
  if (robot.settings.rates(source).varies()) {
    throw UsageError(named(robot), fmt::format("{} has one period, whatever the robot is doing", source_name(source)),
                     std::string(why));
  }
}

void check_inputs(const RobotConfig& robot) {
  const Rates rates = robot.settings.rates(Source::inputs);
  if (rates.varies() && rates.slowest() > kSlowestStandingInputs) {
    throw UsageError(named(robot),
                     "inputs that are asked less often while the robot stands need at least one poll in 5 s",
                     "what registers mean depends on the inputs before them; choose 5s or less");
  }
}

/// Its answers stay in memory, so nobody looks at them before something else has set it off.
void check_ring(const RobotConfig& robot) {
  constexpr std::array kTriggering{Source::status, Source::pose, Source::push, Source::registers};
  if (robot.settings.period(Source::ring) > 0 &&
      std::none_of(kTriggering.begin(), kTriggering.end(), [&](Source s) { return robot.settings.period(s) > 0; })) {
    throw UsageError(named(robot), "nothing that is recorded can set off the ring, so nothing would be kept",
                     "record status, pose, push or registers as well");
  }
}

/// Two names for one robot: it would be asked twice as often as it should, and counted twice in all sums.
void check_addresses(const Config& config) {
  std::map<std::string, std::string> robots;
  const auto claim = [&](const RobotConfig& robot, Protocol protocol, const std::string& address) {
    const auto asks = [&](Source source) {
      return source_info(source).protocol == protocol && robot.settings.period(source) > 0;
    };
    if (std::none_of(all_sources().begin(), all_sources().end(), asks)) {
      return;
    }
    if (const auto [first, only] = robots.emplace(address, robot.name); !only) {
      throw UsageError(named(robot), fmt::format("is asked at {}, and so is robot {}", address, first->second),
                       "correct one of the addresses, or drop one of the robots");
    }
  };
  for (const RobotConfig& robot : config.robots) {
    claim(robot, Protocol::status_port, fmt::format("{}:{}", robot.host, robot.status_port));
    claim(robot, Protocol::modbus,
          fmt::format("{}:{} unit {}", robot.host, robot.modbus_port, robot.settings.modbus.unit));
    claim(robot, Protocol::push_port, fmt::format("{}:{}", robot.host, robot.push_port));
  }
}

}  // namespace

std::string RobotConfig::address() const {
  const bool v6 = host.find(':') != std::string::npos;
  return fmt::format("{}{}{}:{}:{}", v6 ? "[" : "", host, v6 ? "]" : "", status_port, modbus_port);
}

Rates Settings::rates(Source source) const {
  const Micros moving = period(source);
  const StandingPeriods& other = standing[static_cast<std::size_t>(source)];
  if (moving == 0) {
    return {};
  }
  const Micros idle = other.idle_us > 0 ? other.idle_us : moving;
  return {moving, idle, other.charging_us > 0 ? other.charging_us : idle};
}

Micros Settings::slowest_us() const {
  Micros slowest = 0;
  for (const Source source : all_sources()) {
    slowest = std::max(slowest, rates(source).slowest());
  }
  return slowest;
}

wire::StatusRequest Settings::ring_request() const {
  wire::StatusRequest request = status.request;
  request.return_laser = status.ring_laser;
  return request;
}

bool Settings::rates_vary() const {
  return std::any_of(all_sources().begin(), all_sources().end(), [this](Source s) { return rates(s).varies(); });
}

void set_activity_period(Settings& settings, Source source, std::string_view activity, std::string_view text,
                         const std::string& what) {
  const auto index = static_cast<std::size_t>(source);
  const std::array<Micros*, kActivityCount> places{&settings.period_us[index], &settings.standing[index].idle_us,
                                                   &settings.standing[index].charging_us};
  const auto found = std::find(kActivityNames.begin(), kActivityNames.end(), activity);
  if (found == kActivityNames.end()) {
    const std::vector<std::string> names(kActivityNames.begin(), kActivityNames.end());
    throw UsageError(what, fmt::format("a robot is never '{}'{}", activity, did_you_mean(activity, names)),
                     fmt::format("known are {}", fmt::join(names, ", ")));
  }
  const Micros period = parse_period(text, what);
  if (period == 0) {
    throw UsageError(what, "a source cannot be off for a part of the time",
                     "give a long period such as 1min, or switch the source off as a whole");
  }
  *places[static_cast<std::size_t>(found - kActivityNames.begin())] = period;
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
  if (equals == std::string_view::npos || equals == 0 || parts.front().empty() || parts.size() > 4) {
    throw UsageError(what, "not of the form NAME=HOST[:STATUS_PORT[:MODBUS_PORT[:PUSH_PORT]]]",
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
  if (parts.size() > 3) {
    robot.push_port = parse_port(parts[3], what);
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
    if (printable(robot.name) != robot.name) {
      throw UsageError(printable(named(robot)), "the name has control characters", "use letters, digits and signs");
    }
    if (!names.insert(robot.name).second) {
      throw UsageError(named(robot), "given twice", "every robot needs its own name");
    }
    const auto& periods = robot.settings.period_us;
    if (std::all_of(periods.begin(), periods.end(), [](Micros p) { return p == 0; })) {
      throw UsageError(named(robot), "every source is off", "switch one on, or drop the robot");
    }
    check_fast(robot, Source::pose);
    check_fast(robot, Source::ring);
    check_rates(robot, Protocol::status_port, robot.settings.status.spacing_us, "status");
    check_rates(robot, Protocol::modbus, robot.settings.modbus.spacing_us, "modbus");
    check_fixed(robot, Source::push, "the robot decides when it pushes; give one period");
    check_fixed(robot, Source::ring, "what happens next is not known; give one period");
    check_inputs(robot);
    check_ring(robot);
  }
  check_addresses(config);
}

}  // namespace tacho::recorder
