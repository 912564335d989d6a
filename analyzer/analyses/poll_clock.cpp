#include "analyzer/analyses/poll_clock.hpp"

#include <algorithm>
#include <cmath>

namespace tacho {

PollClock::PollClock(Micros planned_us, double gap_periods)
    : planned_us_(planned_us), period_us_(planned_us), gap_periods_(gap_periods) {}

Micros PollClock::gap_limit_us() const {
  return static_cast<Micros>(std::llround(gap_periods_ * static_cast<double>(period_us_)));
}

PollClock::Step PollClock::step(SessionId session, Micros t_mid_us) {
  if (!any_) {
    any_ = true;
    session_ = session;
    last_us_ = t_mid_us;
    return Step::first;
  }
  const Micros pause = t_mid_us - last_us_;
  const bool near = pause >= 0 && pause <= gap_limit_us();
  if (session != session_) {  // another session may poll at another rate
    session_ = session;
    count_ = 0;
    period_us_ = planned_us_;
  } else if (pause >= 0) {
    note(pause);
  }
  last_us_ = t_mid_us;
  return near ? Step::near : Step::gap;
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
