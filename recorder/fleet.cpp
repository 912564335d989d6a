#include "recorder/fleet.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <system_error>

#include "schema/time.hpp"

namespace tacho::recorder {

namespace {

constexpr Micros kRobotStagger = 13'000;  // first polls of robots are this far apart, so that they do not burst

constexpr std::array kConnections{Protocol::status_port, Protocol::modbus, Protocol::push_port};

/// The sources of one connection, shifted against each other and against other robots.
std::vector<PolledSource> polled(const RobotConfig& robot, std::size_t robot_index, Protocol protocol) {
  std::vector<PolledSource> out;
  Micros shortest = 0;
  for (const Source source : all_sources()) {
    const Rates rates = robot.settings.rates(source);
    if (source_info(source).protocol == protocol && rates.fastest() > 0) {
      out.push_back({source, rates, 0});
      shortest = shortest == 0 ? rates.fastest() : std::min(shortest, rates.fastest());
    }
  }
  for (std::size_t i = 0; i < out.size(); ++i) {
    const Micros apart = shortest * static_cast<Micros>(i) / static_cast<Micros>(out.size());
    out[i].phase_us = (apart + kRobotStagger * static_cast<Micros>(robot_index)) % out[i].rates.fastest();
  }
  return out;
}

std::unique_ptr<Link> make_link(const RobotConfig& robot, Protocol protocol,
                                const std::shared_ptr<LinkMemory>& memory) {
  const std::shared_ptr<StatusHint> hint = memory->hint(robot.name);
  if (protocol == Protocol::modbus) {
    ModbusLinkOptions options = modbus_link_options(robot, hint);
    options.memory = memory;
    return std::make_unique<ModbusLink>(std::move(options));
  }
  if (protocol == Protocol::push_port) {
    return std::make_unique<PushLink>(robot.host, robot.push_port);
  }
  return std::make_unique<TcpLink>(status_link_options(robot, hint));
}

}  // namespace

TcpLinkOptions status_link_options(const RobotConfig& robot, std::shared_ptr<StatusHint> hint) {
  TcpLinkOptions options;
  options.host = robot.host;
  options.port = robot.status_port;
  options.version = robot.settings.status.version;
  options.status_body = wire::status_request_body(robot.settings.status.request);
  options.ring_body = wire::status_request_body(robot.settings.ring_request());
  options.hint = std::move(hint);
  return options;
}

ModbusLinkOptions modbus_link_options(const RobotConfig& robot, std::shared_ptr<StatusHint> hint) {
  ModbusLinkOptions options;
  options.host = robot.host;
  options.port = robot.modbus_port;
  options.unit = robot.settings.modbus.unit;
  options.word_order = robot.settings.modbus.word_order;
  options.status = std::move(hint);
  return options;
}

LinkFactory make_links(std::shared_ptr<LinkMemory> memory) {
  return [memory = std::move(memory)](const RobotConfig& robot, Protocol protocol) {
    return make_link(robot, protocol, memory);
  };
}

Fleet::~Fleet() {
  stop();
  join();
}

void Fleet::Station::stop() {
  clock.stop();
  poller->interrupt();
}

std::unique_ptr<Fleet::Station> Fleet::make_station(const RobotConfig& robot, const Crew& crew, std::size_t index,
                                                    Protocol protocol) {
  PollerOptions out;
  out.robot = crew.id;
  out.session = options_.session;
  out.watch = crew.watch.get();
  if (options_.stranger) {
    out.stranger = [this, id = crew.id](const Identity& other) { options_.stranger(id, other); };
  }
  out.word_order = robot.settings.modbus.word_order.value_or(WordOrder::cdab);
  const bool modbus = protocol == Protocol::modbus;
  out.sources = polled(robot, index, protocol);
  if (out.sources.empty()) {
    return nullptr;
  }
  for (PolledSource& source : out.sources) {
    const auto earlier = ended_.find({crew.id, source.source});
    source.first_seq = earlier == ended_.end() ? 0 : earlier->second.planned;
  }
  auto station = std::make_unique<Station>();
  station->protocol = protocol;
  station->timeout_us = modbus ? robot.settings.modbus.timeout_us : robot.settings.status.timeout_us;
  out.timeout = std::chrono::milliseconds(station->timeout_us / 1000);
  out.spacing_us = modbus ? robot.settings.modbus.spacing_us : robot.settings.status.spacing_us;
  station->poller = std::make_unique<Poller>(std::move(out), options_.make(robot, protocol), station->clock, sink_);
  return station;
}

void Fleet::run(Station& station, Micros start_us) {
  station.poller->run(start_us, options_.end_us);
  station.ended = true;
  --running_;
}

void Fleet::start(const RobotConfig& robot, const Row& row, std::size_t index, Micros start_us) {
  auto crew = std::make_unique<Crew>();
  crew->robot = row.name;
  crew->id = row.id;
  RobotWatch::Options watch;
  watch.identity = row.identity;
  watch.rates_vary = robot.settings.rates_vary();
  watch.stale_us = std::max(watch.stale_us, 3 * robot.settings.slowest_us());
  crew->watch = std::make_unique<RobotWatch>(std::move(watch), reader_);
  crew->watch->on_faster([&crew = *crew] {
    std::for_each(crew.stations.begin(), crew.stations.end(), [](const auto& station) { station->clock.wake(); });
  });
  for (const Protocol protocol : kConnections) {
    if (auto station = make_station(robot, *crew, index, protocol)) {
      crew->stations.push_back(std::move(station));
    }
  }
  running_ += crew->stations.size();
  try {
    for (const auto& station : crew->stations) {
      station->thread = std::thread([this, &station = *station, start_us] { run(station, start_us); });
    }
  } catch (const std::system_error& error) {
    dismiss(*crew);
    throw Error(robot.name, fmt::format("no thread can be had for it: {}", error.what()),
                "this host is at its limit (TasksMax, ulimit -u)");
  }
  const std::lock_guard lock(mutex_);
  crews_.push_back(std::move(crew));
}

/// Of a crew some of whose threads could not be started.
void Fleet::dismiss(Crew& crew) {
  for (const auto& station : crew.stations) {
    station->stop();
    if (station->thread.joinable()) {
      station->thread.join();
    } else {
      --running_;
    }
  }
}

void Fleet::stop(RobotId row) {
  for (const auto& crew : crews_) {
    if (crew->id == row) {
      std::for_each(crew->stations.begin(), crew->stations.end(), [](const auto& station) { station->stop(); });
    }
  }
}

Identity Fleet::retire(RobotId row) {
  const auto found = std::find_if(crews_.begin(), crews_.end(), [&](const auto& crew) { return crew->id == row; });
  if (found == crews_.end()) {
    return {};
  }
  stop(row);
  for (const auto& station : (*found)->stations) {
    station->thread.join();
  }
  const std::lock_guard lock(mutex_);
  for (const auto& station : (*found)->stations) {
    for (std::size_t lane = 0; lane < station->poller->options().sources.size(); ++lane) {
      StreamCounts counts = counts_of(**found, *station->poller, lane);
      counts.last_period_us = std::exchange(counts.period_us, 0);
      ended_[{counts.id, counts.source}] = std::move(counts);
    }
  }
  Identity identity = (*found)->watch->identity();
  crews_.erase(found);
  return identity;
}

std::map<RobotId, Identity> Fleet::identities() const {
  const std::lock_guard lock(mutex_);
  std::map<RobotId, Identity> out;
  for (const auto& crew : crews_) {
    out.emplace(crew->id, crew->watch->identity());
  }
  return out;
}

void Fleet::stop() {
  const std::lock_guard lock(mutex_);
  for (const auto& crew : crews_) {
    for (const auto& station : crew->stations) {
      station->stop();
    }
  }
}

void Fleet::join() {
  for (const auto& crew : crews_) {
    for (const auto& station : crew->stations) {
      if (station->thread.joinable()) {
        station->thread.join();
      }
    }
  }
}

/// With what earlier pollers of the stream have counted.
Fleet::StreamCounts Fleet::counts_of(const Crew& crew, const Poller& poller, std::size_t lane) const {
  const PolledSource& plan = poller.options().sources[lane];
  const auto earlier = ended_.find({crew.id, plan.source});
  StreamCounts out = earlier == ended_.end() ? StreamCounts{} : earlier->second;
  out.robot = crew.robot;
  out.id = crew.id;
  out.source = plan.source;
  const SourceCounters& counters = poller.counters(lane);
  out.period_us = counters.period_us;
  out.planned = counters.planned;  // a number of a poll: of all pollers
  for (std::size_t cause = 0; cause < kCauseCount; ++cause) {
    out.missed[cause] += counters.missed[cause];
  }
  return out;
}

std::vector<Fleet::StreamCounts> Fleet::streams() const {
  const std::lock_guard lock(mutex_);
  std::vector<StreamCounts> out;
  for (const auto& crew : crews_) {
    for (const auto& station : crew->stations) {
      for (std::size_t lane = 0; lane < station->poller->options().sources.size(); ++lane) {
        out.push_back(counts_of(*crew, *station->poller, lane));
      }
    }
  }
  const std::size_t living = out.size();
  for (const auto& ended : ended_) {
    const auto end = out.begin() + static_cast<std::ptrdiff_t>(living);
    const auto same = [&](const StreamCounts& s) { return StreamId(s.id, s.source) == ended.first; };
    if (std::none_of(out.begin(), end, same)) {
      out.push_back(ended.second);
    }
  }
  return out;
}

std::vector<LinkNow> Fleet::links() const {
  const std::lock_guard lock(mutex_);
  std::vector<LinkNow> out;
  for (const auto& crew : crews_) {
    for (const auto& station : crew->stations) {
      out.push_back({crew->robot, station->protocol, station->poller->link_up()});
    }
  }
  return out;
}

std::vector<Beat> Fleet::beats() const {
  const std::lock_guard lock(mutex_);
  std::vector<Beat> out;
  for (const auto& crew : crews_) {
    for (const auto& station : crew->stations) {
      const Micros busy_us = station->ended ? 0 : station->clock.busy_us();
      out.push_back({fmt::format("{}: {}", crew->robot, protocol_name(station->protocol)), busy_us,
                     station->timeout_us + kPollerMayTake});
    }
  }
  return out;
}

}  // namespace tacho::recorder
