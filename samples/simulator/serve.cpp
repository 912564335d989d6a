#include "samples/simulator/serve.hpp"

#include <utility>

#include "samples/simulator/modbus_server.hpp"
#include "samples/simulator/push_server.hpp"
#include "samples/simulator/status_server.hpp"
#include "schema/error.hpp"

namespace tacho::sim {
namespace {

// One robot and, while it is switched on, its three servers.
struct LiveStation {
  explicit LiveStation(const ServedRobot& served)
      : robot(served.scenario),
        faults(served.scenario.link_faults),
        status_port(served.status_port),
        modbus_port(served.modbus_port),
        push_port(served.push_port) {}

  LiveRobot robot;
  FaultPlan faults;
  std::uint16_t status_port;
  std::uint16_t modbus_port;
  std::uint16_t push_port;
  std::unique_ptr<StatusServer> status;
  std::unique_ptr<ModbusServer> modbus;
  std::unique_ptr<PushServer> push;

  void start(const ServeOptions& options) {
    Listener status_listener(options.bind, status_port);
    Listener modbus_listener(options.bind, modbus_port);
    status_port = status_listener.port();
    modbus_port = modbus_listener.port();
    status = std::make_unique<StatusServer>(robot, faults, std::move(status_listener), options.max_clients);
    modbus = std::make_unique<ModbusServer>(robot, faults, std::move(modbus_listener));
    if (options.push_period_us > 0) {
      Listener push_listener(options.bind, push_port);
      push_port = push_listener.port();
      push = std::make_unique<PushServer>(robot, faults, std::move(push_listener),
                                          std::chrono::microseconds(options.push_period_us));
    }
  }
  void stop() {
    status.reset();
    modbus.reset();
    push.reset();
  }
};

}  // namespace

struct Server::Impl {
  ServeOptions options;
  std::vector<std::unique_ptr<LiveStation>> robots;
};

Server::Server(std::vector<ServedRobot> robots, ServeOptions options) : impl_(std::make_unique<Impl>()) {
  impl_->options = std::move(options);
  for (const ServedRobot& served : robots) {
    impl_->robots.push_back(std::make_unique<LiveStation>(served));
    impl_->robots.back()->start(impl_->options);
  }
}

Server::~Server() {
  try {
    finish();
  } catch (const Error&) {
    // Whoever wants to know calls finish() itself.
  }
}

std::uint16_t Server::status_port(std::size_t robot) const { return impl_->robots.at(robot)->status_port; }
std::uint16_t Server::modbus_port(std::size_t robot) const { return impl_->robots.at(robot)->modbus_port; }
std::uint16_t Server::push_port(std::size_t robot) const { return impl_->robots.at(robot)->push_port; }

void Server::stop(std::size_t robot) { impl_->robots.at(robot)->stop(); }

void Server::start(std::size_t robot) {
  LiveStation& station = *impl_->robots.at(robot);
  if (!station.status) {
    station.start(impl_->options);
  }
}

void Server::fault(std::size_t robot, Port port, const LinkFault* fault) {
  impl_->robots.at(robot)->faults.set(port, fault);
}

Truth Server::truth(std::size_t robot) const { return impl_->robots.at(robot)->robot.truth(); }

void Server::finish() {
  std::vector<std::string> names;
  std::vector<Truth> truths;
  for (const auto& robot : impl_->robots) {
    robot->stop();
    names.push_back(robot->robot.scenario().name);
    truths.push_back(robot->robot.truth());
  }
  const std::string file = std::exchange(impl_->options.truth_file, {});
  if (!file.empty()) {
    write_truth(file, names, truths);
  }
}

}  // namespace tacho::sim
