#include "recorder/reload.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>

namespace tacho::recorder {

namespace {

/// Settings that are fixed while recording, as text to be compared.
struct Fixed {
  std::string_view key;
  std::string (*value)(const Config&);
};
constexpr std::array kFixed{
    Fixed{"log", [](const Config& c) { return c.log.string(); }},
    Fixed{"commit", [](const Config& c) { return fmt::format("{}", c.commit_us); }},
    Fixed{"part_size", [](const Config& c) { return fmt::format("{}", c.part_bytes); }},
    Fixed{"[retention]",
          [](const Config& c) {
            return fmt::format("{} {} {}", c.retention.age_us, c.retention.size_bytes, c.retention.reserve_bytes);
          }},
    Fixed{"[ring]",
          [](const Config& c) {
            return fmt::format("{} {} {} {}", c.ring.before_us, c.ring.after_us, c.ring.budget_bytes, c.ring.day_bytes);
          }},
    Fixed{"metrics", [](const Config& c) { return c.metrics; }},
};

/// Everything that can be set for a robot.
std::string text_of(const RobotConfig& robot) {
  Config alone;
  alone.robots.push_back(robot);
  return to_toml(alone);
}

template <class List, class Name>
std::string named(std::string_view what, const List& list, const Name& name) {
  std::string out;
  for (const auto& item : list) {
    out += fmt::format("{}{}", out.empty() ? fmt::format(", {}: ", what) : ", ", name(item));
  }
  return out;
}

}  // namespace

std::string ReloadPlan::text() const {
  const auto name_of = [](const RobotConfig& robot) { return robot.name; };
  return fmt::format("{} robot{} kept", kept, kept == 1 ? "" : "s") + named("changed", changed, name_of) +
         named("added", added, name_of) + named("removed", removed, [](const std::string& name) { return name; });
}

ReloadPlan plan_reload(const Config& now, const Config& next) {
  for (const Fixed& fixed : kFixed) {
    if (fixed.value(now) != fixed.value(next)) {
      throw UsageError(std::string(fixed.key), "cannot be changed while recording",
                       "restart the recorder, or set it back and reload");
    }
  }
  const auto find = [](const Config& config, const std::string& name) {
    const auto found = std::find_if(config.robots.begin(), config.robots.end(),
                                    [&](const RobotConfig& robot) { return robot.name == name; });
    return found == config.robots.end() ? nullptr : &*found;
  };
  ReloadPlan plan;
  for (const RobotConfig& robot : next.robots) {
    const RobotConfig* const known = find(now, robot.name);
    if (known == nullptr) {
      plan.added.push_back(robot);
    } else if (text_of(*known) != text_of(robot)) {
      plan.changed.push_back(robot);
    } else {
      ++plan.kept;
    }
  }
  for (const RobotConfig& robot : now.robots) {
    if (find(next, robot.name) == nullptr) {
      plan.removed.push_back(robot.name);
    }
  }
  return plan;
}

}  // namespace tacho::recorder
