#include "recorder/recorder.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <ctime>
#include <mutex>
#include <set>
#include <utility>

#include "recorder/identity.hpp"
#include "recorder/log_thread.hpp"
#include "recorder/own_rows.hpp"
#include "recorder/reload.hpp"
#include "recorder/roster.hpp"
#include "recorder/steward.hpp"
#include "schema/log.hpp"
#include "schema/time.hpp"

namespace tacho::recorder {

namespace {

constexpr const char* kMemoryFile = "learned.json";  // in the folder of the log
constexpr const char* kReloaded = "the configuration was changed";
constexpr Micros kForever = 4'000'000'000'000'000;  // 126 years

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

}  // namespace

struct Recorder::Impl {
  Config config;
  Options options;
  store::LogWriter writer;  // of the log's thread, once that runs; so are the next two
  Ingest ingest;
  std::set<std::pair<RobotId, Source>> declared;
  Session session;
  std::vector<std::string> outlook;
  std::shared_ptr<LinkMemory> memory;
  std::mutex control;  // of whoever starts and retires robots; the next one is his
  Roster roster;
  std::unique_ptr<LogThread> log;
  std::unique_ptr<Fleet> fleet;
  std::atomic<bool> stopping{false};
  std::unique_ptr<Steward> steward;

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
    out.planned = [this](store::LogWriter& w) {
      hand_over_planned(w);
      save_memory();
    };
    out.notice = options.notice;
    out.forecast = writer.forecast();
    out.ring = config.ring;
    outlook = {store::rules_text(config.retention), store::forecast_text(out.forecast, config.retention)};
    log = std::make_unique<LogThread>(writer, ingest, std::move(out));
  }

  /// Makes the row of a robot and its streams known to the log. `identity`: what is known of the row.
  Roster::Row enter(const RobotConfig& robot, const std::string& row, const Identity& identity) {
    const RobotId id = writer.robot(row, robot.address());
    for (std::size_t s = 0; s < kSourceCount; ++s) {
      const auto source = static_cast<Source>(s);
      if (robot.settings.period(source) > 0 && declared.emplace(id, source).second) {
        ingest.declare(stream_of(robot, {session.id, id, source, 0}));
      }
    }
    log->watch(id, row, robot);
    return {id, row, identity};
  }
  /// The row that is recorded for it, or that of its name.
  void enter(const RobotConfig& robot) {
    const Roster::Row* const row = roster.find(robot.name);
    const Roster::Place place =
        row == nullptr ? roster.first_place(robot.name) : Roster::Place{row->name, row->identity, false};
    roster.assign(robot.name, enter(robot, place.name, place.identity));
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
    remember_identities();
  }

  /// Who the robots of the log said they were.
  void remember_identities() {
    try {
      const std::vector<std::filesystem::path> logs{config.log};
      for (const Robot& robot : open_log(logs)->robots()) {
        roster.know({robot.id, robot.name, identity_of(robot)});
      }
    } catch (const Error& error) {
      options.notice(fmt::format("{}; robots are taken for those they were found as", error.what()));
    }
  }

  void start() {
    Fleet::Options out;
    out.make = options.make ? options.make : make_links(memory);
    out.session = session.id;
    const Micros start_us = mono_now_us();
    out.end_us = start_us + options.run_for_us.value_or(kForever);
    out.stranger = [this](RobotId row, const Identity& other) {
      steward->add([this, row, other, configured = std::string()](bool last) mutable {
        return follow(row, other, last, configured);
      });
    };
    fleet = std::make_unique<Fleet>(std::move(out), *log);
    steward = std::make_unique<Steward>();
    log->start();
    const std::lock_guard lock(control);
    for (std::size_t i = 0; i < config.robots.size(); ++i) {
      fleet->start(config.robots[i], *roster.find(config.robots[i].name), i, start_us);
    }
  }

  /// Another robot answers where this row was asked: its polls end, and those of the other begin. False: the other one
  /// is recorded for another configured robot, which may just not have noticed yet. `configured`: for whom the row was
  /// recorded; found at the first try.
  bool follow(RobotId row, const Identity& other, bool last, std::string& configured) {
    try {
      const std::lock_guard lock(control);
      configured = configured.empty() ? roster.recorded_for(row) : configured;
      const RobotConfig* const robot = find(configured);
      if (stopping || robot == nullptr) {
        return true;
      }
      // Not at a later try: the row may be recorded for another configured robot by then.
      if (const RobotId now = roster.find(configured)->id; roster.recorded_for(now) == configured) {
        roster.learn(now, fleet->retire(now));
        roster.leave(configured);
      }
      for (const auto& [id, identity] : fleet->identities()) {
        roster.learn(id, identity);
      }
      const Roster::Place place = roster.place(configured, other);
      if (place.taken && !last) {
        return false;
      }
      replace(*robot, place.taken ? roster.new_place(configured, other) : place, other);
    } catch (const Error& error) {
      options.notice(error.what());  // the log has ended
    }
    return true;
  }

  void replace(const RobotConfig& robot, const Roster::Place& place, const Identity& other) {
    const Roster::Row before = *roster.find(robot.name);
    Roster::Row now;
    log->call([&] { now = enter(robot, place.name, place.identity); });
    now.identity.learn(other);
    Event event = identity_event(session.id, before.id, now.name);
    event.old_value = before.identity.text();
    event.new_value = now.identity.text();
    log->event(event);
    record_rates(before.id, &robot.settings, nullptr, "another robot answers at its address");
    record_rates(now.id, nullptr, &robot.settings, "it answers where another robot was asked");
    roster.assign(robot.name, now);
    fleet->start(robot, now, place_of(robot), mono_now_us());
    if (stopping) {
      fleet->stop();  // it came while the new pollers were being made
    }
  }

  [[nodiscard]] std::size_t place_of(const RobotConfig& robot) const {
    return static_cast<std::size_t>(&robot - config.robots.data());
  }

  void hand_over_planned(store::LogWriter& w) const {
    for (const Fleet::StreamCounts& stream : fleet->streams()) {
      if (stream.source != Source::ring) {  // of which the log has the polls that were written
        w.planned(stream.id, stream.source, stream.planned);
      }
    }
  }

  void save_memory() const {
    if (const std::string trouble = memory->save(); !trouble.empty()) {
      options.notice(trouble);
    }
  }

  /// How a robot was asked and is asked now; empty: not at all. A stream that goes on after a pause says so, because
  /// analyses must not integrate over it.
  void record_rates(RobotId id, const Settings* before, const Settings* now, const std::string& why) {
    const auto counts = fleet->streams();
    const LogThread::Numbers numbers = log->numbers();
    for (std::size_t s = 0; s < kSourceCount; ++s) {
      const auto source = static_cast<Source>(s);
      const auto known =
          std::find_if(counts.begin(), counts.end(), [&](const auto& c) { return c.id == id && c.source == source; });
      const StreamPoll poll{session.id, id, source, known == counts.end() ? 0 : known->planned};
      const bool asked = before != nullptr && before->period(source) > 0 && known != counts.end();
      const Micros was = asked ? known->last_period_us : 0;
      const Micros is = now == nullptr ? 0 : now->rates(source).fastest();
      const auto heard = numbers.streams.find({id, source});
      if (was != is) {
        log->event(rate_event(poll, was, is, why));
      }
      if (is > 0 && poll.seq > 0 && heard != numbers.streams.end() && heard->second.last_answer_us > 0) {
        log->gap(pause_gap(poll, heard->second.last_answer_us, why));
      }
    }
  }

  [[nodiscard]] const RobotConfig* find(const std::string& name) const {
    const auto found = std::find_if(config.robots.begin(), config.robots.end(),
                                    [&](const RobotConfig& robot) { return robot.name == name; });
    return found == config.robots.end() ? nullptr : &*found;
  }

  void change(const ReloadPlan& plan, const Config& next) {
    // All at once: one that waits for an answer takes up to its timeout to end.
    for (const std::string& name : plan.removed) {
      fleet->stop(roster.find(name)->id);
    }
    for (const RobotConfig& robot : plan.changed) {
      fleet->stop(roster.find(robot.name)->id);
    }
    for (const std::string& name : plan.removed) {
      const RobotId id = roster.find(name)->id;
      roster.learn(id, fleet->retire(id));
      record_rates(id, &find(name)->settings, nullptr, kReloaded);
      roster.release(name);
    }
    for (const RobotConfig& robot : plan.changed) {
      const RobotId id = roster.find(robot.name)->id;
      roster.learn(id, fleet->retire(id));
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
      const Roster::Row& row = *roster.find(robot.name);
      record_rates(row.id, before == nullptr ? nullptr : &before->settings, &robot.settings, kReloaded);
      if (const auto order = robot.settings.modbus.word_order;
          order && before != nullptr && before->settings.modbus.word_order != order) {
        set_word_order(row.id, robot, *order);
      }
      fleet->start(robot, row, i, mono_now_us());
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
      out.push_back({stream.robot, stream.source, stream.planned, tally.stored, tally.partial, tally.missed, 0});
      if (stream.source == Source::ring) {
        out.back().aged_out = log->numbers().streams[{stream.id, stream.source}].aged_out;
      }
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
  stop();
  impl_->steward->stop();
  impl_->fleet->join();
  impl_->log.reset();  // its thread still looks at the pollers' counters
}

std::vector<std::string> Recorder::outlook() const { return impl_->outlook; }

std::string Recorder::reload(const Config& next, const std::string& text) {
  const std::lock_guard lock(impl_->control);
  const ReloadPlan plan = plan_reload(impl_->config, next);
  if (plan.nothing()) {
    return "nothing differs";
  }
  impl_->log->call([&] {
    for (const auto* robots : {&plan.changed, &plan.added}) {
      std::for_each(robots->begin(), robots->end(), [&](const RobotConfig& robot) { impl_->enter(robot); });
    }
    impl_->ingest.add(config_event(impl_->session.id, plan.text(), text));
    impl_->writer.commit();
  });
  impl_->change(plan, next);
  impl_->config = next;
  return plan.text();
}

std::size_t Recorder::mark(const Mark& mark) {
  const std::lock_guard lock(impl_->control);
  Event event = mark_event(impl_->session.id, mark.text);
  std::size_t marked = 0;
  for (const RobotConfig& robot : impl_->config.robots) {
    const Roster::Row& row = *impl_->roster.find(robot.name);
    if (mark.robot.empty() || mark.robot == robot.name || mark.robot == row.name) {
      event.robot = row.id;
      impl_->log->event(event);
      ++marked;
    }
  }
  return marked;
}

void Recorder::stop() {
  impl_->stopping = true;
  impl_->fleet->stop();
}

bool Recorder::done() const {
  // In this order: a poller that meets another robot makes the steward busy before it ends.
  return (impl_->fleet->running() == 0 && !impl_->steward->busy() && impl_->fleet->running() == 0) ||
         impl_->log->failed();
}

Snapshot Recorder::snapshot() const {
  LogThread::Numbers numbers = impl_->log->numbers();
  Snapshot out;
  out.now_us = wall_now_us();
  out.since_us = impl_->session.t_start_us;
  out.links = impl_->fleet->links();
  for (const Fleet::StreamCounts& stream : impl_->fleet->streams()) {
    const LogThread::StreamNumbers& written = numbers.streams[{stream.id, stream.source}];
    StreamNow now{stream.robot, stream.source, stream.period_us, stream.planned, 0, 0, stream.missed, {}, 0, 0, 0};
    now.stored = written.tally.stored;
    now.partial = written.tally.partial;
    constexpr auto kDisk = static_cast<std::size_t>(Cause::disk);
    now.missed[kDisk] = written.tally.missed[kDisk];
    now.round_trip = written.round_trip;
    now.last_round_trip_us = written.last_round_trip_us;
    now.last_answer_us = written.last_answer_us;
    now.aged_out = written.aged_out;
    if (stream.source == Source::ring) {
      now.missed = written.tally.missed;  // in what was written; the rest aged out or may still be written
    }
    out.streams.push_back(std::move(now));
    if (const auto offset = numbers.clock_offsets.find(stream.id); offset != numbers.clock_offsets.end()) {
      out.clock_offset_us[stream.robot] = offset->second.offset_us;
    }
  }
  out.queue_items = numbers.queue_items;
  out.queue_bytes = numbers.queue_bytes;
  out.ring_bytes = numbers.ring_bytes;
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
  const auto over = [this] { return impl_->fleet->running() == 0 && !impl_->steward->busy(); };
  if (!over()) {
    stop();
  }
  impl_->steward->stop();
  if (!over()) {
    stop();  // a robot that was being replaced in that moment
  }
  impl_->fleet->join();
  impl_->log->finish(true);
  return impl_->summary();
}

}  // namespace tacho::recorder
