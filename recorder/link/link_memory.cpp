#include "recorder/link/link_memory.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <system_error>
#include <utility>

#include "schema/time.hpp"

namespace tacho::recorder {

namespace {

using Json = nlohmann::ordered_json;

constexpr int kVersion = 1;
constexpr Micros kRecent = 5'000'000;
constexpr std::size_t kMostRobots = 10'000;
constexpr std::uintmax_t kMostBytes = 16u << 20;

Json to_json(const std::vector<wire::Range>& ranges) {
  Json out = Json::array();
  for (const wire::Range range : ranges) {
    out.push_back({range.first, range.count});
  }
  return out;
}

Json to_json(const LearnedPlan& plan) {
  return {{"ranges", to_json(plan.ranges)}, {"illegal", to_json(plan.illegal)}, {"at_us", plan.at_us}};
}

Json to_json(const LearnedRobot& robot) {
  Json out;
  if (robot.word_order) {
    out["word_order"] = std::string(word_order_name(*robot.word_order));
  }
  out["shift"] = robot.shift;
  out["registers"] = to_json(robot.registers);
  out["inputs"] = to_json(robot.inputs);
  return out;
}

// Reading throws nlohmann's exceptions, which load() turns into words.

/// The library turns any number into any other.
template <class Whole>
Whole whole(const Json& json) {
  const bool too_large = json.is_number_unsigned() && json.get<std::uint64_t>() > std::uint64_t{INT64_MAX};
  if (json.is_number_integer() && !too_large && std::in_range<Whole>(json.get<std::int64_t>())) {
    return static_cast<Whole>(json.get<std::int64_t>());
  }
  throw std::system_error(std::make_error_code(std::errc::result_out_of_range),
                          json.dump(-1, ' ', false, Json::error_handler_t::replace).substr(0, 40));
}

std::vector<wire::Range> ranges_in(const Json& json) {
  std::vector<wire::Range> out;
  for (const Json& pair : json) {
    out.push_back({whole<std::uint16_t>(pair.at(0)), whole<std::uint16_t>(pair.at(1))});
  }
  return out;
}

LearnedPlan plan_in(const Json& json) {
  // Not before 1970: it is subtracted from the time of day.
  return {ranges_in(json.at("ranges")), ranges_in(json.at("illegal")),
          std::max<Micros>(0, whole<Micros>(json.at("at_us")))};
}

LearnedRobot robot_in(const Json& json) {
  LearnedRobot out;
  WordOrder order{};
  if (json.contains("word_order") && parse_word_order(json.at("word_order").get<std::string>(), order)) {
    out.word_order = order;
  }
  const int shift = whole<int>(json.at("shift"));
  out.shift = shift == 1 ? 1 : 0;
  out.registers = plan_in(json.at("registers"));
  out.inputs = plan_in(json.at("inputs"));
  return out;
}

std::map<std::string, LearnedRobot> robots_in(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  const Json json = Json::parse(in);
  std::map<std::string, LearnedRobot> out;
  if (whole<int>(json.at("version")) != kVersion) {
    throw std::system_error(std::make_error_code(std::errc::not_supported), "written by another version");
  }
  for (const auto& [address, robot] : json.at("robots").items()) {
    if (out.size() < kMostRobots) {
      out[address] = robot_in(robot);
    }
  }
  return out;
}

std::string system_words() { return std::generic_category().message(errno); }

/// Empty when the bytes are safely in `file`.
std::string write_whole(const std::filesystem::path& file, std::string_view bytes) {
  const std::string fresh = file.string() + ".new";
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> out(std::fopen(fresh.c_str(), "wb"), std::fclose);
  const bool written = out && std::fwrite(bytes.data(), 1, bytes.size(), out.get()) == bytes.size() &&
                       std::fflush(out.get()) == 0 && ::fsync(::fileno(out.get())) == 0;
  if (!written || std::rename(fresh.c_str(), file.c_str()) != 0) {
    return system_words();
  }
  const int folder = ::open(file.parent_path().c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (folder >= 0) {
    ::fsync(folder);  // the new name; without it a power cut may leave the old file, which is whole as well
    ::close(folder);
  }
  return {};
}

}  // namespace

void StatusHint::heard(std::string_view body) {
  const std::lock_guard lock(mutex_);
  body_ = body;
  heard_us_ = mono_now_us();
}

std::string StatusHint::recent() const {
  const std::lock_guard lock(mutex_);
  return !body_.empty() && mono_now_us() - heard_us_ < kRecent ? body_ : std::string();
}

LinkMemory::LinkMemory(std::filesystem::path file) : file_(std::move(file)) {
  std::error_code error;
  if (!std::filesystem::exists(file_, error)) {
    return;
  }
  try {
    if (std::filesystem::file_size(file_) > kMostBytes) {
      throw std::system_error(std::make_error_code(std::errc::file_too_large));
    }
    robots_ = robots_in(file_);
  } catch (const std::exception& e) {
    problem_ = fmt::format("{}: {}; what it said about robots is learned again", file_.string(), e.what());
  }
}

LearnedRobot LinkMemory::recall(const std::string& address) const {
  const std::lock_guard lock(mutex_);
  const auto found = robots_.find(address);
  return found == robots_.end() ? LearnedRobot{} : found->second;
}

void LinkMemory::learn(const std::string& address, const LearnedRobot& robot) {
  const std::lock_guard lock(mutex_);
  LearnedRobot& known = robots_[address];
  changed_ = changed_ || !(known == robot);
  known = robot;
}

std::shared_ptr<StatusHint> LinkMemory::hint(const std::string& robot) {
  const std::lock_guard lock(mutex_);
  std::shared_ptr<StatusHint>& hint = hints_[robot];
  if (!hint) {
    hint = std::make_shared<StatusHint>();
  }
  return hint;
}

std::string LinkMemory::save() {
  std::map<std::string, LearnedRobot> robots;
  {
    const std::lock_guard lock(mutex_);
    if (!std::exchange(changed_, false) || file_.empty()) {
      return {};
    }
    robots = robots_;
  }
  Json json{{"version", kVersion}, {"robots", Json::object()}};
  for (const auto& [address, robot] : robots) {
    json["robots"][address] = to_json(robot);
  }
  std::string trouble = write_whole(file_, json.dump(1, ' ', false, Json::error_handler_t::replace) + "\n");
  if (!trouble.empty()) {
    const std::lock_guard lock(mutex_);
    changed_ = true;  // tried again at the next call
  }
  if (trouble == std::exchange(told_, trouble)) {
    return {};
  }
  return trouble.empty() ? trouble
                         : fmt::format("{}: {}; what is learned about robots is learned again after a restart",
                                       file_.string(), trouble);
}

}  // namespace tacho::recorder
