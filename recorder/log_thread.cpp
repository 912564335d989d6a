#include "recorder/log_thread.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "schema/error.hpp"
#include "schema/time.hpp"

namespace tacho::recorder {

namespace {

constexpr int kAnswersBeforeIoNotice = 5;

std::string_view connection_name(Source source) {
  return source == Source::status || source == Source::io ? "status port" : "modbus";
}

}  // namespace

LogThread::LogThread(store::LogWriter& writer, Ingest& ingest, Options options)
    : writer_(writer),
      ingest_(ingest),
      options_(std::move(options)),
      queue_(options_.queue_items, options_.queue_bytes),
      answers_without_io_(options_.robot_ids.size(), 0) {}

void LogThread::start() {
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

store::LogWriter::Stats LogThread::stats() const {
  const std::lock_guard lock(stats_mutex_);
  return stats_;
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
      open = queue_.pop_all(items, next_commit);
      for (const Item& item : items) {
        write(item);
      }
      if (std::chrono::steady_clock::now() >= next_commit) {
        commit();
        next_commit = std::chrono::steady_clock::now() + options_.commit_interval;
      }
    }
    options_.planned(writer_);
    writer_.end_session(wall_now_us(), clean_);
    const std::lock_guard lock(stats_mutex_);
    stats_ = writer_.stats();
  } catch (...) {
    error_ = std::current_exception();
    failed_ = true;
  }
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
    options_.planned(writer_);
    writer_.commit();
  });
  if (disk_fails_ && writer_.stats().commits > commits) {
    disk_fails_ = false;
    options_.notice(fmt::format("the log is written again; {} polls lost so far", writer_.stats().lost));
  }
  const std::lock_guard lock(stats_mutex_);
  stats_ = writer_.stats();
}

void LogThread::write(const Item& item) {
  if (const auto* stored = std::get_if<Stored>(&item)) {
    if (stored->before) {
      attempt([&] { ingest_.add(*stored->before); });
    }
    attempt([&] { ingest_.append(stored->answer); });
    look_for_io(stored->answer);
  } else if (const auto* gap = std::get_if<Gap>(&item)) {
    attempt([&] { ingest_.add(*gap); });
  } else if (const auto* event = std::get_if<Event>(&item)) {
    attempt([&] { ingest_.add(*event); });
    tell(*event);
  } else if (const auto* found = std::get_if<OrderFound>(&item)) {
    attempt([&] { ingest_.set_word_order(found->robot, found->source, found->order); });
  }
}

std::size_t LogThread::index_of(RobotId robot) const {
  const auto& ids = options_.robot_ids;
  return static_cast<std::size_t>(std::find(ids.begin(), ids.end(), robot) - ids.begin());
}

/// Says once that a robot's 1100 has no DI and DO, so that somebody can switch io on.
void LogThread::look_for_io(const Answer& answer) {
  const std::size_t robot = index_of(answer.meta.robot);
  if (answer.meta.source != Source::status || !options_.expects_io[robot]) {
    return;
  }
  const Sample& sample = ingest_.last();
  const bool has_io = sample.at(field("di")).state != State::absent || sample.at(field("do")).state != State::absent;
  int& without = answers_without_io_[robot];
  without = has_io ? 0 : without + 1;
  if (without == kAnswersBeforeIoNotice) {
    options_.expects_io[robot] = false;
    options_.notice(fmt::format("{}: answers to 1100 carry no DI and DO; add --period io=2Hz to record them",
                                options_.robot_names[robot]));
  }
}

void LogThread::tell(const Event& event) const {
  const std::string& robot = options_.robot_names[index_of(event.robot)];
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
    case EventKind::word_order:
      options_.notice(fmt::format("{}: word order {}: {}", robot, event.new_value, event.detail));
      break;
    default:
      break;
  }
}

}  // namespace tacho::recorder
