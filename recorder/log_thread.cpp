#include "recorder/log_thread.hpp"

#include <fmt/format.h>

#include <future>
#include <memory>
#include <utility>

#include "schema/error.hpp"
#include "schema/text.hpp"
#include "schema/time.hpp"

namespace tacho::recorder {

namespace {

constexpr int kAnswersBeforeIoNotice = 5;
constexpr std::chrono::milliseconds kGather{20};  // answers that are written together
constexpr Micros kOffsetStands = 300'000'000;
constexpr std::chrono::minutes kForecastInterval{10};  // it reads the head of every part

/// An answer, gap or event of the ring.
template <class Row>
bool of_ring(const Row& row) {
  return row.source == Source::ring;
}

std::string_view connection_name(Source source) { return protocol_name(source_info(source).protocol); }

}  // namespace

LogThread::LogThread(store::LogWriter& writer, Ingest& ingest, Options options)
    : writer_(writer),
      ingest_(ingest),
      options_(std::move(options)),
      queue_(options_.queue_items, options_.queue_bytes),
      ring_(
          options_.ring, [this](const Ring::Row& row) { write_ring(row); },
          [this](const Event& event) {
            attempt([&] { ingest_.add(event); });
            tell(event);
          }) {
  ingest_.on_event([this](const Event& event) { look_at(event); });
}

void LogThread::watch(RobotId robot, const std::string& name, const RobotConfig& config) {
  const bool expects_io = config.settings.period(Source::io) == 0 && config.settings.status.request.keys.empty();
  watched_[robot] = Watched{name, expects_io, 0};
  const std::lock_guard lock(numbers_mutex_);
  for (std::size_t s = 0; s < kSourceCount; ++s) {
    if (config.settings.period_us[s] > 0) {
      numbers_.streams[{robot, static_cast<Source>(s)}];
    }
  }
}

void LogThread::start() {
  numbers_.forecast = options_.forecast;
  foretell_at_ = std::chrono::steady_clock::now() + kForecastInterval;
  thread_ = std::thread([this] { run(); });
}

LogThread::~LogThread() {
  queue_.close();
  if (thread_.joinable()) {
    thread_.join();
  }
}

bool LogThread::answer(Answer answer, const std::optional<Gap>& before) {
  const std::size_t bytes = sizeof(Stored) + answer.body.size();
  return queue_.try_push(Item(Stored{std::move(answer), before}), bytes);
}

void LogThread::gap(const Gap& gap) { queue_.push(Item(gap)); }
void LogThread::event(const Event& event) { queue_.push(Item(event)); }
void LogThread::word_order(RobotId robot, Source source, WordOrder order) {
  queue_.push(Item(OrderFound{robot, source, order}));
}

void LogThread::call(std::function<void()> task) {
  const auto job = std::make_shared<std::packaged_task<void()>>(std::move(task));
  std::future<void> done = job->get_future();
  queue_.push(Item(Task([job] { (*job)(); })));
  while (done.wait_for(std::chrono::milliseconds(100)) != std::future_status::ready) {
    if (ended_) {
      throw Error("the log", "is no longer written", "");
    }
  }
  done.get();
}

Micros LogThread::busy_us() const {
  const Micros since_us = busy_since_us_;
  return since_us == 0 ? 0 : mono_now_us() - since_us;
}

LogThread::Numbers LogThread::numbers() const {
  const std::lock_guard lock(numbers_mutex_);
  Numbers out = numbers_;
  std::erase_if(out.clock_offsets, [now_us = mono_now_us()](const auto& one) {
    return now_us - one.second.told_us > kOffsetStands;  // a clock runs on, and may have been set since
  });
  out.queue_items = queue_.size();
  out.queue_bytes = queue_.bytes();
  return out;
}

void LogThread::finish(bool clean) {
  clean_ = clean;
  queue_.close();
  if (thread_.joinable()) {
    thread_.join();
  }
  if (error_) {
    std::rethrow_exception(std::exchange(error_, nullptr));
  }
}

void LogThread::run() {
  try {
    std::vector<Item> items;
    auto next_commit = std::chrono::steady_clock::now() + options_.commit_interval;
    bool open = true;
    while (open) {
      busy_since_us_ = 0;
      open = queue_.pop_all(items, next_commit, kGather);
      for (Item& item : items) {
        busy_since_us_ = mono_now_us();
        write(item);
      }
      if (std::chrono::steady_clock::now() >= next_commit) {
        busy_since_us_ = mono_now_us();
        commit();
        next_commit = std::chrono::steady_clock::now() + options_.commit_interval;
      }
    }
    ring_.end();
    plan();
    writer_.end_session(wall_now_us(), clean_);
    publish();
  } catch (...) {
    error_ = std::current_exception();
    failed_ = true;
  }
  ended_ = true;
}

/// One step on the log. Each poll and each row is a step of its own: the writer has to be told of every poll, also
/// while it cannot write, to know what was lost.
template <class Work>
void LogThread::attempt(Work work) {
  try {
    work();
  } catch (const Error& error) {
    if (!std::exchange(disk_fails_, true)) {
      options_.notice(fmt::format(
          "{}; recording goes on, and what cannot be written meanwhile becomes gaps of cause disk", error.what()));
    }
  }
}

void LogThread::commit() {
  const std::uint64_t commits = writer_.stats().commits;
  attempt([this] {
    plan();
    writer_.commit();
  });
  if (disk_fails_ && writer_.stats().commits > commits) {
    disk_fails_ = false;
    options_.notice(fmt::format("the log is written again; {} polls lost so far", writer_.stats().lost));
  }
  publish();
  if (std::chrono::steady_clock::now() >= foretell_at_) {
    foretell();
  }
}

void LogThread::publish() {
  const std::lock_guard lock(numbers_mutex_);
  const store::LogWriter::Stats& now = writer_.stats();
  if (now.commits > numbers_.writer.commits) {
    numbers_.commits.add(now.last_commit.count());
  }
  numbers_.writer = now;
  for (auto& [key, stream] : numbers_.streams) {
    stream.tally = writer_.tally(key.first, key.second);
    stream.aged_out = key.second == Source::ring ? ring_.counts(key.first).aged_out : 0;
  }
  numbers_.ring_bytes = ring_.bytes();
}

void LogThread::foretell() {
  foretell_at_ = std::chrono::steady_clock::now() + kForecastInterval;
  try {
    const store::Forecast forecast = writer_.forecast();
    const std::lock_guard lock(numbers_mutex_);
    numbers_.forecast = forecast;
  } catch (const Error&) {
    // The folder cannot be read now: what was foretold last stands.
  }
}

/// Counts what the answers themselves do not say: how long they took.
void LogThread::measure(const AnswerMeta& meta) {
  const std::lock_guard lock(numbers_mutex_);
  StreamNumbers& stream = numbers_.streams[{meta.robot, meta.source}];
  stream.last_answer_us = meta.t_recv_us;
  if (source_info(meta.source).protocol != Protocol::push_port) {  // nobody asked, so nobody waited
    stream.last_round_trip_us = meta.t_recv_us - meta.t_send_us;
    stream.round_trip.add(stream.last_round_trip_us);
  }
}

/// How far the robot's clock is off, from the answer that was written last.
void LogThread::learn_clock(RobotId robot) {
  RobotClock& clock = clocks_[robot];
  if (clock.see(ingest_.last())) {
    const std::lock_guard lock(numbers_mutex_);
    numbers_.clock_offsets[robot] = {*clock.offset_us(), mono_now_us()};
  }
}

/// What has been planned; of the ring, what has been written of it.
void LogThread::plan() {
  options_.planned(writer_);
  for (const auto& [key, stream] : numbers_.streams) {
    if (key.second == Source::ring) {
      writer_.planned(key.first, Source::ring, ring_.counts(key.first).written);
    }
  }
}

void LogThread::write_ring(const Ring::Row& row) {
  if (row.gap) {
    attempt([&] { ingest_.add(*row.gap); });
  }
  if (row.answer) {
    attempt([&] { ingest_.append(*row.answer); });
  }
}

void LogThread::look_at(const Event& event) {
  if (std::string why = ring_trigger(event); !why.empty()) {
    triggered_.emplace_back(event, std::move(why));
  }
}

/// True when it belongs to the ring and is taken care of.
bool LogThread::keep(Item& item) {
  if (auto* stored = std::get_if<Stored>(&item); stored != nullptr && of_ring(stored->answer.meta)) {
    const AnswerMeta meta = stored->answer.meta;
    measure(meta);
    ring_.add(meta.robot, {std::move(stored->before), std::move(stored->answer)}, mono_now_us());
    return true;
  }
  if (const auto* gap = std::get_if<Gap>(&item); gap != nullptr && of_ring(*gap)) {
    Gap missed = *gap;
    if (missed.seq_count > 0) {
      ring_.add(missed.robot, {missed, std::nullopt}, mono_now_us());
    } else {
      missed.seq_from = ring_.counts(missed.robot).written;
      attempt([&] { ingest_.add(missed); });
    }
    return true;
  }
  return false;
}

void LogThread::write(Item& item) {
  if (!keep(item)) {
    write_row(item);
  }
  for (const auto& [event, why] : std::exchange(triggered_, {})) {
    ring_.trigger(event, why, mono_now_us());
  }
}

void LogThread::write_row(const Item& item) {
  if (const auto* stored = std::get_if<Stored>(&item)) {
    if (stored->before) {
      attempt([&] { ingest_.add(*stored->before); });
    }
    attempt([&] { ingest_.append(stored->answer); });
    measure(stored->answer.meta);
    learn_clock(stored->answer.meta.robot);
    look_for_io(stored->answer);
  } else if (const auto* gap = std::get_if<Gap>(&item)) {
    attempt([&] { ingest_.add(*gap); });
  } else if (const auto* event = std::get_if<Event>(&item)) {
    Event told = *event;
    told.seq = of_ring(told) ? ring_.counts(told.robot).written : told.seq;
    attempt([&] { ingest_.add(told); });
    tell(told);
    look_at(told);
  } else if (const auto* found = std::get_if<OrderFound>(&item)) {
    attempt([&] { ingest_.set_word_order(found->robot, found->source, found->order); });
  } else if (const auto* task = std::get_if<Task>(&item)) {
    (*task)();
  }
}

/// Says once that a robot's 1100 has no DI and DO, so that somebody can switch io on.
void LogThread::look_for_io(const Answer& answer) {
  Watched& robot = watched_[answer.meta.robot];
  if (answer.meta.source != Source::status || !robot.expects_io) {
    return;
  }
  const Sample& sample = ingest_.last();
  const bool has_io = sample.at(field("di")).state != State::absent || sample.at(field("do")).state != State::absent;
  robot.answers_without_io = has_io ? 0 : robot.answers_without_io + 1;
  if (robot.answers_without_io == kAnswersBeforeIoNotice) {
    robot.expects_io = false;
    options_.notice(
        fmt::format("{}: answers to 1100 carry no DI and DO; add --period io=2Hz to record them", robot.name));
  }
}

void LogThread::tell(Event event) {
  for (std::string* const words : {&event.subject, &event.old_value, &event.new_value, &event.detail}) {
    *words = printable(std::move(*words));
  }
  const std::string& robot = watched_[event.robot].name;
  switch (event.kind) {
    case EventKind::link_up:
      options_.notice(fmt::format("{}: {}: connected", robot, connection_name(event.source)));
      break;
    case EventKind::link_down:
      options_.notice(fmt::format("{}: {}: lost: {}", robot, connection_name(event.source), event.detail));
      break;
    case EventKind::error_frame:
    case EventKind::client_limit:
    case EventKind::no_sequence_echo:
      options_.notice(fmt::format("{}: {}: {}", robot, source_name(event.source), event.detail));
      break;
    case EventKind::ring_kept:
      options_.notice(fmt::format("{}: {}: {}", robot, event.subject, event.detail));
      break;
    case EventKind::identity_changed:
      options_.notice(
          fmt::format("{}: {}: it was {}, the other is {}", robot, event.detail, event.old_value, event.new_value));
      break;
    case EventKind::rate:
      if (parse_rate(event.new_value) == 0) {
        options_.notice(fmt::format("{}: {}: {}", robot, source_name(event.source), event.detail));
      }
      break;
    case EventKind::word_order:
      options_.notice(fmt::format("{}: {} {}: {}", robot, event.subject.empty() ? "word order" : event.subject,
                                  event.new_value, event.detail));
      break;
    default:
      break;
  }
}

}  // namespace tacho::recorder
