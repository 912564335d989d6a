#include "samples/simulator/live_robot.hpp"

#include <cerrno>
#include <cstring>
#include <fstream>
#include <iterator>

#include "schema/error.hpp"
#include "schema/time.hpp"

namespace tacho::sim {
namespace {

std::string read_bytes(const std::string& file) {
  if (file.empty()) {
    return {};
  }
  std::ifstream in(file, std::ios::binary);
  std::string bytes{std::istreambuf_iterator<char>(in), {}};
  if (!in) {
    throw Error("cannot read body file " + file, std::strerror(errno), "");
  }
  return bytes;
}

}  // namespace

LiveRobot::LiveRobot(const Scenario& scenario)
    : scenario_(scenario),
      body_(read_bytes(scenario.body_file)),
      io_body_(read_bytes(scenario.io_body_file)),
      t0_us_(wall_now_us()),
      mono0_us_(mono_now_us()),
      robot_(scenario, t0_us_),
      answers_(scenario) {}

const RobotState& LiveRobot::now() { return robot_.at(t0_us_ + mono_now_us() - mono0_us_); }

std::string LiveRobot::status(std::span<const std::string> keys, bool lasers) {
  const std::lock_guard lock(mutex_);
  if (!scenario_.body_file.empty()) {
    return body_;
  }
  return answers_.status(now(), scenario_.ignores_keys ? std::span<const std::string>() : keys, lasers);
}

std::string LiveRobot::push() {
  const std::lock_guard lock(mutex_);
  return answers_.push(now());
}

std::string LiveRobot::io() {
  const std::lock_guard lock(mutex_);
  return scenario_.io_body_file.empty() ? answers_.io(now()) : io_body_;
}

std::array<std::uint16_t, 140> LiveRobot::registers() {
  const std::lock_guard lock(mutex_);
  return answers_.registers(now());
}

std::array<std::uint8_t, 80> LiveRobot::inputs() {
  const std::lock_guard lock(mutex_);
  return answers_.inputs(now());
}

Truth LiveRobot::truth() {
  const std::lock_guard lock(mutex_);
  now();
  return robot_.truth();
}

}  // namespace tacho::sim
