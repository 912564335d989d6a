#include "recorder/ring.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <string_view>
#include <utility>

#include "schema/time.hpp"

namespace tacho::recorder {

namespace {

constexpr Micros kDayUs = Micros{24} * 3'600'000'000;

bool is_serious(const Event& e) {
  return !e.old_value.empty() && (e.subject.starts_with("fatal ") || e.subject.starts_with("error "));
}
bool comes_on(const Event& e) { return e.new_value == "true" && !e.old_value.empty(); }
bool always(const Event&) { return true; }

struct Trigger {
  EventKind kind;
  bool (*holds)(const Event&);
};
constexpr std::array kTriggers{
    Trigger{EventKind::alarm_raised, is_serious}, Trigger{EventKind::blocked, comes_on},
    Trigger{EventKind::emergency, comes_on},      Trigger{EventKind::driver_emergency, comes_on},
    Trigger{EventKind::pose_jump, always},        Trigger{EventKind::mark, always},
};

}  // namespace

std::string ring_trigger(const Event& event) {
  const bool holds = std::any_of(kTriggers.begin(), kTriggers.end(), [&](const Trigger& trigger) {
    return trigger.kind == event.kind && trigger.holds(event);
  });
  if (!holds) {
    return "";
  }
  const std::string_view kind = event_kind_name(event.kind);
  return event.subject.empty() ? std::string(kind) : fmt::format("{} {}", kind, event.subject);
}

std::size_t Ring::Row::bytes() const { return sizeof(Kept) + (answer ? answer->body.size() : 0); }

Ring::Ring(RingSettings settings, Write write, Announce announce)
    : settings_(settings), write_(std::move(write)), announce_(std::move(announce)) {}

void Ring::add(RobotId robot, Row row, Micros mono_us) {
  Robot& ring = robots_[robot];
  if (mono_us < ring.open_until_us && !spent(mono_us)) {
    write(ring, std::move(row));
    return;
  }
  if (mono_us < ring.open_until_us) {
    cut_off(ring, row.answer ? row.answer->meta.t_send_us : row.gap->t_from_us);
  }
  bytes_ += row.bytes();
  ring.kept.push_back({std::move(row), mono_us});
  while (!ring.kept.empty() && ring.kept.front().mono_us < mono_us - settings_.before_us) {
    drop_oldest(ring);
  }
  shrink();
}

void Ring::trigger(const Event& event, const std::string& why, Micros mono_us) {
  const auto found = robots_.find(event.robot);
  if (found == robots_.end()) {
    return;  // its ring is off
  }
  Robot& ring = found->second;
  const bool open = mono_us < ring.open_until_us;
  const bool refused = spent(mono_us);
  if (open && refused) {
    cut_off(ring, event.t_us);
    return;
  }
  if (open || (refused && std::exchange(told_spent_, true))) {
    ring.open_until_us = refused ? 0 : mono_us + settings_.after_us;
    return;
  }
  while (!ring.kept.empty() && ring.kept.front().mono_us < mono_us - settings_.before_us) {
    drop_oldest(ring);
  }
  std::uint64_t polls = 0;
  for (const Kept& kept : ring.kept) {
    polls += kept.row.polls();
  }
  Event announced = event;
  announced.source = Source::ring;
  announced.kind = EventKind::ring_kept;
  announced.seq = ring.counts.written;
  announced.t_from_us = announced.t_us;
  announced.subject = why;
  announced.old_value = std::to_string(ring.counts.aged_out - std::exchange(ring.told_aged_out, ring.counts.aged_out));
  announced.new_value = std::to_string(refused ? 0 : polls);
  announced.detail = refused ? fmt::format("not written: {} MB of this day are used up", settings_.day_bytes >> 20)
                             : fmt::format("{} polls of the {} before it follow, and those of {} after it", polls,
                                           duration_text(settings_.before_us), duration_text(settings_.after_us));
  announce_(announced);
  if (refused) {
    return;
  }
  ring.window = announced;
  ring.open_until_us = mono_us + settings_.after_us;
  for (std::deque<Kept> kept = std::exchange(ring.kept, {}); !kept.empty(); kept.pop_front()) {
    bytes_ -= kept.front().row.bytes();
    write(ring, std::move(kept.front().row));
  }
}

/// The day's budget ends a window before its time.
void Ring::cut_off(Robot& ring, Micros t_us) {
  ring.open_until_us = 0;
  told_spent_ = true;
  Event event = ring.window;
  event.seq = ring.counts.written;
  event.t_us = event.t_from_us = t_us;
  event.old_value = std::to_string(ring.counts.aged_out - std::exchange(ring.told_aged_out, ring.counts.aged_out));
  event.new_value = "0";
  event.detail = fmt::format("cut off here: {} MB of this day are used up", settings_.day_bytes >> 20);
  announce_(event);
}

void Ring::write(Robot& ring, Row row) {
  if (row.gap) {
    row.gap->seq_from = ring.counts.written;
    ring.counts.written += row.gap->seq_count;
  }
  if (row.answer) {
    row.answer->meta.seq = ring.counts.written++;
    day_bytes_ += row.answer->body.size();
  }
  write_(row);
}

void Ring::drop_oldest(Robot& ring) {
  bytes_ -= ring.kept.front().row.bytes();
  ring.counts.aged_out += ring.kept.front().row.polls();
  ring.kept.pop_front();
}

/// To the budget: the oldest of all robots go.
void Ring::shrink() {
  while (bytes_ > settings_.budget_bytes) {
    Robot* oldest = nullptr;
    for (auto& [id, ring] : robots_) {
      const bool older =
          !ring.kept.empty() && (oldest == nullptr || ring.kept.front().mono_us < oldest->kept.front().mono_us);
      oldest = older ? &ring : oldest;
    }
    drop_oldest(*oldest);
  }
}

bool Ring::spent(Micros mono_us) {
  if (mono_us - day_began_us_ >= kDayUs) {
    day_began_us_ = mono_us;
    day_bytes_ = 0;
    told_spent_ = false;
  }
  return day_bytes_ >= settings_.day_bytes;
}

void Ring::end() {
  for (auto& [id, ring] : robots_) {
    while (!ring.kept.empty()) {
      drop_oldest(ring);
    }
  }
}

Ring::Counts Ring::counts(RobotId robot) const {
  const auto found = robots_.find(robot);
  return found == robots_.end() ? Counts{} : found->second.counts;
}

}  // namespace tacho::recorder
