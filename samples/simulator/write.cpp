#include "samples/simulator/write.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <optional>
#include <queue>

#include "samples/simulator/answers.hpp"
#include "samples/simulator/rng.hpp"
#include "schema/error.hpp"
#include "schema/log.hpp"
#include "schema/wire/registers.hpp"
#include "schema/wire/requests.hpp"

namespace tacho::sim {
namespace {

constexpr Micros kDay = 86'400'000'000;
constexpr std::uint64_t kAnswersPerCommit = 1'000;
constexpr std::uint64_t kJitter = 201;  // noise channel

// One source of one robot: its schedule and the gap that is open in it.
struct Schedule {
  std::size_t robot = 0;
  Source source = Source::status;
  Micros period_us = 0;
  Micros phase_us = 0;      // sources of a robot are not asked at the same instant
  std::uint64_t seq = 0;    // next poll
  Micros last_good_us = 0;  // 0 = none yet
  std::optional<Gap> open;
};

// The next poll of a schedule; ordered by the instant the robot answers.
struct Poll {
  std::size_t schedule = 0;
  Micros due_us = 0;
  Micros send_us = 0;
  Micros recv_us = 0;
  [[nodiscard]] Micros mid_us() const { return send_us + (recv_us - send_us) / 2; }
  bool operator>(const Poll& other) const {
    return mid_us() != other.mid_us() ? mid_us() > other.mid_us() : schedule > other.schedule;
  }
};

struct Simulated {
  Simulated(const Scenario& scenario, Micros t0) : robot(scenario, t0), answers(scenario) {}
  Robot robot;
  AnswerMaker answers;
  RobotId id = 0;
};

class LogMaker {
 public:
  LogMaker(const std::vector<Scenario>& scenarios, const WriteOptions& options, const std::filesystem::path& folder)
      : options_(options), end_us_(options.t0_us + options.duration_us), writer_(folder, writer_options()) {
    store_session();
    // The simulated host's monotonic clock starts at 0 with the log.
    ingest_ = std::make_unique<Ingest>(writer_, [t0 = options.t0_us] { return t0; });
    for (const Scenario& scenario : scenarios) {
      add_robot(scenario);
    }
  }

  std::vector<Truth> run();

 private:
  WriteOptions options_;
  Micros end_us_;
  store::LogWriter writer_;
  std::unique_ptr<Ingest> ingest_;
  SessionId session_ = 0;
  std::vector<std::unique_ptr<Simulated>> robots_;
  std::vector<Schedule> schedules_;
  std::priority_queue<Poll, std::vector<Poll>, std::greater<>> polls_;
  std::uint64_t uncommitted_ = 0;
  Micros day_end_us_ = 0;

  static store::WriterOptions writer_options() {
    store::WriterOptions options;
    options.durable = false;
    options.decode = answer_decode();
    return options;
  }
  void store_session();
  void add_robot(const Scenario& scenario);
  void add_source(Source source, Micros period_us);
  void plan(std::size_t schedule);
  void take(const Poll& poll);
  const Gap* gap_at(const Schedule& schedule, Micros due_us) const;
  void miss(Schedule& schedule, const Gap& planned, Micros due_us);
  void close_gap(Schedule& schedule, Micros first_good_us);
  void housekeeping(Micros now_us);
};

void LogMaker::store_session() {
  Session session;
  session.t_start_us = options_.t0_us;
  session.software = "tacho-sim " TACHO_VERSION;
  session.config = "simulated";
  session.host = "simulated";
  session_ = writer_.begin_session(session);
  day_end_us_ = (options_.t0_us / kDay + 1) * kDay;
}

void LogMaker::add_robot(const Scenario& scenario) {
  const std::size_t place = robots_.size();  // robots of one host differ in their ports, as those that `serve` makes
  robots_.push_back(std::make_unique<Simulated>(scenario, options_.t0_us));
  robots_.back()->id = writer_.robot(scenario.name, fmt::format("{}:{}:{}", scenario.ip, 19204 + place, 502 + place));
  add_source(Source::status, options_.status_period_us);
  add_source(Source::io, options_.io_period_us);
  add_source(Source::registers, options_.registers_period_us);
  add_source(Source::inputs, options_.inputs_period_us);
  add_source(Source::pose, options_.pose_period_us);
  add_source(Source::push, options_.push_period_us);
}

void LogMaker::add_source(Source source, Micros period_us) {
  if (period_us <= 0) {
    return;
  }
  const Simulated& simulated = *robots_.back();
  Stream stream;
  stream.session = session_;
  stream.robot = simulated.id;
  stream.source = source;
  stream.period_us = period_us;
  stream.word_order = simulated.robot.scenario().word_order;
  if (source == Source::status) {
    stream.request = wire::status_request_body({});
  } else if (source == Source::pose) {
    stream.request = wire::pose_request_body();
  } else if (source == Source::registers || source == Source::inputs) {
    stream.request = wire::to_text(wire::plan_ranges(source == Source::inputs));
  }
  ingest_->declare(stream);
  Schedule schedule;
  schedule.robot = robots_.size() - 1;
  schedule.source = source;
  schedule.period_us = period_us;
  constexpr Micros kApart = 4;  // fixed, so that another source changes nothing in logs without it
  schedule.phase_us = period_us * (static_cast<Micros>(source) % kApart) / kApart;
  schedules_.push_back(schedule);
  plan(schedules_.size() - 1);
}

void LogMaker::plan(std::size_t index) {
  const Schedule& schedule = schedules_[index];
  Poll poll;
  poll.schedule = index;
  poll.due_us = options_.t0_us + schedule.phase_us + static_cast<Micros>(schedule.seq) * schedule.period_us;
  if (poll.due_us >= end_us_) {
    return;
  }
  const Noise noise(robots_[schedule.robot]->robot.scenario().seed, poll.due_us);
  const std::uint64_t channel = kJitter + 2 * static_cast<std::uint64_t>(schedule.source);
  // Never so much that two polls of one schedule change places.
  const auto jitter = static_cast<double>(std::min(options_.jitter_us, schedule.period_us / 4));
  poll.send_us = poll.due_us + static_cast<Micros>(jitter * noise.uniform(channel));
  // Half of the answers are quick, a few are late: round trips are not symmetric around their mean.
  const double slow = noise.uniform(channel + 1);
  poll.recv_us = poll.send_us + options_.rtt_us + static_cast<Micros>(jitter * slow * slow * slow * slow);
  polls_.push(poll);
}

std::vector<Truth> LogMaker::run() {
  while (!polls_.empty()) {
    const Poll poll = polls_.top();
    polls_.pop();
    housekeeping(poll.recv_us);
    take(poll);
    ++schedules_[poll.schedule].seq;
    plan(poll.schedule);
  }
  std::vector<Truth> truths;
  for (Schedule& schedule : schedules_) {
    if (schedule.open) {
      close_gap(schedule, 0);
    }
    writer_.planned(robots_[schedule.robot]->id, schedule.source, schedule.seq);
  }
  writer_.end_session(end_us_, true);
  for (const auto& simulated : robots_) {
    simulated->robot.at(std::max(end_us_, simulated->robot.truth().t1_us));
    truths.push_back(simulated->robot.truth());
  }
  return truths;
}

void LogMaker::take(const Poll& poll) {
  Schedule& schedule = schedules_[poll.schedule];
  if (const Gap* gap = gap_at(schedule, poll.due_us)) {
    miss(schedule, *gap, poll.due_us);
    return;
  }
  if (schedule.open) {
    close_gap(schedule, poll.recv_us);
  }
  Simulated& simulated = *robots_[schedule.robot];
  Answer answer;
  answer.meta.robot = simulated.id;
  answer.meta.source = schedule.source;
  answer.meta.session = session_;
  answer.meta.seq = schedule.seq;
  answer.meta.t_send_us = poll.send_us;
  answer.meta.t_recv_us = poll.recv_us;
  answer.body = simulated.answers.body(schedule.source, simulated.robot.at(poll.mid_us()));
  ingest_->append(answer);
  schedule.last_good_us = poll.recv_us;
  ++uncommitted_;
}

const Gap* LogMaker::gap_at(const Schedule& schedule, Micros due_us) const {
  for (const Gap& gap : options_.gaps) {
    if (gap.robot == robots_[schedule.robot]->id && gap.source == schedule.source && due_us >= gap.t_from_us &&
        due_us < gap.t_to_us) {
      return &gap;
    }
  }
  return nullptr;
}

void LogMaker::miss(Schedule& schedule, const Gap& planned, Micros due_us) {
  if (schedule.open && schedule.open->cause != planned.cause) {
    close_gap(schedule, due_us);
  }
  if (!schedule.open) {
    Gap gap = planned;
    gap.session = session_;
    gap.seq_from = schedule.seq;
    gap.seq_count = 0;
    gap.partial = false;
    gap.t_from_us = schedule.last_good_us != 0 ? schedule.last_good_us : due_us;
    schedule.open = gap;
  }
  ++schedule.open->seq_count;
  schedule.open->t_to_us = due_us;
}

void LogMaker::close_gap(Schedule& schedule, Micros first_good_us) {
  if (first_good_us != 0) {
    schedule.open->t_to_us = first_good_us;
  }
  ingest_->add(*schedule.open);
  schedule.open.reset();
}

// Commits every few thousand answers and before a new day, so that a part holds one day.
void LogMaker::housekeeping(Micros now_us) {
  if (uncommitted_ >= kAnswersPerCommit || now_us >= day_end_us_) {
    writer_.commit();
    uncommitted_ = 0;
    day_end_us_ = (now_us / kDay + 1) * kDay;
    if (options_.progress) {
      options_.progress(static_cast<double>(now_us - options_.t0_us) / static_cast<double>(options_.duration_us));
    }
  }
}

}  // namespace

std::vector<Truth> write_log(const std::vector<Scenario>& scenarios, const WriteOptions& options,
                             const std::filesystem::path& folder) {
  std::vector<Truth> truths;
  {
    LogMaker maker(scenarios, options, folder);
    truths = maker.run();
  }
  std::vector<std::string> names;
  for (const Scenario& scenario : scenarios) {
    names.push_back(scenario.name);
  }
  write_truth(folder / "truth.json", names, truths);
  if (options.progress) {
    options.progress(1.0);
  }
  return truths;
}

}  // namespace tacho::sim
