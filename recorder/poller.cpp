#include "recorder/poller.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <limits>
#include <utility>

namespace tacho::recorder {

namespace {

constexpr Micros kClockStep = 100'000;  // adjusting moves a clock by 0.5 ms in a second at most

/// No question on the connection has another outcome.
bool of_the_peer(Cause cause) {
  return cause == Cause::connect_refused || cause == Cause::connect_timeout || cause == Cause::unreachable ||
         cause == Cause::client_limit;
}

}  // namespace

std::uint64_t SourceCounters::missed_total() const {
  std::uint64_t sum = 0;
  for (const auto& count : missed) {
    sum += count;
  }
  return sum;
}

Poller::Poller(PollerOptions options, std::unique_ptr<Link> link, Clock& clock, Sink& sink)
    : options_(std::move(options)), link_(std::move(link)), clock_(clock), sink_(sink) {
  for (const PolledSource& plan : options_.sources) {
    lanes_.push_back(std::make_unique<Lane>());
    lanes_.back()->plan = plan;
    lanes_.back()->counters.planned = plan.first_seq;
    lanes_.back()->counters.period_us = plan.rates.fastest();
    if (source_info(plan.source).protocol == Protocol::push_port) {
      lanes_.back()->pace.emplace(plan.rates.fastest());
    }
  }
}

Micros Poller::wall_of(Micros mono_us) const { return clock_.wall_us() - (clock_.mono_us() - mono_us); }

/// The lane whose poll is due first; null when all were given up.
Poller::Lane* Poller::next_lane() {
  Lane* first = nullptr;
  for (const auto& lane : lanes_) {
    const bool sooner = first == nullptr || lane->schedule->next_due_us() < first->schedule->next_due_us();
    first = !lane->given_up && sooner ? lane.get() : first;
  }
  return first;
}

void Poller::run(Micros start_us, Micros end_us) {
  for (const auto& lane : lanes_) {
    Gap stream;
    stream.robot = options_.robot;
    stream.session = options_.session;
    stream.source = lane->plan.source;
    const Micros first_us = lane->pace ? lane->plan.rates.fastest() : lane->plan.phase_us;
    lane->schedule.emplace(start_us + first_us, lane->plan.rates.fastest(), lane->plan.first_seq);
    lane->gaps.emplace(stream, options_.gap_flush_us, [this](const Gap& gap) { sink_.gap(gap); });
  }
  while (!lanes_.empty()) {
    adapt();
    Lane* const lane = next_lane();
    // Without a lane the connection is held all the same: some robots stop when their last client goes.
    const Micros due_us = lane == nullptr ? end_us
                          : lane->pace    ? std::max(outage_ ? outage_->until_us : start_us, clock_.mono_us())
                                          : lane->schedule->next_due_us();
    // While the link is down nothing is sent, so nothing needs to keep a distance.
    const Micros apart_us = std::max(due_us, not_before_us_);
    const Micros wake_us = lane != nullptr && held(*lane, apart_us) != nullptr ? due_us : apart_us;
    if ((lane != nullptr && due_us >= end_us) || !clock_.sleep_until(wake_us)) {
      break;
    }
    if (clock_.mono_us() < wake_us) {
      continue;  // woken, because rates may have changed
    }
    if (lane == nullptr) {
      break;
    }
    // Late at the end, polls that would be due after it are not part of the plan.
    serve(*lane, std::min(clock_.mono_us(), end_us - 1));
    flush_old_gaps();
    if (stranger_) {
      break;
    }
  }
  const Micros stopped_us = stranger_ ? clock_.mono_us() : clock_.stopped_at().value_or(end_us);
  finish(std::min(end_us, stopped_us));
  link_->close();
  if (stranger_ && options_.stranger) {
    options_.stranger(*stranger_);
  }
}

/// Polls that are due later than now follow what the robot is doing.
void Poller::adapt() {
  if (options_.watch == nullptr) {
    return;
  }
  const Micros now_us = clock_.mono_us();
  const Activities possible = options_.watch->possible(now_us);
  for (const auto& lane : lanes_) {
    const Micros period_us = lane->plan.rates.in(possible);
    if (!lane->given_up && !lane->pace && period_us != lane->schedule->period_us()) {
      const std::uint64_t first = lane->schedule->change_period(period_us, now_us);
      const std::string doing = activities_text(possible);
      emit_rate(*lane, first, period_us, doing,
                possible.all() ? "what the robot is doing is not known" : "the robot is " + doing);
    }
  }
}

/// Nothing of this lane is planned from now on.
void Poller::give_up(Lane& lane, const std::string& why) {
  lane.given_up = true;
  emit_rate(lane, lane.schedule->next(), 0, "given up", why);
}

void Poller::emit_rate(Lane& lane, std::uint64_t seq, Micros period_us, const std::string& subject,
                       const std::string& why) {
  const Micros before_us = lane.counters.period_us.exchange(period_us);
  emit(lane, seq, {EventKind::rate, subject, rate_text(before_us), rate_text(period_us), why});
}

/// What keeps the lane from being asked now. An outage that another lane has met is believed once this one has met it,
/// too: its answer may be what tells them apart.
const Poller::Outage* Poller::held(const Lane& lane, Micros now_us) const {
  const bool met = outage_ && (of_the_peer(outage_->cause) || lane.tried_us >= outage_->since_us);
  if (met && now_us < outage_->until_us) {
    return &*outage_;
  }
  return lane.silence && now_us < lane.silence->until_us ? &*lane.silence : nullptr;
}

void Poller::serve(Lane& lane, Micros now_us) {
  follow_clock();
  if (lane.pace) {
    listen(lane);
    return;
  }
  if (const Outage* const outage = held(lane, now_us)) {
    miss(lane, 1 + lane.schedule->overrun(now_us), outage->cause, outage->detail);
    return;
  }
  if (const std::uint64_t late = lane.schedule->overrun(now_us); late > 0) {
    // What went by while a dead link held the thread is the link's fault, else the robot was slow.
    const bool lost = lost_by_ && lane.schedule->next_due_us() <= lost_by_->until_us;
    if (const Outage* const outage = outage_ ? &*outage_ : lost ? &*lost_by_ : nullptr) {
      miss(lane, late, outage->cause, outage->detail);
    } else {
      miss(lane, late, Cause::overrun, "earlier polls on this connection took too long, or this host slept");
    }
  }
  poll(lane);
}

/// Polls the link, and tells what it noticed.
PollResult Poller::ask(Lane& lane, std::uint64_t seq) {
  asked_us_ = clock_.mono_us();
  not_before_us_ = asked_us_ + (lane.pace ? 0 : options_.spacing_us);  // listening asks for nothing
  PollResult result = link_->poll(lane.plan.source, options_.timeout);
  follow_clock();
  if (!result.ok && clock_.stopped_at()) {
    result.cause = Cause::shutdown;
    result.detail = "stopped while waiting for the answer";
  }
  if (result.cause != Cause::shutdown || result.ok) {
    judge_link(lane, result);
  }
  for (const LinkNote& note : result.notes) {
    emit(lane, seq, note);
  }
  return result;
}

void Poller::listen(Lane& lane) {
  const std::string lost_by = outage_ ? outage_->detail : "fewer pushes came than before";
  const Cause cause = outage_ ? outage_->cause : Cause::timeout;
  PollResult result = ask(lane, lane.schedule->next());
  const Micros now_us = clock_.mono_us();
  const std::uint64_t next = lane.schedule->next();
  const Micros overdue_us = now_us - lane.pace->period_us() / 2;
  const std::uint64_t late = std::max(lane.schedule->planned_before(overdue_us), next) - next;
  if (!result.ok) {
    miss(lane, late, result.cause, result.detail);
    if (outage_) {
      lane.pace->interrupt();
    }
    return;
  }
  miss(lane, late, cause, lost_by);
  store(lane, lane.schedule->next(), std::move(result));
  if (const std::optional<Micros> found = lane.pace->hear(now_us)) {
    emit_rate(lane, lane.schedule->next(), *found, "found", "this is how often the robot pushes");
  }
  lane.schedule->restart(now_us + lane.pace->period_us(), lane.pace->period_us());
}

void Poller::poll(Lane& lane) {
  const std::uint64_t seq = lane.schedule->next();
  PollResult result = ask(lane, seq);
  const std::string unwanted = std::exchange(result.give_up, {});
  if (result.ok) {
    store(lane, seq, std::move(result));
  } else {
    miss(lane, 1, result.cause, result.detail);
  }
  if (!unwanted.empty()) {
    give_up(lane, unwanted);
  }
}

void Poller::store(Lane& lane, std::uint64_t seq, PollResult result) {
  if (result.word_order) {
    options_.word_order = *result.word_order;
    sink_.word_order(options_.robot, lane.plan.source, *result.word_order);
  }
  Answer answer;
  answer.meta = {options_.robot, lane.plan.source, options_.session, seq, result.t_send_us, result.t_recv_us};
  answer.body = std::move(result.body);
  answer.header = std::move(result.header);
  if (options_.watch != nullptr) {
    stranger_ = options_.watch->look(answer, options_.word_order, clock_.mono_us());
  }
  if (stranger_) {
    miss(lane, 1, Cause::other_robot, fmt::format("answered by {}", stranger_->text()));
    return;
  }
  if (!sink_.answer(std::move(answer), lane.gaps->ended_by(result.t_send_us))) {
    miss(lane, 1, Cause::queue_full, "the writer's queue is full; is the disk too slow?");
    return;
  }
  lane.gaps->stored(seq, result.t_send_us, result.t_recv_us, result.cause, result.partial ? result.detail : "");
  lane.schedule->take();
  lane.counters.planned = lane.schedule->next();
  ++lane.counters.stored;
}

void Poller::miss(Lane& lane, std::uint64_t count, Cause cause, const std::string& detail) {
  if (count == 0) {
    return;
  }
  const std::uint64_t seq = lane.schedule->next();
  const Micros first_us = wall_of(lane.schedule->due_us(seq));
  const Micros last_us = wall_of(lane.schedule->due_us(seq + count - 1));
  lane.gaps->miss(seq, count, first_us, last_us, cause, detail);
  lane.schedule->take(count);
  lane.counters.planned = lane.schedule->next();
  lane.counters.missed[static_cast<std::size_t>(cause)] += count;
}

/// Whether it is the connection that is down, or one source that is not answered. Links close after either, so only
/// what other sources get tells them apart.
void Poller::judge_link(Lane& lane, const PollResult& result) {
  const bool connected = link_->connected();
  const std::optional<Micros> tried_us = std::exchange(lane.tried_us, asked_us_);
  if (result.ok || connected) {
    lane.answered_us = asked_us_;
  }
  // Since this one was asked the last time (longer ago, the robot may have gone since), and when they were asked last.
  const bool others_answered = std::any_of(lanes_.begin(), lanes_.end(), [&](const auto& other) {
    return other.get() != &lane && other->answered_us > tried_us && other->answered_us == other->tried_us;
  });
  const bool alone = !result.ok && !connected && others_answered && !of_the_peer(result.cause);
  if (!alone) {
    tell_link(result);
  }
  if (result.ok || connected) {
    outage_.reset();
  }
  // A whole answer after which the link closed a connection that was out of step: the next poll opens another one.
  if (connected || (result.ok && !result.partial)) {
    lane.silence.reset();
    return;
  }
  const Outage failure{result.cause, result.detail, clock_.mono_us(), 0, asked_us_};
  if (result.ok || alone) {
    const bool longer = lane.silence && !result.ok;  // part of an answer is worth asking for
    const Micros backoff =
        longer ? std::min(lane.silence->backoff_us * 2, options_.silence_max_us) : options_.backoff_min_us;
    if (alone && !lane.silence) {
      lost_by_ = failure;
    }
    lane.silence = Outage{result.cause, result.detail, asked_us_ + backoff, backoff, asked_us_};
    return;
  }
  // A robot that says it has too many clients is there, and asking soon does not help it; any other is to be heard
  // within a second of its return.
  const Micros most = result.cause == Cause::client_limit ? options_.backoff_max_us : options_.retry_max_us;
  const Micros backoff = std::min(outage_ ? outage_->backoff_us * 2 : options_.backoff_min_us, most);
  const Micros since_us = outage_ ? outage_->since_us : asked_us_;
  outage_ = Outage{result.cause, result.detail, asked_us_ + backoff, backoff, since_us};
  lost_by_ = failure;
}

/// Events of the connection are events of its first source, whichever noticed.
void Poller::tell_link(const PollResult& result) {
  const Lane& first = *lanes_.front();
  const std::uint64_t seq = first.schedule->next();
  const bool connected = link_->connected();
  if ((result.ok || connected) && (!up_.exchange(true) || !announced_)) {
    announced_ = true;
    emit(first, seq, {EventKind::link_up, {}, {}, {}, {}});
  }
  if (!connected && !result.ok && (up_.exchange(false) || !announced_)) {
    announced_ = true;
    emit(first, seq, {EventKind::link_down, {}, {}, std::string(cause_name(result.cause)), result.detail});
  }
}

/// Gap rows are in the time of the clock that stands when they end: one that was set ends what is open.
void Poller::follow_clock() {
  const Micros mono_us = clock_.mono_us();
  const Micros ahead_us = clock_.wall_us() - mono_us;
  if (clock_.mono_us() - mono_us > kClockStep / 2) {
    return;  // this thread was held up between the clocks: the next poll looks again
  }
  const Micros before_us = std::exchange(wall_ahead_us_, ahead_us).value_or(ahead_us);
  if (std::abs(ahead_us - before_us) >= kClockStep) {
    for (const auto& lane : lanes_) {
      lane->gaps->clock_set(ahead_us - before_us);
    }
  }
}

void Poller::emit(const Lane& lane, std::uint64_t seq, const LinkNote& note) {
  Event event;
  event.robot = options_.robot;
  event.session = options_.session;
  event.source = lane.plan.source;
  event.kind = note.kind;
  event.seq = seq;
  event.t_us = clock_.wall_us();
  event.t_from_us = event.t_us;
  event.subject = note.subject;
  event.old_value = note.old_value;
  event.new_value = note.new_value;
  event.detail = note.detail;
  sink_.event(event);
}

void Poller::flush_old_gaps() {
  const Micros wall_us = clock_.wall_us();
  for (const auto& lane : lanes_) {
    lane->gaps->flush_if_old(wall_us);
  }
}

void Poller::finish(Micros end_us) {
  for (const auto& lane : lanes_) {
    // A poll that was started just before a stop may be due after the instant the stop was stamped with.
    const std::uint64_t next = lane->schedule->next();
    const std::uint64_t planned = lane->given_up ? next : std::max(lane->schedule->planned_before(end_us), next);
    miss(*lane, planned - lane->schedule->next(), Cause::shutdown,
         "the recorder was stopping, or its settings were changed");
    lane->gaps->flush();
    lane->counters.planned = planned;
  }
}

}  // namespace tacho::recorder
