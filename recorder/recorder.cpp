#include "recorder/recorder.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <ctime>
#include <set>
#include <utility>

#include "recorder/link/register_plan.hpp"
#include "recorder/log_thread.hpp"
#include "recorder/reload.hpp"
#include "schema/log.hpp"
#include "schema/time.hpp"

namespace tacho::recorder {

namespace {

constexpr const char* kMemoryFile = "learned.json";  // in the folder of the log
constexpr Micros kForever = 4'000'000'000'000'000;   // 126 years

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

std::string period_text(Micros period) { return period == 0 ? "off" : duration_text(period); }

}  // namespace

struct Recorder::Impl {
  Config config;
  Options options;
  store::LogWriter writer;  // of the log's thread, once that runs; so are the next two
  Ingest ingest;
  std::set<std::pair<RobotId, Source>> declared;
  Session session;
  std::vector<std::string> outlook;
  std::map<std::string, RobotId> ids;
  std::shared_ptr<LinkMemory> memory;
  std::unique_ptr<LogThread> log;
  std::unique_ptr<Fleet> fleet;

  Impl(const Config& c, Options o)
      : config(c), options(with_notice(std::move(o))), writer(config.log, writer_options()), ingest(writer) {}

  void remember() {
    memory = std::make_shared<LinkMemory>(config.log / kMemoryFile);
    if (!memory->problem().empty()) {
      options.notice(memory->problem());
    }
  }

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

  void make_log() {
    LogThread::Options out;
    out.commit_interval = std::chrono::microseconds(config.commit_us);
    out.queue_items = options.queue_items;
    out.queue_bytes = options.queue_bytes;
    out.planned = [this](store::LogWriter& w) { hand_over_planned(w); };
    out.notice = options.notice;
    out.forecast = writer.forecast();
    outlook = {store::rules_text(config.retention), store::forecast_text(out.forecast, config.retention)};
    log = std::make_unique<LogThread>(writer, ingest, std::move(out));
  }

  /// Makes robot and streams known to the log.
  void enter(const RobotConfig& robot) {
    const RobotId id = writer.robot(robot.name, robot.address());
    for (std::size_t s = 0; s < kSourceCount; ++s) {
      const auto source = static_cast<Source>(s);
      if (robot.settings.period(source) > 0 && declared.emplace(id, source).second) {
        ingest.declare(stream_of(robot, session.id, id, source));
      }
    }
    log->watch(id, robot);
    ids[robot.name] = id;
  }

  void begin() {
    session.t_start_us = wall_now_us();
    session.software = "tacho-recorder " TACHO_VERSION;
    session.config = options.config_text.empty() ? to_toml(config) : options.config_text;
    session.host = host_text();
    session.id = writer.begin_session(session);
    for (const RobotConfig& robot : config.robots) {
      enter(robot);
    }
    writer.add(ClockPoint{0, session.id, wall_now_us(), mono_now_us(), std::nullopt});
    writer.commit();  // from here on a kill leaves a session that can be closed
  }

  void start() {
    Fleet::Options out;
    out.make = options.make ? options.make : make_links(memory);
    out.session = session.id;
    const Micros start_us = mono_now_us();
    out.end_us = start_us + options.run_for_us.value_or(kForever);
    fleet = std::make_unique<Fleet>(std::move(out), *log);
    log->start();
    for (std::size_t i = 0; i < config.robots.size(); ++i) {
      fleet->start(config.robots[i], ids.at(config.robots[i].name), i, start_us);
    }
  }

  void hand_over_planned(store::LogWriter& w) const {
    for (const Fleet::StreamCounts& stream : fleet->streams()) {
      w.planned(stream.id, stream.source, stream.planned);
    }
    if (const std::string trouble = memory->save(); !trouble.empty()) {
      options.notice(trouble);
    }
  }

  void record_config(const std::string& text, const ReloadPlan& plan) {
    Event event;
    event.session = session.id;
    event.kind = EventKind::config_changed;
    event.t_us = event.t_from_us = wall_now_us();
    event.subject = plan.text();
    event.detail = text;
    ingest.add(event);
    writer.commit();
  }

  /// How a robot was asked and is asked now; empty: not at all. A stream that goes on after a pause says so, because
  /// analyses must not integrate over it.
  void record_rates(RobotId id, const Settings* before, const Settings* now) {
    const auto counts = fleet->streams();
    const LogThread::Numbers numbers = log->numbers();
    for (std::size_t s = 0; s < kSourceCount; ++s) {
      const Micros was = before == nullptr ? 0 : before->period_us[s];
      const Micros is = now == nullptr ? 0 : now->period_us[s];
      const auto source = static_cast<Source>(s);
      const auto known =
          std::find_if(counts.begin(), counts.end(), [&](const auto& c) { return c.id == id && c.source == source; });
      const std::uint64_t seq = known == counts.end() ? 0 : known->planned;
      const auto heard = numbers.streams.find({id, source});
      if (was != is) {
        log->event(rate_event(id, source, seq, {was, is}));
      }
      if (is > 0 && seq > 0 && heard != numbers.streams.end() && heard->second.last_answer_us > 0) {
        log->gap(pause(id, source, seq, heard->second.last_answer_us));
      }
    }
  }

  [[nodiscard]] Event rate_event(RobotId id, Source source, std::uint64_t seq, std::pair<Micros, Micros> period) const {
    Event event;
    event.robot = id;
    event.session = session.id;
    event.source = source;
    event.kind = EventKind::rate;
    event.seq = seq;
    event.t_us = event.t_from_us = wall_now_us();
    event.old_value = period_text(period.first);
    event.new_value = period_text(period.second);
    event.detail = "the configuration was changed";
    return event;
  }

  [[nodiscard]] Gap pause(RobotId id, Source source, std::uint64_t seq, Micros from_us) const {
    Gap gap;
    gap.robot = id;
    gap.source = source;
    gap.session = session.id;
    gap.seq_from = seq;
    gap.t_from_us = from_us;
    gap.t_to_us = std::max(from_us, wall_now_us());
    gap.cause = Cause::recorder_off;
    gap.detail = "the configuration was changed";
    return gap;
  }

  [[nodiscard]] const RobotConfig* find(const std::string& name) const {
    const auto found = std::find_if(config.robots.begin(), config.robots.end(),
                                    [&](const RobotConfig& robot) { return robot.name == name; });
    return found == config.robots.end() ? nullptr : &*found;
  }

  void change(const ReloadPlan& plan, const Config& next) {
    for (const std::string& name : plan.removed) {
      fleet->retire(name);
      record_rates(ids.at(name), &find(name)->settings, nullptr);
    }
    for (const RobotConfig& robot : plan.changed) {
      fleet->retire(robot.name);
    }
    log->call([] {});  // what their pollers left in the queue is counted now
    for (std::size_t i = 0; i < next.robots.size(); ++i) {
      const RobotConfig& robot = next.robots[i];
      const RobotConfig* const before = find(robot.name);
      const bool changed = std::any_of(plan.changed.begin(), plan.changed.end(),
                                       [&](const RobotConfig& other) { return other.name == robot.name; });
      if (before != nullptr && !changed) {
        continue;
      }
      const RobotId id = ids.at(robot.name);
      record_rates(id, before == nullptr ? nullptr : &before->settings, &robot.settings);
      if (const auto order = robot.settings.modbus.word_order;
          order && before != nullptr && before->settings.modbus.word_order != order) {
        set_word_order(id, robot, *order);
      }
      fleet->start(robot, id, i, mono_now_us());
    }
  }

  /// Of the whole session: a robot has one order, so what was configured before was a mistake.
  void set_word_order(RobotId id, const RobotConfig& robot, WordOrder order) {
    for (const Source source : {Source::registers, Source::inputs}) {
      if (robot.settings.period(source) > 0) {
        log->word_order(id, source, order);
      }
    }
  }

  [[nodiscard]] std::vector<SourceSummary> summary() const {
    std::vector<SourceSummary> out;
    for (const Fleet::StreamCounts& stream : fleet->streams()) {
      const store::LogWriter::Tally tally = writer.tally(stream.id, stream.source);
      out.push_back({stream.robot, stream.source, stream.planned, tally.stored, tally.partial, tally.missed});
    }
    return out;
  }
};

Recorder::Recorder(const Config& config, Options options) : impl_(std::make_unique<Impl>(config, std::move(options))) {
  impl_->remember();
  impl_->make_log();
  impl_->begin();
  impl_->start();
}

Recorder::~Recorder() {
  impl_->fleet->stop();
  impl_->fleet->join();
  impl_->log.reset();  // its thread still looks at the pollers' counters
}

std::vector<std::string> Recorder::outlook() const { return impl_->outlook; }

std::string Recorder::reload(const Config& next, const std::string& text) {
  const ReloadPlan plan = plan_reload(impl_->config, next);
  if (plan.nothing()) {
    return "nothing differs";
  }
  impl_->log->call([&] {
    for (const auto* robots : {&plan.changed, &plan.added}) {
      std::for_each(robots->begin(), robots->end(), [&](const RobotConfig& robot) { impl_->enter(robot); });
    }
    impl_->record_config(text, plan);
  });
  impl_->change(plan, next);
  impl_->config = next;
  return plan.text();
}

void Recorder::stop() { impl_->fleet->stop(); }

bool Recorder::done() const { return impl_->fleet->running() == 0 || impl_->log->failed(); }

Snapshot Recorder::snapshot() const {
  LogThread::Numbers numbers = impl_->log->numbers();
  Snapshot out;
  out.now_us = wall_now_us();
  out.since_us = impl_->session.t_start_us;
  out.links = impl_->fleet->links();
  for (const Fleet::StreamCounts& stream : impl_->fleet->streams()) {
    const LogThread::StreamNumbers& written = numbers.streams[{stream.id, stream.source}];
    StreamNow now{stream.robot, stream.source, stream.period_us, stream.planned, 0, 0, stream.missed, {}, 0, 0};
    now.stored = written.tally.stored;
    now.partial = written.tally.partial;
    constexpr auto kDisk = static_cast<std::size_t>(Cause::disk);
    now.missed[kDisk] = written.tally.missed[kDisk];
    now.round_trip = written.round_trip;
    now.last_round_trip_us = written.last_round_trip_us;
    now.last_answer_us = written.last_answer_us;
    out.streams.push_back(std::move(now));
    if (const auto offset = numbers.clock_offset_us.find(stream.id); offset != numbers.clock_offset_us.end()) {
      out.clock_offset_us[stream.robot] = offset->second;
    }
  }
  out.queue_items = numbers.queue_items;
  out.queue_bytes = numbers.queue_bytes;
  out.writer = numbers.writer;
  out.commits = numbers.commits;
  out.forecast = numbers.forecast;
  return out;
}

std::vector<Beat> Recorder::beats() const {
  std::vector<Beat> out = impl_->fleet->beats();
  out.push_back({"the writer", impl_->log->busy_us(), kWriterMayTake});
  return out;
}

std::vector<SourceSummary> Recorder::finish() {
  if (impl_->fleet->running() != 0) {
    impl_->fleet->stop();
  }
  impl_->fleet->join();
  impl_->log->finish(true);
  return impl_->summary();
}

}  // namespace tacho::recorder
