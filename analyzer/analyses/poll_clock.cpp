#include "analyzer/analyses/poll_clock.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace tacho {

void PlannedPeriod::open(const Slice& slice) {
  for (const Event& event : slice.events) {
    if (event.kind == EventKind::rate && event.source == source_) {
      if (const Micros period = parse_rate(event.new_value).value_or(0); period > 0) {
        const bool standing = event.subject.rfind("idle", 0) == 0 || event.subject == "charging";
        ahead_.push_back({slice.session, event.seq, event.t_us, period, standing});
      }
    }
  }
}

bool PlannedPeriod::advance(SessionId session, std::uint64_t seq, Micros t_us) {
  if (session != session_) {  // another session may poll at another rate
    session_ = session;
    now_us_ = first_us_;
    standing_ = false;
  }
  const Micros before = now_us_;
  for (; !ahead_.empty() && ahead_.front().session <= session; ahead_.pop_front()) {
    const Change& change = ahead_.front();
    if (change.session == session && (change.seq > seq || change.t_us > t_us)) {
      break;
    }
    if (change.session == session) {
      now_us_ = change.period_us;
      standing_ = change.standing;
    }
  }
  return now_us_ != before;
}

PollClock::PollClock(PlannedPeriod planned, double gap_periods)
    : planned_(std::move(planned)), period_us_(planned_.us()), gap_periods_(gap_periods) {}

Micros PollClock::limit(Micros period_us) const {
  return static_cast<Micros>(std::llround(gap_periods_ * static_cast<double>(period_us)));
}

PollClock::Step PollClock::step(SessionId session, std::uint64_t seq, Micros t_mid_us) {
  const bool changed = planned_.advance(session, seq);
  const bool other_session = any_ && session != session_;
  const bool next_poll = any_ && !other_session && seq == last_seq_ + 1;
  const Micros pause = any_ ? t_mid_us - last_us_ : 0;
  // The pause in which the rate changes belongs to both rates. Where the rows begin in the middle of a session its rate
  // may have been changed before: the first pause without a missed poll is one period, whatever was planned at first.
  const bool unknown_rate = count_ == 0 && next_poll && period_us_ == planned_.us();
  unusual_us_ = changed ? std::max(period_us_, planned_.us()) : unknown_rate ? std::max<Micros>(pause, 0) : 0;
  const bool near = pause >= 0 && pause <= limit(std::max(period_us_, unusual_us_));
  if (other_session || changed) {
    count_ = 0;
    period_us_ = planned_.us();
  } else if (any_ && pause >= 0) {
    period_us_ = unknown_rate && pause > limit(period_us_) ? pause : period_us_;  // until there are more of them
    note(pause);
  }
  const bool first = !any_;
  any_ = true;
  session_ = session;
  last_seq_ = seq;
  last_us_ = t_mid_us;
  return first ? Step::first : near ? Step::near : Step::gap;
}

void PollClock::note(Micros pause_us) {
  pauses_[count_ % kPauses] = pause_us;
  ++count_;
  if (count_ != 3 && count_ % 8 != 0) {
    return;
  }
  std::array<Micros, kPauses> sorted = pauses_;
  const auto end = sorted.begin() + static_cast<std::ptrdiff_t>(std::min(count_, kPauses));
  const auto middle = sorted.begin() + (end - sorted.begin()) / 2;
  std::nth_element(sorted.begin(), middle, end);
  period_us_ = *middle;
}

Micros planned_period_us(const Coverage* coverage) {
  if (coverage == nullptr) {
    return 0;
  }
  if (coverage->period_us > 0) {
    return coverage->period_us;
  }
  return coverage->stored > 1 ? (coverage->last_us - coverage->first_us) / static_cast<Micros>(coverage->stored - 1)
                              : 0;
}

}  // namespace tacho
