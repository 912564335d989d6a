#include "analyzer/analyses/alarm_tracker.hpp"
#include "schema/time.hpp"

#include <algorithm>

namespace tacho {

const char* onset_name(Onset onset) {
  constexpr std::array<const char*, 4> kNames{"seen", "inferred", "in_gap", "before_record"};
  return kNames[static_cast<std::size_t>(onset)];
}

const char* clear_name(Clear clear) {
  constexpr std::array<const char*, 5> kNames{"seen", "inferred", "in_gap", "censored", "open"};
  return kNames[static_cast<std::size_t>(clear)];
}

namespace {

/// A gap holds the onset, and no stamp says when in it.
bool onset_unseen(const AlarmInterval& a) { return a.onset == Onset::in_gap && !(a.stamped && a.first_times <= 1); }
bool clear_unseen(const AlarmInterval& a) { return a.clear == Clear::in_gap || a.clear == Clear::censored; }

}  // namespace

std::string alarm_text(const AlarmKey& key) {
  return std::string(alarm_level_name(key.level)) + " " + std::to_string(key.code);
}

Micros AlarmInterval::onset_mid_us() const { return onset_lo_us ? middle(*onset_lo_us, onset_hi_us) : onset_hi_us; }

double AlarmInterval::duration_lo_s() const { return std::max(0.0, to_seconds(clear_lo_us - onset_hi_us - unseen_us)); }

std::optional<double> AlarmInterval::duration_hi_s() const {
  if (!onset_lo_us || !clear_hi_us) {
    return std::nullopt;
  }
  return to_seconds(*clear_hi_us - *onset_lo_us);
}

ActiveTime active_time(const AlarmInterval& a, Micros record_from_us, Micros counted_until_us) {
  const auto length = [](Micros from_us, Micros to_us) { return std::max(0.0, to_seconds(to_us - from_us)); };
  const Micros onset_lo = std::max(a.onset_lo_us.value_or(a.onset_hi_us), std::min(record_from_us, a.onset_hi_us));
  const Micros onset_hi = std::max(a.onset_hi_us, std::min(record_from_us, a.clear_lo_us));
  const Micros clear_hi = a.clear_hi_us.value_or(a.clear_lo_us);
  const Micros onset = onset_unseen(a) ? onset_hi : middle(onset_lo, onset_hi);
  const Micros clear = clear_unseen(a) ? a.clear_lo_us : middle(a.clear_lo_us, clear_hi);
  ActiveTime active;
  active.lo_s = length(onset_hi, a.clear_lo_us - a.unseen_us);
  active.mid_s = length(onset, clear - a.unseen_us);
  active.hi_s = std::max(active.mid_s, length(std::max(onset_lo, counted_until_us), clear_hi));
  return active;
}

struct AlarmTracker::View {
  AlarmLevel level;
  const AlarmPoll& poll;
  const AlarmPoll::Level& now;
  LevelState& before;
  bool gap;
};

const std::vector<std::size_t>& AlarmTracker::poll(const AlarmPoll& poll, Micros limit_us) {
  raised_.clear();
  const Micros t_mid = middle(poll.t_send_us, poll.t_recv_us);
  for (std::size_t l = 0; l < kAlarmLevels; ++l) {
    const AlarmPoll::Level& now = poll.levels[l];
    LevelState& before = levels_[l];
    if (!now.known) {
      continue;
    }
    const Micros pause = t_mid - before.t_mid_us;
    level({static_cast<AlarmLevel>(l), poll, now, before, before.any && (pause < 0 || pause > limit_us)});
    before.any = true;
    before.full = now.full;
    before.t_mid_us = t_mid;
    before.t_send_us = poll.t_send_us;
    if (!now.full) {
      before.not_full_us = poll.t_send_us;
    }
  }
  active_.clear();
  for (const LevelState& state : levels_) {
    for (const auto& [code, open] : state.open) {
      if (!open.hidden) {
        active_.push_back(open.interval);
      }
    }
  }
  std::sort(active_.begin(), active_.end());
  return raised_;
}

void AlarmTracker::level(const View& view) {
  for (auto& [code, open] : view.before.open) {
    open.seen = false;
  }
  for (const AlarmPoll::Item& item : view.now.items) {
    const auto at = view.before.open.find(item.code);
    if (at == view.before.open.end()) {
      const Onset onset = !view.before.any ? Onset::before_record : view.gap ? Onset::in_gap : Onset::seen;
      raise(view, item, onset).seen = true;
    } else if (!at->second.seen) {
      at->second.seen = true;
      still_there(view, item, at->second);
    }
  }
  close_missing(view);
}

AlarmTracker::Open& AlarmTracker::raise(const View& view, const AlarmPoll::Item& item, Onset onset) {
  AlarmInterval interval;
  interval.key = {view.level, item.code};
  interval.onset = onset;
  interval.onset_hi_us = view.poll.t_recv_us;
  interval.clear_lo_us = view.poll.t_send_us;
  interval.stamp_s = item.stamp_s;
  interval.first_times = item.times;
  if (view.before.any) {
    interval.onset_lo_us = view.before.t_send_us;
    if (view.before.full) {
      // It may have stood behind the others: only the last set with room proves that it did not.
      interval.censored_set = true;
      interval.onset_lo_us = view.before.not_full_us;
      interval.onset = view.before.not_full_us ? onset : Onset::before_record;
    }
  }
  raised_.push_back(intervals_.size());
  Open& open = view.before.open[item.code];
  open = {intervals_.size(), item.stamp_s, item.times, false, true};
  intervals_.push_back(std::move(interval));
  return open;
}

void AlarmTracker::still_there(const View& view, const AlarmPoll::Item& item, Open& open) {
  const bool moved = item.stamp_s != 0 && open.stamp_s != 0 && item.stamp_s != open.stamp_s;
  const bool grew = item.times > open.times && open.times > 0;
  if (moved && view.gap) {
    restart(view, item, open, true);
    return;
  }
  if (moved && !grew && item.times <= 1) {
    restart(view, item, open, false);
    return;
  }
  AlarmInterval& interval = intervals_[open.interval];
  if (const bool proven = item.stamp_s != 0 && open.stamp_s != 0; view.gap && proven) {
    interval.over_gap = true;
  } else if (view.gap) {
    interval.assumed_one = true;
    interval.unseen_us += view.poll.t_recv_us - view.before.t_send_us;
  }
  if (grew) {
    interval.repeats += item.times - open.times;
    ++(moved ? stamps_.last_moves : stamps_.first_stays);
  } else if (moved) {
    ++stamps_.ambiguous;
  } else if (item.times > 0 && item.times < open.times) {
    ++stamps_.times_fell;
  }
  interval.censored_set = interval.censored_set || open.hidden;
  open.hidden = false;
  open.stamp_s = item.stamp_s != 0 ? item.stamp_s : open.stamp_s;
  open.times = item.times != 0 ? item.times : open.times;
  interval.clear_lo_us = view.poll.t_send_us;
}

void AlarmTracker::restart(const View& view, const AlarmPoll::Item& item, Open& open, bool gap) {
  AlarmInterval& old = intervals_[open.interval];
  old.clear = gap ? Clear::censored : Clear::inferred;
  old.clear_hi_us = view.poll.t_recv_us;
  raise(view, item, gap ? Onset::in_gap : Onset::inferred);
}

void AlarmTracker::close_missing(const View& view) {
  for (auto at = view.before.open.begin(); at != view.before.open.end();) {
    Open& open = at->second;
    AlarmInterval& interval = intervals_[open.interval];
    if (open.seen) {
      ++at;
    } else if (view.now.full) {
      open.hidden = true;
      interval.censored_set = true;
      ++at;
    } else {
      interval.clear = view.gap ? Clear::in_gap : Clear::seen;
      interval.clear_hi_us = view.poll.t_recv_us;
      at = view.before.open.erase(at);
    }
  }
}

void AlarmTracker::tighten(std::size_t index, const ClockOffset& offset) {
  AlarmInterval& interval = intervals_[index];
  if (interval.stamp_s <= 0 || interval.stamp_s > 100'000'000'000) {
    return;
  }
  // A stamp is cut to whole seconds. After repetitions it may tell the last of them: then it bounds from above only.
  const Micros stamp = interval.stamp_s * 1'000'000;
  const bool first = interval.first_times <= 1;
  const Micros hi = stamp + 1'000'000 + offset.hi_us;
  const Micros new_hi = std::min(interval.onset_hi_us, hi);
  std::optional<Micros> new_lo = interval.onset_lo_us;
  if (first) {
    const Micros lo = stamp + offset.lo_us;
    new_lo = new_lo ? std::max(*new_lo, lo) : lo;
  }
  if (new_lo && *new_lo > new_hi) {
    ++stamps_.conflicts;
    return;
  }
  ++stamps_.narrowed;
  interval.onset_lo_us = new_lo;
  interval.onset_hi_us = new_hi;
  interval.stamped = true;
}

}  // namespace tacho
