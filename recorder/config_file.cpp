// The configuration file: TOML in, TOML out. Every mistake is answered with file, line and what was probably meant.

#include <fmt/format.h>

#include <toml++/toml.h>
#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <functional>
#include <iterator>
#include <sstream>
#include <utility>

#include "recorder/config.hpp"
#include "schema/text.hpp"

namespace tacho::recorder {

namespace {

constexpr Micros kHour = 3'600'000'000;

/// One key of a table: its name and what to do with its value. `what` is "site.toml:12:8: [modbus] unit".
struct Key {
  std::string name;
  std::function<void(const toml::node& value, const std::string& what)> set;
};

class Reader {
 public:
  explicit Reader(std::string file) : file_(std::move(file)) {}

  /// "site.toml:12:5"
  [[nodiscard]] std::string at(const toml::source_region& region) const {
    return fmt::format("{}:{}:{}", file_, region.begin.line, region.begin.column);
  }

  void table(const toml::table& table, const std::string& name, const std::vector<Key>& keys) const {
    for (const auto& [key, value] : table) {
      const Key* found = nullptr;
      std::vector<std::string> known;
      for (const Key& candidate : keys) {
        known.push_back(candidate.name);
        found = candidate.name == key.str() ? &candidate : found;
      }
      if (found == nullptr) {
        throw UsageError(at(key.source()),
                         fmt::format("unknown {} '{}'{}{}", value.is_value() ? "key" : "table", key.str(),
                                     name.empty() ? "" : " in " + name, did_you_mean(key.str(), known)),
                         "known are " + fmt::format("{}", fmt::join(known, ", ")));
      }
      found->set(value, fmt::format("{}: {}{}{}", at(value.source()), name, name.empty() ? "" : " ", key.str()));
    }
  }

 private:
  std::string file_;
};

std::string text_of(const toml::node& value, const std::string& what) {
  if (const auto text = value.value_exact<std::string>()) {
    return *text;
  }
  throw UsageError(what, "a text was expected", "put the value in quotes, as in \"1s\"");
}

std::int64_t integer_of(const toml::node& value, const std::string& what) {
  if (const auto number = value.value_exact<std::int64_t>()) {
    return *number;
  }
  throw UsageError(what, "a whole number was expected", "write it without quotes");
}

bool flag_of(const toml::node& value, const std::string& what) {
  if (const auto flag = value.value_exact<bool>()) {
    return *flag;
  }
  throw UsageError(what, "true or false was expected", "write it without quotes");
}

std::vector<std::string> texts_of(const toml::node& value, const std::string& what) {
  const toml::array* array = value.as_array();
  if (array == nullptr) {
    throw UsageError(what, "a list of texts was expected", "as in [\"x\", \"y\"]");
  }
  std::vector<std::string> out;
  for (const toml::node& item : *array) {
    out.push_back(text_of(item, what));
  }
  return out;
}

const toml::table& table_of(const toml::node& value, const std::string& what) {
  const toml::table* table = value.as_table();
  if (table == nullptr) {
    throw UsageError(what, "a table was expected", "see samples/config/site.toml");
  }
  return *table;
}

void add_robot(RobotConfig robot, Config& config) {
  const auto twin = std::find_if(config.robots.begin(), config.robots.end(),
                                 [&](const RobotConfig& other) { return other.name == robot.name; });
  if (twin != config.robots.end()) {
    throw UsageError(robot.where, fmt::format("robot {} is given twice, first at {}", robot.name, twin->where),
                     "every robot needs its own name");
  }
  config.robots.push_back(std::move(robot));
}

std::uint16_t port_of(const toml::node& value, const std::string& what) {
  const std::int64_t port = integer_of(value, what);
  if (port < 1 || port > 65535) {
    throw UsageError(what, fmt::format("{} is no port", port), "give a number from 1 to 65535");
  }
  return static_cast<std::uint16_t>(port);
}

/// status = { moving = "200ms", idle = "1s", charging = "5s" }
std::vector<Key> activity_keys(Settings& s, Source source) {
  std::vector<Key> keys;
  for (const std::string_view activity : kActivityNames) {
    keys.push_back({std::string(activity), [&s, source, activity](const toml::node& v, const std::string& what) {
                      set_activity_period(s, source, activity, text_of(v, what), what);
                    }});
  }
  return keys;
}

std::vector<Key> source_keys(const Reader& reader, Settings& s) {
  std::vector<Key> keys;
  for (const Source source : all_sources()) {
    keys.push_back(
        {std::string(source_name(source)), [&reader, &s, source](const toml::node& v, const std::string& what) {
           const auto index = static_cast<std::size_t>(source);
           s.standing[index] = {};
           if (const toml::table* const table = v.as_table()) {
             reader.table(*table, fmt::format("[sources] {}", source_name(source)), activity_keys(s, source));
           } else {
             s.period_us[index] = parse_period(text_of(v, what), what);
           }
         }});
  }
  return keys;
}

std::vector<Key> status_keys(StatusSettings& s) {
  const auto length = [](Micros& out, Micros least, Micros most) {
    return [&out, least, most](const toml::node& v, const std::string& what) {
      out = parse_length(text_of(v, what), what, least, most);
    };
  };
  const auto flag = [](std::optional<bool>& out) {
    return [&out](const toml::node& v, const std::string& what) { out = flag_of(v, what); };
  };
  return {
      {"timeout", length(s.timeout_us, 20'000, 60'000'000)},
      {"spacing", length(s.spacing_us, 0, kHour)},
      {"version",
       [&s](const toml::node& v, const std::string& what) {
         const std::int64_t version = integer_of(v, what);
         if (version < 0 || version > 255) {
           throw UsageError(what, fmt::format("{} does not fit into a byte", version),
                            "RBK 3.4 uses 1, RBK 3.5 uses 2");
         }
         s.version = static_cast<std::uint8_t>(version);
       }},
      {"keys", [&s](const toml::node& v, const std::string& what) { s.request.keys = texts_of(v, what); }},
      {"return_laser", flag(s.request.return_laser)},
      {"return_beams3D", flag(s.request.return_beams3d)},
      {"return_mid360", flag(s.request.return_mid360)},
      {"ring_laser", [&s](const toml::node& v, const std::string& what) { s.ring_laser = flag_of(v, what); }},
      {"allow_fast", [&s](const toml::node& v, const std::string& what) { s.allow_fast = flag_of(v, what); }},
      {"language", [&s](const toml::node& v, const std::string& what) { s.request.language = text_of(v, what); }},
  };
}

std::vector<Key> modbus_keys(ModbusSettings& s) {
  return {
      {"timeout",
       [&s](const toml::node& v, const std::string& what) {
         s.timeout_us = parse_length(text_of(v, what), what, 20'000, 60'000'000);
       }},
      {"spacing", [&s](const toml::node& v,
                       const std::string& what) { s.spacing_us = parse_length(text_of(v, what), what, 0, kHour); }},
      {"unit", [&s](const toml::node& v, const std::string& what) { s.unit = check_unit(integer_of(v, what), what); }},
      {"word_order",
       [&s](const toml::node& v, const std::string& what) { s.word_order = parse_order(text_of(v, what), what); }},
  };
}

/// The three tables that exist for all robots and for one.
std::vector<Key> settings_keys(const Reader& reader, Settings& s) {
  return {
      {"sources",
       [&](const toml::node& v, const std::string& what) {
         reader.table(table_of(v, what), "[sources]", source_keys(reader, s));
       }},
      {"status", [&](const toml::node& v,
                     const std::string& what) { reader.table(table_of(v, what), "[status]", status_keys(s.status)); }},
      {"modbus", [&](const toml::node& v,
                     const std::string& what) { reader.table(table_of(v, what), "[modbus]", modbus_keys(s.modbus)); }},
  };
}

std::vector<Key> retention_keys(store::RetentionRules& rules) {
  return {
      {"age",
       [&rules](const toml::node& v, const std::string& what) { rules.age_us = parse_age(text_of(v, what), what); }},
      {"size", [&rules](const toml::node& v,
                        const std::string& what) { rules.size_bytes = parse_limit(text_of(v, what), what); }},
      {"reserve", [&rules](const toml::node& v,
                           const std::string& what) { rules.reserve_bytes = parse_limit(text_of(v, what), what); }},
  };
}

std::vector<Key> ring_keys(RingSettings& ring) {
  const auto length = [](Micros& out) {
    return [&out](const toml::node& v, const std::string& what) {
      out = parse_length(text_of(v, what), what, 1'000'000, kHour);
    };
  };
  const auto size = [](std::uint64_t& out) {
    return [&out](const toml::node& v, const std::string& what) { out = parse_size(text_of(v, what), what); };
  };
  return {{"before", length(ring.before_us)},
          {"after", length(ring.after_us)},
          {"budget", size(ring.budget_bytes)},
          {"per_day", size(ring.day_bytes)}};
}

toml::table to_table(const RingSettings& ring) {
  return toml::table{{"before", fmt::format("{}us", ring.before_us)},
                     {"after", fmt::format("{}us", ring.after_us)},
                     {"budget", fmt::format("{}KB", ring.budget_bytes / 1024)},
                     {"per_day", fmt::format("{}KB", ring.day_bytes / 1024)}};
}

toml::table to_table(const store::RetentionRules& rules) {
  const auto limit = [](std::uint64_t bytes) { return bytes == 0 ? "off" : fmt::format("{}KB", bytes / 1024); };
  return toml::table{{"age", rules.age_us == 0 ? "off" : fmt::format("{}us", rules.age_us)},
                     {"size", limit(rules.size_bytes)},
                     {"reserve", limit(rules.reserve_bytes)}};
}

RobotConfig read_robot(const Reader& reader, const toml::table& table, const Settings& defaults) {
  RobotConfig robot;
  robot.settings = defaults;
  std::vector<Key> keys = settings_keys(reader, robot.settings);
  keys.push_back({"name", [&](const toml::node& v, const std::string& what) { robot.name = text_of(v, what); }});
  keys.push_back({"host", [&](const toml::node& v, const std::string& what) { robot.host = text_of(v, what); }});
  keys.push_back(
      {"status_port", [&](const toml::node& v, const std::string& what) { robot.status_port = port_of(v, what); }});
  keys.push_back(
      {"modbus_port", [&](const toml::node& v, const std::string& what) { robot.modbus_port = port_of(v, what); }});
  keys.push_back(
      {"push_port", [&](const toml::node& v, const std::string& what) { robot.push_port = port_of(v, what); }});
  reader.table(table, "[[robot]]", keys);
  robot.where = reader.at(table.source());
  if (robot.name.empty() || robot.host.empty()) {
    throw UsageError(robot.where, fmt::format("a robot without {}", robot.name.empty() ? "name" : "host"),
                     "every [[robot]] needs name = \"...\" and host = \"...\"");
  }
  return robot;
}

void append_settings(const Settings& s, toml::table& out) {
  const auto text = [](Micros us) { return us == 0 ? std::string("0s") : fmt::format("{}us", us); };
  toml::table sources;
  for (const Source source : all_sources()) {
    const Rates rates = s.rates(source);
    if (!rates.varies()) {
      sources.insert(source_name(source), s.period(source) == 0 ? "off" : text(s.period(source)));
      continue;
    }
    toml::table periods;
    for (std::size_t i = 0; i < kActivityCount; ++i) {
      periods.insert(kActivityNames[i], text(rates.period_us[i]));
    }
    sources.insert(source_name(source), periods);
  }
  toml::table status{{"timeout", text(s.status.timeout_us)},
                     {"spacing", text(s.status.spacing_us)},
                     {"version", std::int64_t{s.status.version}},
                     {"allow_fast", s.status.allow_fast},
                     {"ring_laser", s.status.ring_laser}};
  const wire::StatusRequest& request = s.status.request;
  toml::array keys;
  for (const std::string& key : request.keys) {
    keys.push_back(key);
  }
  status.insert("keys", keys);
  const auto optional = [&status](std::string_view key, const auto& value) {
    if (value) {
      status.insert(key, *value);
    }
  };
  optional("return_laser", request.return_laser);
  optional("return_beams3D", request.return_beams3d);
  optional("return_mid360", request.return_mid360);
  optional("language", request.language);
  const std::string order(s.modbus.word_order ? word_order_name(*s.modbus.word_order) : "auto");
  toml::table modbus{{"timeout", text(s.modbus.timeout_us)},
                     {"spacing", text(s.modbus.spacing_us)},
                     {"unit", std::int64_t{s.modbus.unit}},
                     {"word_order", order}};
  out.insert("sources", sources);
  out.insert("status", status);
  out.insert("modbus", modbus);
}

std::string text_of_file(const std::filesystem::path& file) {
  const auto refuse = [&file](const std::string& cause) {
    throw UsageError(file.string(), cause, "check the path given with --config");
  };
  std::error_code error;
  if (std::filesystem::is_directory(file, error)) {
    refuse("is a folder");
  }
  errno = 0;
  std::ifstream in(file, std::ios::binary);
  if (!in) {
    refuse(std::strerror(errno));
  }
  std::ostringstream text;
  text << in.rdbuf();
  if (in.bad()) {
    refuse("cannot be read to its end");
  }
  return text.str();
}

}  // namespace

Config parse_config(std::string_view toml, const std::string& file_name) {
  const Reader reader(file_name);
  toml::table root;
  try {
    root = toml::parse(toml, file_name);
  } catch (const toml::parse_error& error) {
    throw UsageError(reader.at(error.source()), std::string(error.description()), "the file is not valid TOML");
  }
  Config config;
  std::vector<Key> keys = settings_keys(reader, config.defaults);
  keys.push_back({"log", [&](const toml::node& v, const std::string& what) { config.log = text_of(v, what); }});
  keys.push_back({"commit", [&](const toml::node& v, const std::string& what) {
                    config.commit_us = parse_length(text_of(v, what), what, 50'000, 600'000'000);
                  }});
  keys.push_back({"part_size", [&](const toml::node& v, const std::string& what) {
                    config.part_bytes = parse_size(text_of(v, what), what);
                  }});
  keys.push_back({"metrics", [&](const toml::node& v, const std::string& what) {
                    config.metrics = parse_listen(text_of(v, what), what);
                  }});
  keys.push_back({"retention", [&](const toml::node& v, const std::string& what) {
                    reader.table(table_of(v, what), "[retention]", retention_keys(config.retention));
                  }});
  keys.push_back({"ring", [&](const toml::node& v, const std::string& what) {
                    reader.table(table_of(v, what), "[ring]", ring_keys(config.ring));
                  }});
  const toml::array* robots = nullptr;
  keys.push_back({"robot", [&](const toml::node& v, const std::string& what) {
                    robots = v.as_array();
                    if (robots == nullptr) {
                      throw UsageError(what, "a list of robots was expected", "write [[robot]] with two brackets");
                    }
                  }});
  reader.table(root, "", keys);
  // Last, whatever their place in the file: robots start from the defaults.
  for (std::size_t i = 0; robots != nullptr && i < robots->size(); ++i) {
    const toml::node& item = (*robots)[i];
    add_robot(read_robot(reader, table_of(item, reader.at(item.source())), config.defaults), config);
  }
  return config;
}

Config read_config(const std::filesystem::path& file) { return parse_config(text_of_file(file), file.string()); }

LoadedConfig load_config(const std::filesystem::path& file, const Overrides& overrides) {
  LoadedConfig out;
  if (!file.empty()) {
    out.text = text_of_file(file);
    out.config = parse_config(out.text, file.string());
  }
  apply(overrides, out.config);
  validate(out.config);
  if (file.empty() || overrides.any()) {
    out.text = to_toml(out.config);
  }
  return out;
}

std::string to_toml(const Config& config) {
  toml::table root{{"log", config.log.string()},
                   {"commit", fmt::format("{}us", config.commit_us)},
                   {"part_size", fmt::format("{}KB", config.part_bytes / 1024)},
                   {"metrics", config.metrics.empty() ? "off" : config.metrics},
                   {"retention", to_table(config.retention)},
                   {"ring", to_table(config.ring)}};
  append_settings(config.defaults, root);
  toml::array robots;
  for (const RobotConfig& robot : config.robots) {
    toml::table item{{"name", robot.name},
                     {"host", robot.host},
                     {"status_port", std::int64_t{robot.status_port}},
                     {"modbus_port", std::int64_t{robot.modbus_port}},
                     {"push_port", std::int64_t{robot.push_port}}};
    append_settings(robot.settings, item);
    robots.push_back(item);
  }
  root.insert("robot", robots);
  std::ostringstream out;
  out << root << '\n';
  return out.str();
}

}  // namespace tacho::recorder
