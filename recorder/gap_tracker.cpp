#include "recorder/gap_tracker.hpp"

#include <algorithm>
#include <utility>

namespace tacho::recorder {

GapTracker::GapTracker(Gap stream, Micros flush_interval_us, Emit emit)
    : stream_(std::move(stream)), flush_interval_us_(flush_interval_us), emit_(std::move(emit)) {}

void GapTracker::open(std::uint64_t seq, std::uint64_t count, Micros from_us, Micros to_us) {
  open_ = stream_;
  open_->seq_from = seq;
  open_->seq_count = count;
  open_->t_from_us = std::min(from_us, to_us);  // an answer that was late may end behind the next due time
  open_->t_to_us = to_us;
  opened_us_ = to_us;
}

void GapTracker::miss(std::uint64_t seq, std::uint64_t count, Micros due_us, Micros last_due_us, Cause cause,
                      const std::string& detail) {
  if (count == 0) {
    return;
  }
  missed_ += count;
  if (open_ && !open_->partial && open_->cause == cause) {
    open_->seq_count += count;
    open_->t_to_us = last_due_us;
    flush_if_old(last_due_us);
    return;
  }
  flush();
  open(seq, count, last_good_us_.value_or(due_us), last_due_us);
  opened_us_ = due_us;
  open_->cause = cause;
  open_->detail = detail;
  last_good_us_.reset();
}

std::optional<Gap> GapTracker::ended_by(Micros t_send_us) const {
  if (!open_ || open_->partial) {
    return std::nullopt;
  }
  Gap gap = *open_;
  gap.t_to_us = std::max(t_send_us, gap.t_from_us);
  return gap;
}

void GapTracker::stored(std::uint64_t seq, Micros t_send_us, Micros t_recv_us, Cause cause,
                        const std::string& missing) {
  const bool continues =
      open_ && open_->partial && !missing.empty() && open_->cause == cause && open_->detail == missing;
  if (continues) {
    ++open_->seq_count;
    open_->t_to_us = t_recv_us;
    flush_if_old(t_recv_us);
  } else {
    if (open_ && !open_->partial) {
      open_.reset();
    }
    flush();
    if (!missing.empty()) {
      open(seq, 1, t_send_us, t_recv_us);
      open_->partial = true;
      open_->cause = cause;
      open_->detail = missing;
    }
  }
  last_good_us_ = t_recv_us;
}

void GapTracker::clock_set(Micros later_us) {
  flush();
  if (last_good_us_) {
    *last_good_us_ += later_us;
  }
}

void GapTracker::flush_if_old(Micros wall_us) {
  // A wall clock that steps back must not postpone the row, so the distance counts in both directions.
  const Micros age = wall_us > opened_us_ ? wall_us - opened_us_ : opened_us_ - wall_us;
  if (open_ && age >= flush_interval_us_) {
    flush();
  }
}

void GapTracker::flush() {
  if (open_) {
    emit_(*open_);
    open_.reset();
  }
}

}  // namespace tacho::recorder
