#include "recorder/recorder.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <ctime>
#include <thread>
#include <utility>

#include "recorder/link/modbus_link.hpp"
#include "recorder/link/tcp_link.hpp"
#include "recorder/log_thread.hpp"
#include "schema/log.hpp"
#include "schema/time.hpp"

namespace tacho::recorder {

namespace {

constexpr Micros kRobotStagger = 13'000;  // first polls of robots are this far apart, so that they do not burst
constexpr Micros kForever = 4'000'000'000'000'000;  // 126 years

struct Connection {
  Protocol protocol;
  std::array<Source, 2> sources;
};
constexpr std::array kConnections{Connection{Protocol::status_port, {Source::status, Source::io}},
                                  Connection{Protocol::modbus, {Source::registers, Source::inputs}}};

std::string host_text() {
  std::array<char, 256> name{};
  gethostname(name.data(), name.size() - 1);
  const std::time_t now = std::time(nullptr);
  std::tm local{};
  localtime_r(&now, &local);
  const long minutes = local.tm_gmtoff / 60;
  return fmt::format("{} UTC{}{:02}:{:02}", name.data(), minutes < 0 ? '-' : '+', std::abs(minutes) / 60,
                     std::abs(minutes) % 60);
}

/// The sources of one connection, shifted against each other and against other robots.
std::vector<PolledSource> polled(const RobotConfig& robot, std::size_t robot_index, const Connection& connection) {
  std::vector<PolledSource> out;
  Micros shortest = kForever;
  for (const Source source : connection.sources) {
    const Micros period = robot.settings.period(source);
    if (period > 0) {
      out.push_back({source, period, 0});
      shortest = std::min(shortest, period);
    }
  }
  for (std::size_t i = 0; i < out.size(); ++i) {
    const Micros apart = shortest * static_cast<Micros>(i) / static_cast<Micros>(out.size());
    out[i].phase_us = (apart + kRobotStagger * static_cast<Micros>(robot_index)) % out[i].period_us;
  }
  return out;
}

Stream stream_of(const RobotConfig& robot, SessionId session, RobotId id, Source source) {
  Stream stream;
  stream.session = session;
  stream.robot = id;
  stream.source = source;
  stream.period_us = robot.settings.period(source);
  stream.word_order = robot.settings.modbus.word_order.value_or(WordOrder::cdab);
  if (source == Source::status) {
    stream.request = wire::status_request_body(robot.settings.status.request);
  } else if (source != Source::io) {
    stream.request = wire::to_text(RegisterPlan(source == Source::inputs).ranges());
  }
  return stream;
}

}  // namespace

std::unique_ptr<Link> make_link(const RobotConfig& robot, Protocol protocol) {
  const Settings& settings = robot.settings;
  if (protocol == Protocol::modbus) {
    ModbusLinkOptions options;
    options.host = robot.host;
    options.port = robot.modbus_port;
    options.unit = settings.modbus.unit;
    options.word_order = settings.modbus.word_order;
    return std::make_unique<ModbusLink>(std::move(options));
  }
  TcpLinkOptions options;
  options.host = robot.host;
  options.port = robot.status_port;
  options.version = settings.status.version;
  options.status_body = wire::status_request_body(settings.status.request);
  return std::make_unique<TcpLink>(std::move(options));
}

struct Recorder::Impl {
  Config config;
  Options options;
  HostClock clock;
  store::LogWriter writer;
  Ingest ingest;
  std::vector<RobotId> ids;  // by robot of the configuration
  std::unique_ptr<LogThread> log;
  std::vector<std::unique_ptr<Poller>> pollers;
  std::vector<std::size_t> owner;  // robot index of each poller
  std::vector<std::thread> threads;
  std::vector<std::string> outlook;
  std::atomic<std::size_t> running{0};

  Impl(const Config& c, Options o)
      : config(c), options(with_notice(std::move(o))), writer(config.log, writer_options()), ingest(writer) {}

  static Options with_notice(Options options) {
    if (!options.notice) {
      options.notice = [](const std::string&) {};
    }
    return options;
  }

  [[nodiscard]] store::WriterOptions writer_options() const {
    store::WriterOptions out;
    out.part_bytes = config.part_bytes;
    out.decode = answer_decode();
    out.retention.rules = config.retention;
    out.retention.time = store::host_time;
    out.retention.tell = options.notice;
    return out;
  }

  SessionId begin() {
    Session session;
    session.t_start_us = wall_now_us();
    session.software = "tacho-recorder " TACHO_VERSION;
    session.config = options.config_text.empty() ? to_toml(config) : options.config_text;
    session.host = host_text();
    const SessionId id = writer.begin_session(session);
    for (const RobotConfig& robot : config.robots) {
      ids.push_back(writer.robot(robot.name, robot.address()));
      for (std::size_t s = 0; s < kSourceCount; ++s) {
        if (robot.settings.period_us[s] > 0) {
          ingest.declare(stream_of(robot, id, ids.back(), static_cast<Source>(s)));
        }
      }
    }
    writer.add(ClockPoint{0, id, wall_now_us(), mono_now_us(), std::nullopt});
    writer.commit();  // from here on a kill leaves a session that can be closed
    return id;
  }

  void make_log() {
    LogThread::Options out;
    out.commit_interval = std::chrono::microseconds(config.commit_us);
    out.queue_items = options.queue_items;
    out.queue_bytes = options.queue_bytes;
    out.planned = [this](store::LogWriter& w) { hand_over_planned(w); };
    out.notice = options.notice;
    for (std::size_t i = 0; i < config.robots.size(); ++i) {
      const RobotConfig& robot = config.robots[i];
      out.robot_names.push_back(robot.name);
      out.robot_ids.push_back(ids[i]);
      out.expects_io.push_back(robot.settings.period(Source::io) == 0 && robot.settings.status.request.keys.empty());
    }
    log = std::make_unique<LogThread>(writer, ingest, std::move(out));
  }

  void make_pollers(SessionId session) {
    for (std::size_t i = 0; i < config.robots.size(); ++i) {
      const RobotConfig& robot = config.robots[i];
      for (const Connection& connection : kConnections) {
        PollerOptions out;
        out.robot = ids[i];
        out.session = session;
        out.sources = polled(robot, i, connection);
        const bool modbus = connection.protocol == Protocol::modbus;
        const Micros timeout = modbus ? robot.settings.modbus.timeout_us : robot.settings.status.timeout_us;
        out.timeout = std::chrono::milliseconds(timeout / 1000);
        out.spacing_us = modbus ? robot.settings.modbus.spacing_us : robot.settings.status.spacing_us;
        if (!out.sources.empty()) {
          pollers.push_back(
              std::make_unique<Poller>(std::move(out), options.make(robot, connection.protocol), clock, *log));
          owner.push_back(i);
        }
      }
    }
  }

  void start() {
    const Micros start_us = clock.mono_us();
    const Micros end_us = start_us + options.run_for_us.value_or(kForever);
    running = pollers.size();
    log->start();
    for (const auto& poller : pollers) {
      threads.emplace_back([this, &poller = *poller, start_us, end_us] {
        poller.run(start_us, end_us);
        --running;
      });
    }
  }

  void stop() {
    clock.stop();
    for (const auto& poller : pollers) {
      poller->interrupt();
    }
  }

  void join() {
    for (std::thread& thread : threads) {
      thread.join();
    }
    threads.clear();
  }

  void hand_over_planned(store::LogWriter& w) const {
    for (const auto& poller : pollers) {
      const PollerOptions& o = poller->options();
      for (std::size_t s = 0; s < o.sources.size(); ++s) {
        w.planned(o.robot, o.sources[s].source, poller->counters(s).planned);
      }
    }
  }

  [[nodiscard]] std::vector<SourceSummary> summary() const {
    std::vector<SourceSummary> out;
    for (std::size_t p = 0; p < pollers.size(); ++p) {
      for (std::size_t s = 0; s < pollers[p]->options().sources.size(); ++s) {
        SourceSummary row;
        row.robot = config.robots[owner[p]].name;
        row.source = pollers[p]->options().sources[s].source;
        row.planned = pollers[p]->counters(s).planned;
        const store::LogWriter::Tally tally = writer.tally(pollers[p]->options().robot, row.source);
        row.stored = tally.stored;
        row.partial = tally.partial;
        row.missed = tally.missed;
        out.push_back(std::move(row));
      }
    }
    return out;
  }
};

Recorder::Recorder(const Config& config, Options options) : impl_(std::make_unique<Impl>(config, std::move(options))) {
  const SessionId session = impl_->begin();
  impl_->outlook = {store::rules_text(config.retention),
                    store::forecast_text(impl_->writer.forecast(), config.retention)};
  impl_->make_log();
  impl_->make_pollers(session);
  impl_->start();
}

Recorder::~Recorder() {
  impl_->stop();
  impl_->join();
  impl_->log.reset();  // its thread still looks at the pollers' counters
}

std::vector<std::string> Recorder::outlook() const { return impl_->outlook; }

void Recorder::stop() { impl_->stop(); }

bool Recorder::done() const { return impl_->running == 0 || impl_->log->failed(); }

Progress Recorder::progress() const {
  Progress out;
  out.robots = impl_->config.robots.size();
  std::vector<bool> ok(out.robots, true);
  for (std::size_t p = 0; p < impl_->pollers.size(); ++p) {
    const Poller& poller = *impl_->pollers[p];
    ok[impl_->owner[p]] = ok[impl_->owner[p]] && poller.link_up();
    for (std::size_t s = 0; s < poller.options().sources.size(); ++s) {
      out.missed += poller.counters(s).missed_total();
    }
  }
  out.robots_ok = static_cast<std::size_t>(std::count(ok.begin(), ok.end(), true));
  const store::LogWriter::Stats stats = impl_->log->stats();
  out.rows = stats.rows;
  out.missed += stats.lost;
  out.queued = impl_->log->queued();
  out.last_commit = stats.last_commit;
  out.stored_bytes = stats.stored_bytes;
  return out;
}

std::vector<SourceSummary> Recorder::finish() {
  if (impl_->running != 0) {
    impl_->stop();
  }
  impl_->join();
  impl_->log->finish(true);
  return impl_->summary();
}

}  // namespace tacho::recorder
