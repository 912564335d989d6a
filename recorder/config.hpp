#pragma once
// What to record, from whom, how often, and where to. Filled from a TOML file, from flags, or both; flags win.

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "recorder/rates.hpp"
#include "recorder/ring.hpp"
#include "schema/error.hpp"
#include "schema/records.hpp"
#include "schema/store/retention.hpp"
#include "schema/wire/requests.hpp"

namespace tacho::recorder {

/// A mistake in flags or in the configuration file: the program exits with 2.
class UsageError : public Error {
 public:
  using Error::Error;
};

struct StatusSettings {
  Micros timeout_us = 1'000'000;  ///< from connecting to the last byte; longer than the robot's worst answer
  Micros spacing_us = 100'000;    ///< between requests on the connection; the vendor's advice is 100 to 200 ms
  std::uint8_t version = 1;       ///< header byte 1: 1 for RBK 3.4, 2 for RBK 3.5
  wire::StatusRequest request;    ///< parameters of request 1100
  bool allow_fast = false;  ///< pose and ring at more than 10 Hz, which is more than the vendor advises; 20 Hz at most
  bool ring_laser = false;  ///< lasers in the answers of the ring
};

struct ModbusSettings {
  Micros timeout_us = 1'000'000;        ///< for a whole sweep
  Micros spacing_us = 20'000;           ///< between sweeps; the server answers from a cache, so it can be shorter
  int unit = 1;                         ///< robot parameter modbusSlaveId
  std::optional<WordOrder> word_order;  ///< empty: detected at the first answer
};

/// Periods of a source while the robot does not move; 0 = as while it is idle, and then as while it moves.
struct StandingPeriods {
  Micros idle_us = 0;
  Micros charging_us = 0;
};

/// What may differ from robot to robot.
struct Settings {
  /// Microseconds per source while the robot moves, 0 = not recorded, whatever `standing` says. io is off because
  /// request 1100 carries DI and DO on current firmware.
  std::array<Micros, kSourceCount> period_us{1'000'000, 0, 200'000, 200'000};
  std::array<StandingPeriods, kSourceCount> standing{};
  StatusSettings status;
  ModbusSettings modbus;
  [[nodiscard]] Micros period(Source source) const { return period_us[static_cast<std::size_t>(source)]; }
  /// All zero when it is not recorded.
  [[nodiscard]] Rates rates(Source source) const;
  /// Of all sources that are recorded.
  [[nodiscard]] Micros slowest_us() const;
  [[nodiscard]] bool rates_vary() const;
  /// As for status, but for the lasers.
  [[nodiscard]] wire::StatusRequest ring_request() const;
};

struct RobotConfig {
  std::string name;
  std::string host;  ///< address, or a name (looked up before each connection attempt)
  std::uint16_t status_port = 19204;
  std::uint16_t modbus_port = 502;
  std::uint16_t push_port = 19301;
  Settings settings;
  std::string where;                          ///< "site.toml:12:1"; empty when it was a flag
  [[nodiscard]] std::string address() const;  ///< "host:status_port:modbus_port"
};

struct Config {
  std::filesystem::path log;
  Micros commit_us = 1'000'000;                     ///< at most this much is lost by a power cut; longer spares flash
  std::uint64_t part_bytes = 256u << 20;            ///< a part is closed when larger
  store::RetentionRules retention{0, 0, 1u << 30};  ///< what is removed from the log, and when
  RingSettings ring;                                ///< of all robots that have the source `ring`
  std::string metrics;                              ///< "127.0.0.1:9460": numbers for Prometheus; empty: off
  Settings defaults;                                ///< of robots that say nothing else
  std::vector<RobotConfig> robots;
};

/// What was given on the command line; unset members change nothing.
struct Overrides {
  std::vector<std::string> robots;  ///< NAME=HOST[:STATUS_PORT[:MODBUS_PORT[:PUSH_PORT]]]
  std::optional<std::string> log;
  std::optional<std::string> periods;  ///< "status=1s,status.idle=5s,io=2Hz,inputs=off"
  std::optional<std::string> sources;  ///< "status,io": these and no others
  std::optional<std::string> commit;
  std::optional<std::string> timeout;
  std::optional<std::string> word_order;
  std::optional<int> unit;
  std::optional<std::string> metrics;  ///< [HOST:]PORT
  [[nodiscard]] bool any() const;
};

/// What is in force, and its text for the log: the file as it is when nothing on the command line changes it, else
/// everything that is in force.
struct LoadedConfig {
  Config config;
  std::string text;
};

/// All throw UsageError: file and line, the mistake, and what was meant or is allowed.
/// `file` may be empty: flags alone.
LoadedConfig load_config(const std::filesystem::path& file, const Overrides& overrides);
Config read_config(const std::filesystem::path& file);
Config parse_config(std::string_view toml, const std::string& file_name);
void apply(const Overrides& overrides, Config& config);
/// Checks what no single value shows: names unique, something to record, rates that fit the spacing.
void validate(const Config& config);

/// The whole configuration as TOML; parse_config() of it gives the same configuration.
std::string to_toml(const Config& config);

RobotConfig parse_robot(std::string_view text, const Settings& defaults);
/// "1s", "500ms", "2Hz"; 0 for "off". `what` names the value in the error.
Micros parse_period(std::string_view text, const std::string& what);
/// The same of one activity: "off" is refused, because a source is off as a whole.
void set_activity_period(Settings& settings, Source source, std::string_view activity, std::string_view text,
                         const std::string& what);
Micros parse_length(std::string_view text, const std::string& what, Micros least, Micros most);
/// "256MB", "1GB"; binary multiples.
std::uint64_t parse_size(std::string_view text, const std::string& what);
/// Of [retention]: durations and sizes, 0 for "off".
Micros parse_age(std::string_view text, const std::string& what);
std::uint64_t parse_limit(std::string_view text, const std::string& what);
/// "HOST:PORT" of "PORT", "HOST:PORT" or "[ADDRESS]:PORT"; loopback when there is no host; empty for "off".
std::string parse_listen(std::string_view text, const std::string& what);
std::optional<WordOrder> parse_order(std::string_view text, const std::string& what);
int check_unit(std::int64_t unit, const std::string& what);

}  // namespace tacho::recorder
